"""Further images of a grid in the axes of the first image."""

from collections.abc import Sequence

import numpy as np

from dic.calibration.grid_accuracy import KnownGrid
from dic.calibration.grid_making import GridAccuracy
from dic.calibration.pinhole.fit import fit_pinholes
from dic.calibration.pinhole.prior import KnownCamera
from dic.errors import CalibrationError
from dic.targets.points import GridPoints


def in_axes_of_first(
    grids: Sequence[GridPoints],
    image_shape: tuple[int, int],
    known: KnownCamera | None,
    accuracy: GridAccuracy,
) -> tuple[GridPoints, ...]:
    """Return the grid points of all images, with X and Y along the lines that they follow in the first image.

    A grid without a mark looks the same after a turn by 90°, but its scales along X and Y differ, and with
    them its images. So each image whose axes are assumed is fitted together with the first in both ways, and
    the better one is used. A turn by 180° changes none of the deviations.
    """
    first, *others = grids
    grid = KnownGrid.of(accuracy)

    def noise_px(other: GridPoints) -> float:
        try:
            return fit_pinholes([first, other], image_shape, known, k2=False, grid=grid)[0].noise_px
        except CalibrationError:
            return np.inf

    if not grid.free[:2].any():
        return tuple(grids)
    return (first, *(min(_ways(other, first.lines), key=noise_px) for other in others))


def _ways(grid: GridPoints, lines: tuple[int, int]) -> list[GridPoints]:
    """Return the grid as it is, and turned by 90° if that may be the same target."""
    square = GridPoints.on_lattice(grid.index, grid.uv_px, grid.lines, grid.pitch_mm)
    if grid.orientation == "mark" or not np.allclose(square.xy_mm, grid.xy_mm):
        return [grid]
    columns, rows = grid.lines
    column, row = grid.index.T
    index = np.column_stack([row, columns - 1 - column])
    turned = GridPoints.on_lattice(index, grid.uv_px, (rows, columns), grid.pitch_mm)
    return [way for way in (grid, turned) if way.lines == lines] or [grid]
