"""Check and convert images and regions of interest that callers give as arrays or as files."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from dic.errors import CorrelationError, require_kind
from dic.image.read import read_image
from dic.image.stored import everywhere, is_large
from dic.regions.drawn import DrawnRegion
from dic.regions.read import is_region_file, read_drawn_region
from dic.typing import Grey, ImageLike, Mask, PathLike

Item = TypeVar("Item")


def grey_image(image: object, name: str) -> Grey:
    """Return an image's grey levels as float32, shape (height, width).

    `image`, shape (height, width): grey levels as integers or floating-point numbers, or a file for
    `read_image`. `name`: name of the image in error messages, such as "reference image".

    Raises `MeasurementError` if the file cannot be read, or if the argument is not a grey image with finite
    values.
    """
    if isinstance(image, str | Path):
        return read_image(image)
    if not isinstance(image, np.ndarray):
        got, remedy = f"a {type(image).__name__}", "give an array, or the path of an image file"
    elif is_colour(image):
        got = f"a colour image of {image.shape[1]} × {image.shape[0]} px"
        remedy = "convert it to grey: image[..., :3].mean(axis=2), or let dic.read_image read its file"
    elif image.ndim != 2:
        got, remedy = f"an array of shape {image.shape}", "give one image of shape (height, width)"
    elif image.dtype.kind not in "uif":
        got, remedy = (
            f"values of type {image.dtype}",
            "convert them to integers or floating-point numbers",
        )
    else:
        grey = np.ascontiguousarray(image, np.float32)
        if np.isfinite(grey).all():
            return grey
        got, remedy = "NaN or infinity among them", "replace them, for example by 0"
    raise CorrelationError(name, "read", "finite grey levels of shape (height, width)", got, remedy)


def grey_levels(image: object, name: str) -> NDArray[Any]:
    """Return an image's grey levels: of a large image with 8 or 16 bit as stored, otherwise as float32.

    The arguments and errors are those of `grey_image`.
    """
    found = read_image(image, stored=True) if isinstance(image, str | Path) else image
    if isinstance(found, np.ndarray) and found.ndim == 2 and found.dtype in (np.uint8, np.uint16):
        return found if is_large(found.shape) else found.astype(np.float32)
    return grey_image(found, name)


def kept(grey: NDArray[Any], given: object) -> NDArray[Any]:
    """Return the grey levels of `given` so that they stay: a copy if they share the memory of an array.

    The caller of the library may write the next image into its array.
    """
    shared = isinstance(given, np.ndarray) and np.shares_memory(grey, given)
    return grey.copy() if shared else grey


def name_of(image: ImageLike, otherwise: str) -> str:
    """Return the path of an image file; for an array return the text `otherwise`."""
    return str(image) if isinstance(image, str | Path) else otherwise


def one_by_one(images: ImageLike | Iterable[Item]) -> Iterable[ImageLike | Item]:
    """Return images one by one; a single array or path counts as a series of one image.

    An array of shape (number, height, width) is a series. A single colour image also has three dimensions. A
    colour image is refused here with an error message of its own, because otherwise each of its rows would
    count as an image.

    Raises `CorrelationError` if the argument is neither an image nor a series of images.
    """
    if isinstance(images, str | Path) or (isinstance(images, np.ndarray) and images.ndim == 2):
        return [images]
    if is_colour(images):
        return [grey_image(images, "deformed image")]
    require_kind("images", images, Iterable, "give one image, or a list of arrays or of paths")
    return cast(Iterable[Item], images)


def is_colour(image: object) -> bool:
    """Return True if the object is an array of one colour image, shape (height, width, 3 or 4)."""
    return isinstance(image, np.ndarray) and image.ndim == 3 and image.shape[2] in (3, 4)


def checked_region(region: object, shape: tuple[int, ...]) -> Mask:
    """Return a region of interest as a mask that has the shape of the image.

    `region`, shape (height, width): a mask that is True at the pixels to measure, or the path of a mask image
    (see `read_mask`) or of a region file (see `read_drawn_region`). `shape`: height and width of the image.

    Raises `MeasurementError` if the file cannot be read, or if the region does not fit the image.
    """
    if isinstance(region, str | Path):
        if is_region_file(region):
            return read_drawn_region(str(region)).mask(shape)
        region = read_mask(region)
    if not isinstance(region, np.ndarray):
        got, remedy = f"a {type(region).__name__}", "give a mask, and settings by their name: settings=…"
    elif region.shape != shape:
        got = " x ".join(str(n) for n in region.shape[::-1]) + " px"
        remedy = f"draw the mask on an image of the series, {shape[1]} x {shape[0]} px"
    else:
        return np.ascontiguousarray(region, np.bool_)
    raise CorrelationError(
        "region of interest",
        "compare with the reference",
        f"a mask of {shape[1]} x {shape[0]} px",
        got,
        remedy,
    )


def fixed_region(region: object, shape: tuple[int, ...]) -> Mask:
    """Return the region of `checked_region` as a read-only mask; a mask that the caller can change is copied.

    Measurements use the region again after the correlation. Points and strain must then have the same region.
    """
    mask = checked_region(region, shape)
    if mask is region and mask.flags.writeable:
        mask = mask.copy()
    return fixed(mask)


def fixed(mask: Mask) -> Mask:
    """Return the same mask, which is read-only from now on.

    A large mask that is True everywhere becomes a mask that takes no memory.
    """
    if is_large(mask.shape) and mask.all():
        return everywhere(mask.shape)
    mask.setflags(write=False)
    return mask


_WHITE = (255.0, 65535.0)
"""Brightest grey levels of image files of 8 and of 16 bit."""


def read_mask(path: PathLike) -> Mask:
    """Return a mask image as booleans, shape (height, width).

    The mask is True where the image is brighter than half of its brightest grey level. An image that is white
    everywhere selects the whole image.

    Raises `MeasurementError` if the file cannot be read, or if all its pixels have the same grey level and
    are not white.
    """
    mask = read_image(path)
    if mask.max() <= mask.min() and mask.max() not in _WHITE:
        raise CorrelationError(
            str(path),
            "read region of interest",
            "a mask with white where to measure and black elsewhere",
            "one uniform grey",
            "draw the mask again, or leave the region out",
        )
    return np.asarray(mask > mask.max() / 2, np.bool_)


def read_region(roi: PathLike | None, polygons: Sequence[str], shape: tuple[int, ...]) -> Mask | None:
    """Return the region of interest that a file and polygons describe, shape (height, width).

    If a file and polygons are given, the region is their intersection. If neither a file nor a polygon is
    given, the result is None.

    Parameters
    ----------
    roi : path or None
        A mask image that is white at the pixels to measure, or a region file: polygons, holes and cracks in
        TOML or JSON, corners in a CSV table, or areas that ImageJ has saved (.roi, or .zip for several).
    polygons : sequence of str
        Each text holds the corners of a polygon, "x,y x,y x,y …" in px, or names a region file. All polygons
        form one region, so a polygon inside another is a hole.
    shape : (int, int)
        Height and width of the image.

    Raises
    ------
    MeasurementError
        If a file cannot be read or holds no region, if a mask differs in size from the image, or if polygons
        lie outside the image or cross each other.
    """
    region = None if roi is None else checked_region(roi, shape)
    if polygons:
        drawn = DrawnRegion.of([read_drawn_region(source) for source in polygons]).mask(shape)
        region = drawn if region is None else region & drawn
    return region
