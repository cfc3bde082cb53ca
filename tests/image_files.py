"""Write arrays as image files."""

from pathlib import Path

import cv2
import numpy as np


def write_image(path: Path, picture: np.ndarray) -> Path:
    """Write an image with grey levels rounded to 8 bits, and return the path."""
    assert cv2.imwrite(str(path), np.rint(picture).astype(np.uint8))
    return path
