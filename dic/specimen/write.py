"""Write a region as a mask image and as polygons, which can be edited, and draw a picture to check it."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dic.errors import OutputError
from dic.files.writing import replacing, write_text
from dic.image.given import checked_region, grey_image
from dic.regions.crossings import find_crossings
from dic.regions.file import region_text
from dic.typing import Float, ImageLike, Mask, PathLike

_TOLERANCE_PX = 0.6
"""Largest distance of the polygons from the outline of the mask."""

_SMALLEST_HOLE_PX = 4
"""Polygons leave out specks and holes that have fewer pixels than this."""

_OUTLINE = (0, 140, 255)
"""Orange in the order blue, green, red: visible on every grey level, also for colour-blind people."""


class RegionFiles(NamedTuple):
    """The files that `write_region` writes.

    Attributes
    ----------
    mask : Path
        PNG image, white in the region.
    polygons : Path
        TOML file with the corners of the outlines.
    overlay : Path
        PNG image of the reference; the area outside the region is darkened.
    """

    mask: Path
    polygons: Path
    overlay: Path


def region_files(path: PathLike) -> RegionFiles:
    """Return the names of the files that `write_region` writes beside the mask image `path`.

    Raises
    ------
    OutputError
        If `path` does not end with .png.
    """
    mask = Path(path)
    if mask.suffix.lower() != ".png":
        raise OutputError(
            str(path), "write mask", "a name that ends with .png", mask.name, "name it mask.png"
        )
    return RegionFiles(mask, mask.with_suffix(".toml"), mask.with_name(f"{mask.stem}-overlay.png"))


def write_region(region: Mask | PathLike, image: ImageLike, path: PathLike) -> RegionFiles:
    """Write a region as a mask image and as polygons, and draw the region on the image.

    The mask image and the polygons can be edited and given as the region of a later measurement. The mask
    image gives exactly this region; polygons follow its outline within 0.6 px.

    Parameters
    ----------
    region : ndarray of bool, shape (height, width), or path
    image : ndarray, shape (height, width), or path
    path : path
        The mask image. The other two files have the same name with the endings .toml and -overlay.png.

    Raises
    ------
    MeasurementError
        If the region or the image cannot be used, or if `path` does not end with .png.
    OSError
        If a file cannot be written.
    """
    files = region_files(path)
    grey = grey_image(image, "image")
    mask = checked_region(region, grey.shape)
    _write_png(mask.astype(np.uint8) * 255, files.mask)
    write_text(files.polygons, region_text(region_polygons(mask), (mask.shape[1], mask.shape[0])))
    low, high = (float(level) for level in np.percentile(grey, (0.5, 99.5)))
    levels = np.clip((grey - low) * (255.0 / max(high - low, 1e-9)), 0, 255).astype(np.uint8)
    _write_png(_overlay(levels, mask), files.overlay)
    return files


def region_polygons(mask: Mask, tolerance_px: float = _TOLERANCE_PX) -> list[Float]:
    """Return the outlines of a mask as polygons (corners, 2): the outer outlines and those of holes.

    A pixel belongs to the mask if its centre lies inside an odd number of polygons. Edges of the polygons do
    not cross each other.

    `tolerance_px`: largest distance of the polygons from the outline of the mask. With a larger distance
    there are fewer corners. `mask` has the shape (height, width).
    """
    polygons = _outlines(mask, tolerance_px)
    # Where the mask is narrow, simplified outlines of its two sides may cross. Exact outlines never do.
    return _outlines(mask, 0.0) if find_crossings(polygons) else polygons


def _outlines(mask: Mask, tolerance_px: float) -> list[Float]:
    import cv2

    # At twice the resolution, the contours pass between the mask's pixels and their neighbours.
    doubled = np.repeat(np.repeat(mask.view(np.uint8), 2, axis=0), 2, axis=1)
    contours, _ = cv2.findContours(doubled, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    polygons = []
    for contour in contours:
        if cv2.contourArea(contour) < 4 * _SMALLEST_HOLE_PX:
            continue
        corners = cv2.approxPolyDP(contour, 2 * tolerance_px, True)[:, 0].astype(np.float64)
        if len(corners) >= 3:
            polygons.append(corners / 2.0 - 0.25)
    return polygons


def _overlay(levels: NDArray[np.uint8], mask: Mask) -> NDArray[np.uint8]:
    """Return the picture in colour, darkened outside the region, with the region's outline."""
    import cv2

    colour = np.repeat(np.where(mask, levels, levels // 3)[:, :, None], 3, axis=2)
    contours, _ = cv2.findContours(mask.view(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(colour, contours, -1, _OUTLINE, max(2, round(max(mask.shape) / 500)))
    return colour


def _write_png(picture: NDArray[np.uint8], path: Path) -> None:
    import cv2

    _, content = cv2.imencode(".png", picture)
    with replacing(path) as partial:
        partial.write_bytes(content.tobytes())
