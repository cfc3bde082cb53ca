"""Small pictures of the newest camera images, for a browser or another program.

Import this module before a run begins, because loading OpenCV can stop all threads for more than a second.
"""

from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import Frame

WIDTH_MAX_PX = 1024
_STRIP_MIN_PX = 14
"""Height in px of the black strip with the word SIMULATED."""

Format = Literal["png", "jpg"]


def thumbnail(frame: Frame, bits: int, width_px: int, kind: Format, *, simulated: bool) -> bytes:
    """Return a picture at most `width_px` pixels wide. A simulated picture contains the word SIMULATED.

    `bits` is the number of significant bits of a pixel. The highest grey level becomes white. `width_px` is
    from 16 to `WIDTH_MAX_PX`.
    """
    image = frame.image
    width_px = min(max(16, width_px), WIDTH_MAX_PX, image.shape[1])
    height_px = max(1, round(image.shape[0] * width_px / image.shape[1]))
    small = cv2.resize(image, (width_px, height_px), interpolation=cv2.INTER_AREA)
    levels = np.clip(small.astype(np.float32) * (255.0 / ((1 << bits) - 1)), 0, 255).astype(np.uint8)
    picture: NDArray[np.uint8] = np.ascontiguousarray(levels)
    if simulated:
        strip_px = min(height_px, max(_STRIP_MIN_PX, width_px // 12))
        picture[:strip_px] = 0
        place = (strip_px // 4, round(0.75 * strip_px))
        cv2.putText(picture, "SIMULATED", place, cv2.FONT_HERSHEY_SIMPLEX, strip_px / 36.0, 255)
    done, data = cv2.imencode(f".{kind}", picture)
    if not done:
        raise ValueError(f"the picture cannot be written as {kind}")
    return bytes(data.tobytes())
