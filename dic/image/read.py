"""Read image files as grey levels, and refuse files that cannot be measured."""

import struct
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dic.errors import ImageError, ImageWarning, require_kind
from dic.files.reading import read_bytes
from dic.image.container import Container, Damage, read_bmp, require_bounded
from dic.image.png import SIGNATURE as PNG
from dic.image.png import read_png
from dic.image.tiff import SIGNATURES as TIFFS
from dic.image.tiff import read_tiff

MINIMUM_SIDE_PX = 32
GREY_MAX = 1e9
"""Limit of the grey levels, because the fourth powers of larger levels overflow float32.

No camera gives larger grey levels.
"""

# weights of ITU-R BT.601 for blue, green and red, which is OpenCV's order of channels
_LUMA_BGR = np.array([0.114, 0.587, 0.299])

# For each orientation tag, the turn that makes the stored image upright (TIFF 6.0, section 8).
_TURNS: dict[int, Callable[[NDArray[np.float32]], NDArray[np.float32]]] = {
    1: lambda grey: grey,
    2: np.fliplr,
    3: lambda grey: np.rot90(grey, 2),
    4: np.flipud,
    5: np.transpose,
    6: lambda grey: np.rot90(grey, -1),
    7: lambda grey: np.rot90(grey, 2).T,
    8: np.rot90,
}


def read_image(path: str | Path) -> NDArray[np.float32]:
    """Read a PNG, TIFF or BMP image without loss of grey levels.

    Parameters
    ----------
    path : path
        A grey or colour image of at most 160 megapixels, with 8 bit, 16 bit or floating-point values.

    Returns
    -------
    ndarray of float32, shape (height, width)
        Grey levels as stored in the file, not rescaled. A colour image is converted to its luma (ITU-R
        BT.601); its opacity is ignored.

    Raises
    ------
    ImageError
        If the file is missing, cut off, damaged or not an image, if a side of the image is shorter than 32
        px, or if grey levels are not finite or exceed `GREY_MAX`.

    Warns
    -----
    ImageWarning
        If a TIFF file holds more than one page, of which only the first is read, or if the image is turned or
        mirrored because of the orientation tag in the file.
    """
    require_kind("path", path, str | Path, "name an image file; arrays need no reading")
    path = Path(path)
    try:
        content = read_bytes(path)
    except OSError as error:
        raise _refusal(path, error.strerror or str(error), "name an image file that exists") from error
    try:
        container = _inspect(content)
    except Damage as damage:
        raise _refusal(path, str(damage), "save or copy it again") from damage
    for note in _notes(container):
        warnings.warn(f"{path}: {note}", ImageWarning, stacklevel=2)
    stored = _decode(container.content)
    if stored is None:
        raise _refusal(path, "one that cannot be decoded", "save or copy it again")
    if stored.dtype.kind == "f" and not np.isfinite(stored).all():
        raise _refusal(path, "pixels that are NaN or infinite", "save it with finite grey levels")
    if max(float(stored.max()), -float(stored.min())) > GREY_MAX:
        raise _refusal(path, f"grey levels beyond {GREY_MAX:.0e}", "save it as the camera gave it")
    grey = np.ascontiguousarray(_TURNS[container.orientation](_grey(stored)))
    if min(grey.shape) < MINIMUM_SIDE_PX:
        got = f"{grey.shape[1]} × {grey.shape[0]} px"
        raise _refusal(path, got, f"use images of at least {MINIMUM_SIDE_PX} px on each side")
    return grey


def require_same_size(images: Sequence[NDArray[Any]], names: Sequence[str]) -> None:
    """Raise an error if an image differs in size from the first image.

    Parameters
    ----------
    images : sequence of ndarray, each of shape (height, width, …)
    names : sequence of str
        File names of the images, for the error message.

    Raises
    ------
    ImageError
        If an image differs in size. The message names the first image that differs.
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


def _notes(container: Container) -> Iterator[str]:
    if container.pages > 1:
        yield f"holds {container.pages} pages, and only the first one is read"
    if container.orientation != 1:
        yield f"was turned as its tag of orientation says ({container.orientation})"


def _inspect(content: bytes) -> Container:
    if not content:
        raise Damage("an empty file")
    try:
        if content.startswith(PNG):
            return read_png(content)
        if content[:4] in TIFFS:
            return read_tiff(content)
        if content.startswith(b"BM"):
            bitmap = read_bmp(content)
            require_bounded(bitmap, len(content))
            return bitmap
    except struct.error as error:
        raise Damage(f"a file that was cut off after {len(content)} bytes") from error
    raise Damage("another kind of file")


def _grey(stored: NDArray[Any]) -> NDArray[np.float32]:
    if stored.ndim == 2:
        return np.ascontiguousarray(stored, np.float32)
    if stored.shape[2] < 3:
        return np.ascontiguousarray(stored[..., 0], np.float32)
    grey = np.empty(stored.shape[:2], np.float32)
    # Convert one row at a time, because a whole image in float64 would take twelve times its memory.
    for row, pixels in zip(grey, stored, strict=True):
        row[:] = pixels[:, :3].astype(np.float64) @ _LUMA_BGR
    return grey


def _decode(content: bytes) -> NDArray[Any] | None:
    import cv2

    with _silent_opencv():
        try:
            image: NDArray[Any] | None = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
        except cv2.error:
            return None
    return image


@contextmanager
def _silent_opencv() -> Iterator[None]:
    """Keep OpenCV's log off the terminal, because the raised error already reports the problem."""
    import cv2

    before = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        yield
    finally:
        cv2.utils.logging.setLogLevel(before)


def _refusal(path: Path, got: str, remedy: str) -> ImageError:
    return ImageError(str(path), "read image", "a whole PNG, TIFF or BMP image", got, remedy)
