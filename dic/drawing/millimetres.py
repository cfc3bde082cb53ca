"""The map of a calibration in a form that a web page can evaluate: values at the nodes of a grid."""

from typing import Any

import numpy as np

from dic.calibration.calibration import Calibration
from dic.typing import Float

_ERROR_MM = 0.0005
"""Largest error of the interpolation between nodes that is aimed at: half of the last digit that the page
shows.
"""

_FEWEST_CELLS, _MOST_CELLS = 16, 128
_DECIMALS = 5


def calibration_nodes(calibration: Calibration) -> dict[str, Any]:
    """Return the coordinates of nodes in px, their coordinates in mm, and the outline of the calibrated area.

    The nodes cover the rectangle around the calibrated area. The nodes are so dense that linear interpolation
    between them is wrong by at most 0.0005 mm, but there are never more than 128 × 128 cells.

    Result: ``x`` and ``y``, the columns and rows of nodes in px; ``mm``, a list of rows of [X, Y];
    ``outline``, a list of [x, y]; ``error_mm``, the largest error in the middle of cells inside the area.
    """
    outline = calibration.grid.outline_px()
    cells = _FEWEST_CELLS
    while True:
        x, y, mm = _nodes(calibration, outline, cells)
        error_mm = _error_mm(calibration, x, y, mm)
        if error_mm <= _ERROR_MM or cells >= _MOST_CELLS:
            break
        cells *= 2
    return {
        "x": x.tolist(),
        "y": y.tolist(),
        "mm": np.round(mm, _DECIMALS).tolist(),
        "outline": np.round(outline, 2).tolist(),
        "error_mm": error_mm,
    }


def _nodes(calibration: Calibration, outline: Float, cells: int) -> tuple[Float, Float, Float]:
    """Return columns, rows, and the coordinates in mm of the nodes, shape (rows, columns, 2)."""
    (left, top), (right, bottom) = outline.min(axis=0), outline.max(axis=0)
    x, y = np.linspace(left, right, cells + 1), np.linspace(top, bottom, cells + 1)
    return x, y, _mapped(calibration, x, y)


def _mapped(calibration: Calibration, x: Float, y: Float) -> Float:
    columns, rows = np.meshgrid(x, y)
    return calibration.map(np.stack([columns, rows], axis=-1).reshape(-1, 2)).reshape(len(y), len(x), 2)


def _error_mm(calibration: Calibration, x: Float, y: Float, mm: Float) -> float:
    """Return the largest error of linear interpolation in the middle of cells in the calibrated area."""
    middle_x, middle_y = 0.5 * (x[1:] + x[:-1]), 0.5 * (y[1:] + y[:-1])
    columns, rows = np.meshgrid(middle_x, middle_y)
    inside = calibration.inside(np.stack([columns, rows], axis=-1).reshape(-1, 2))
    exact = _mapped(calibration, middle_x, middle_y)
    interpolated = 0.25 * (mm[1:, 1:] + mm[1:, :-1] + mm[:-1, 1:] + mm[:-1, :-1])
    errors = np.abs(interpolated - exact).max(axis=-1)[inside.reshape(columns.shape)]
    return float(errors.max(initial=0.0))
