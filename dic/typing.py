"""The arrays that dic works with, and what may stand for an image: one name each, for annotations."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]
"""Coordinates, displacements, strains: anything that is computed."""

Grey = NDArray[np.float32]
"""Grey levels of an image, shape (height, width)."""

Mask = NDArray[np.bool_]
"""Which pixels or points are meant."""

Indices = NDArray[np.int64]
"""Whole pixels, rows and columns."""

PathLike = str | Path

ImageLike = NDArray[np.generic] | PathLike
"""An image: grey levels of shape (height, width), or the file that holds them."""
