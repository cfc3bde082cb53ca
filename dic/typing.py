"""Names for type annotations: the arrays that dic works with, paths, and images."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]
"""Computed values, such as coordinates, displacements and strains."""

Grey = NDArray[np.float32]
"""Grey levels of an image, shape (height, width)."""

Mask = NDArray[np.bool_]
"""A mask that is True at the selected pixels or points."""

Indices = NDArray[np.int64]
"""Integers: pixel coordinates, or numbers of rows and columns."""

PathLike = str | Path

ImageLike = NDArray[np.generic] | PathLike
"""An image: grey levels of shape (height, width), or the path of an image file."""
