"""Read image files as grey levels, and refuse files that cannot be measured."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from dic.errors import ImageError, require_kind, warn_of_image
from dic.files.reading import opened, read_bytes
from dic.image.container import Container, Damage
from dic.image.decoding import decode, to_grey
from dic.image.headers import read_header
from dic.image.memory import give_back_memory, share_one_heap
from dic.image.pages import page_name, split_page
from dic.image.stored import is_large
from dic.image.tiff import SIGNATURES as TIFFS
from dic.image.tiff_page import read_tiff
from dic.image.video import is_video, read_frame, read_video

MINIMUM_SIDE_PX = 32
MARKED_MIN = 9
"""Least number of equal pixels that mark missing ones; fewer are dead pixels of the sensor."""
GREY_MAX = 1e9
"""Limit of the grey levels, because the fourth powers of larger levels overflow float32.

No camera gives larger grey levels.
"""

_LOSSY = (
    "is compressed as {codec}, which changes the grey levels of speckles and can add errors to displacements"
    " that their standard deviations do not contain; let the camera save {better}"
)

# For each orientation tag, the turn that makes the stored image upright (TIFF 6.0, section 8).
_TURNS: dict[int, Callable[[NDArray[Any]], NDArray[Any]]] = {
    1: lambda grey: grey,
    2: np.fliplr,
    3: lambda grey: np.rot90(grey, 2),
    4: np.flipud,
    5: np.transpose,
    6: lambda grey: np.rot90(grey, -1),
    7: lambda grey: np.rot90(grey, 2).T,
    8: np.rot90,
}


@overload
def read_image(path: str | Path) -> NDArray[np.float32]: ...
@overload
def read_image(path: str | Path, *, stored: bool) -> NDArray[Any]: ...
def read_image(path: str | Path, *, stored: bool = False) -> NDArray[Any]:
    """Read a PNG, TIFF, BMP, PGM, PPM or JPEG image without loss of grey levels.

    Parameters
    ----------
    path : path
        A grey or colour image of at most 160 megapixels, with 8 bit, 16 bit or floating-point values. A page
        of a TIFF file has the page's number behind its name: ``stack.tif#3`` is the third page, and
        ``test.avi#3`` the third frame of a video.
    stored : bool
        True to return grey levels with 8 or 16 bit in the integer type of the file, which takes a quarter or
        half of the memory. Other grey levels are still returned as float32.

    Returns
    -------
    ndarray of float32, shape (height, width)
        Grey levels as stored in the file, not rescaled; with `stored`, of uint8 or uint16 if possible. A
        colour image is converted to its luma (ITU-R BT.601); its opacity is ignored.

    Raises
    ------
    ImageError
        If the file is missing, cut off, damaged or not an image, if a side of the image is shorter than 32
        px, or if grey levels are not finite or exceed `GREY_MAX`.

    Warns
    -----
    ImageWarning
        If a TIFF file holds several pages and the path names no page; the first page is then read. A second
        reason is that the image is turned or mirrored because of the orientation tag in the file. A third
        reason is that the image was compressed as JPEG or by a lossy codec.
    """
    require_kind("path", path, str | Path, "name an image file; arrays need no reading")
    path = Path(path)
    file, page = split_page(path)
    try:
        decoded, orientation, notes = _frame(file, page) if is_video(file) else _picture(file, page)
    except OSError as error:
        raise _refusal(path, error.strerror or str(error), "name an image file that exists") from error
    except Damage as damage:
        raise _refusal(path, str(damage), damage.remedy) from damage
    for note in notes:
        warn_of_image(path, note)
    if decoded.dtype.kind == "f" and not np.isfinite(decoded).all():
        raise _refusal(path, "pixels that are NaN or infinite", "save it with finite grey levels")
    if decoded.dtype.kind == "f" and (marker := _marker_of_missing(decoded)) is not None:
        got = f"pixels of {marker:g}, far from all others, which seem to mark missing ones"
        raise _refusal(path, got, "save it with a grey level of their surroundings there")
    if max(float(decoded.max()), -float(decoded.min())) > GREY_MAX:
        raise _refusal(path, f"grey levels beyond {GREY_MAX:.0e}", "save it as the camera gave it")
    is_plain = decoded.ndim == 2 and decoded.dtype in (np.uint8, np.uint16)
    grey = np.ascontiguousarray(_TURNS[orientation](decoded if stored and is_plain else to_grey(decoded)))
    if min(grey.shape) < MINIMUM_SIDE_PX:
        got = f"{grey.shape[1]} × {grey.shape[0]} px"
        raise _refusal(path, got, f"use images of at least {MINIMUM_SIDE_PX} px on each side")
    if is_large(grey.shape):
        share_one_heap()
        del decoded
        # The strips of the file are small blocks, which the C library would keep.
        give_back_memory()
    return grey


def _marker_of_missing(grey: NDArray[np.floating]) -> float | None:
    """Return a value that marks missing pixels, such as -9999, or None.

    Many pixels have exactly this value, and it is farther from the others than they are from each other. Zero
    is no such value: it is a black background.
    """
    for marker in (float(grey.min()), float(grey.max())):
        equal = grey == marker
        if marker and MARKED_MIN <= np.count_nonzero(equal) < grey.size:
            low = float(grey.min(where=~equal, initial=np.inf))
            high = float(grey.max(where=~equal, initial=-np.inf))
            if max(low - marker, marker - high) > high - low > 0.0:
                return marker
    return None


def _picture(file: Path, page: int | None) -> tuple[NDArray[Any], int, list[str]]:
    """Return the decoded pixels of an image file, the value of its orientation tag, and warnings."""
    container = _contained(file, page or 1)
    if is_large((container.height_px, container.width_px)):
        # The evaluation of the image before has freed small blocks, which the C library has kept.
        give_back_memory()
    return decode(container), container.orientation, list(_notes(container, file, page))


def _frame(file: Path, page: int | None) -> tuple[NDArray[Any], int, list[str]]:
    """Return a decoded frame of a video, the orientation 1 because frames are upright, and warnings."""
    video, notes = read_video(file), []
    if page is None and len(video) > 1:
        last = page_name(file, len(video)).name
        notes.append(
            f"holds {len(video)} frames, and only the first one is read; the last one is named {last}"
        )
    if video.lossy:
        notes.append(_LOSSY.format(codec=video.codec, better="images, or a video with the codec FFV1"))
    return read_frame(file, page or 1), 1, notes


def require_same_size(images: Sequence[NDArray[Any]], names: Sequence[str]) -> None:
    """Raise an `ImageError` if one of the images (height, width, …) differs in size from the first.

    The message gives the name of the first image that differs.
    """
    for image, name in zip(images[1:], names[1:], strict=True):
        if image.shape[:2] != images[0].shape[:2]:
            (height, width), (other_height, other_width) = images[0].shape[:2], image.shape[:2]
            raise ImageError(
                name,
                "compare image sizes",
                f"{width} × {height} px like {names[0]}",
                f"{other_width} × {other_height} px",
                "use images that one camera took with one readout region",
            )


def _notes(container: Container, file: Path, page: int | None) -> Iterator[str]:
    if container.pages > 1 and page is None:
        yield (
            f"holds {container.pages} pages, and only the first one is read; the last one is named"
            f" {page_name(file, container.pages).name}"
        )
    if container.orientation != 1:
        yield f"was turned as its tag of orientation says ({container.orientation})"
    if container.lossy:
        yield _LOSSY.format(codec="JPEG", better="PNG or TIFF")


def _contained(file: Path, page: int) -> Container:
    """Check a page of an image file; only a TIFF file has more than one."""
    with opened(file) as content:
        if content[:4] in TIFFS:
            return read_tiff(content, page)
    whole = read_bytes(file)
    if page > 1:
        raise Damage("a file with one page", "name it without a page")
    return read_header(whole)


def _refusal(path: Path, got: str, remedy: str) -> ImageError:
    kind = (
        "a frame of a video" if is_video(split_page(path)[0]) else "a whole PNG, TIFF, BMP, PGM or JPEG image"
    )
    return ImageError(str(path), "read image", kind, got, remedy)
