"""A camera's calibration: image px to grid mm, valid within the grid it was made with."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dic.bicubic import BicubicMap
from dic.grid_points import GridPoints

Points = NDArray[np.float64]


@dataclass(frozen=True)
class Calibration:
    """The paper's calibration of one camera from one image of a grid.

    Attributes
    ----------
    bicubic : BicubicMap
        Image px to grid mm.
    grid : GridPoints
        The intersections it was fitted to.
    image_shape : tuple of int
        Height and width of the grid image, px.
    source : str
        The grid image's file, or the camera and run it came from.
    """

    bicubic: BicubicMap
    grid: GridPoints
    image_shape: tuple[int, int]
    source: str = ""

    @classmethod
    def fit(cls, grid: GridPoints, image_shape: tuple[int, ...], source: str = "") -> "Calibration":
        """Fit the bicubic map to the grid points of an image.

        Raises
        ------
        CalibrationError
            If the points do not determine the map.
        """
        return cls(BicubicMap.fit(grid.uv_px, grid.xy_mm), grid, (image_shape[0], image_shape[1]), source)

    def map(self, px: Points) -> Points:
        """Return grid coordinates (n, 2) in mm of image points (n, 2) in px; NaN stays NaN.

        The map is defined everywhere but holds only where `inside` is true.
        """
        return self.bicubic.map(px)

    def inside(self, px: Points) -> NDArray[np.bool_]:
        """Tell which image points (n, 2) lie within the calibrated area; NaN is outside.

        The area is the polygon of the outermost grid points. Outside it the bicubic map "quickly deviates
        from the desired values" (Helm and Deaner), so such points are flagged wherever they occur.
        """
        points = np.asarray(px, np.float64).reshape(-1, 2)
        outline = self.outline_px
        inside = np.zeros(len(points), bool)
        for start, end in zip(outline, np.roll(outline, -1, axis=0), strict=True):
            if start[1] == end[1]:
                continue
            spans = (start[1] > points[:, 1]) != (end[1] > points[:, 1])
            slope = (end[0] - start[0]) / (end[1] - start[1])
            inside ^= spans & (points[:, 0] < start[0] + slope * (points[:, 1] - start[1]))
        return inside

    @cached_property
    def outline_px(self) -> Points:
        """The calibrated area's corners in the image, in order, shape (m, 2), px."""
        return self.grid.outline_px()

    @cached_property
    def residual_mm(self) -> Points:
        """Mapped minus true position of every grid point, shape (n, 2), mm."""
        return self.map(self.grid.uv_px) - self.grid.xy_mm

    @cached_property
    def residual_px(self) -> Points:
        """The same residual as it appears in the image, shape (n, 2), px."""
        jacobian = self.bicubic.jacobian(self.grid.uv_px)
        return np.linalg.solve(jacobian, self.residual_mm[:, :, None])[:, :, 0].astype(np.float64)

    @property
    def rms_mm(self) -> float:
        """Root mean square length of `residual_mm`."""
        return float(np.sqrt(np.mean(np.sum(self.residual_mm**2, axis=1))))

    @property
    def rms_px(self) -> float:
        """Root mean square length of `residual_px`."""
        return float(np.sqrt(np.mean(np.sum(self.residual_px**2, axis=1))))

    @property
    def max_mm(self) -> float:
        """Largest length of `residual_mm`."""
        return float(np.linalg.norm(self.residual_mm, axis=1).max())

    @property
    def max_px(self) -> float:
        """Largest length of `residual_px`."""
        return float(np.linalg.norm(self.residual_px, axis=1).max())

    @property
    def mm_per_px(self) -> float:
        """Scale at the middle of the grid: the square root of the area that one pixel sees."""
        middle = self.grid.uv_px.mean(axis=0, keepdims=True)
        return float(np.sqrt(abs(np.linalg.det(self.bicubic.jacobian(middle)[0]))))

    def save(self, path: str | Path) -> None:
        """Write the calibration as HDF5, whole or not at all.

        Raises
        ------
        CalibrationError
            If the file cannot be written.
        """
        from dic.calibration_file import save_calibration

        save_calibration(self, Path(path))

    @classmethod
    def load(cls, path: str | Path) -> "Calibration":
        """Read a calibration written by `save`.

        Raises
        ------
        CalibrationError
            If the file is missing, cut off, or no calibration.
        """
        from dic.calibration_file import load_calibration

        return load_calibration(Path(path))
