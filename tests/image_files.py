"""Pictures as files of images."""

from pathlib import Path

import cv2
import numpy as np


def write_image(path: Path, picture: np.ndarray) -> Path:
    """Write a picture in 8 bits, its grey levels rounded, and return where."""
    assert cv2.imwrite(str(path), np.rint(picture).astype(np.uint8))
    return path
