"""Read image files as grey levels; refuse those that cannot be measured."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dic.errors import ImageError
from dic.image.integrity import damage_in

MINIMUM_SIDE_PX = 32
GREY_MAX = 1e9
"""Larger grey levels are refused: their fourth powers overflow float32, and no camera has them."""

# ITU-R BT.601, in OpenCV's order of channels
_LUMA_BGR = np.array([0.114, 0.587, 0.299])


def read_image(path: str | Path) -> NDArray[np.float32]:
    """Read a PNG, TIFF or BMP image at full depth.

    Parameters
    ----------
    path : path
        8 or 16 bit or floating point; grey or colour. Of a multi-page TIFF the first page is read.

    Returns
    -------
    ndarray of float32, shape (height, width)
        Grey levels as stored, not rescaled; the luma (ITU-R BT.601) of a colour image, without its opacity.

    Raises
    ------
    ImageError
        If the file is missing, cut off, damaged or no image, or the image is smaller than 32 px or has values
        that are not finite.
    """
    path = Path(path)
    try:
        content = path.read_bytes()
    except OSError as error:
        raise _refusal(path, error.strerror or str(error), "name an image file that exists") from error
    damage = damage_in(content)
    if damage is not None:
        raise _refusal(path, damage, "save or copy it again")
    stored = _decode(content)
    if stored is None:
        raise _refusal(path, "one that cannot be decoded", "save or copy it again")
    if not np.isfinite(stored).all():
        raise _refusal(path, "pixels that are NaN or infinite", "save it with finite grey levels")
    if max(float(stored.max()), -float(stored.min())) > GREY_MAX:
        raise _refusal(path, f"grey levels beyond {GREY_MAX:.0e}", "save it as the camera gave it")
    grey = _grey(stored)
    if min(grey.shape) < MINIMUM_SIDE_PX:
        got = f"{grey.shape[1]} × {grey.shape[0]} px"
        raise _refusal(path, got, f"use images of at least {MINIMUM_SIDE_PX} px on each side")
    return grey


def require_same_size(images: Sequence[NDArray[Any]], names: Sequence[str]) -> None:
    """Refuse images that differ in size from the first.

    Parameters
    ----------
    images : sequence of ndarray, each of shape (height, width, …)
    names : sequence of str
        Their files, for the message.

    Raises
    ------
    ImageError
        If one differs; the message names the first.
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


def _grey(stored: NDArray[Any]) -> NDArray[np.float32]:
    if stored.ndim == 2:
        return np.ascontiguousarray(stored, np.float32)
    if stored.shape[2] < 3:
        return np.ascontiguousarray(stored[..., 0], np.float32)
    return np.ascontiguousarray(stored[..., :3].astype(np.float64) @ _LUMA_BGR, np.float32)


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
    """Keep OpenCV's log off the terminal: the error says what is wrong."""
    import cv2

    before = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        yield
    finally:
        cv2.utils.logging.setLogLevel(before)


def _refusal(path: Path, got: str, remedy: str) -> ImageError:
    return ImageError(str(path), "read image", "a whole PNG, TIFF or BMP image", got, remedy)
