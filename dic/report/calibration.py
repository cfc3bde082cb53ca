"""The report's figure of the calibrations: the residuals of each model at the points of the grid."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from dic.calibration.calibration import Calibration
from dic.calibration.residuals import Residuals
from dic.report.series import CameraSeries
from dic.report.style import png_uri

_PANEL_WIDTH_IN = 4.4


def residual_figure(cameras: Sequence[CameraSeries]) -> str:
    """Return a figure of the residuals of the calibration models at the grid points, as a data URI.

    The residuals are drawn as magnified vectors, with one row of panels per camera and one column per model.
    """
    from matplotlib.figure import Figure

    shapes = [camera.calibration.image_shape for camera in cameras]
    # Add room for titles and labels. The layout reserves no such room if x and y have equal scales.
    heights_in = [_PANEL_WIDTH_IN * height / width + 0.6 for height, width in shapes]
    figure = Figure(figsize=(2 * _PANEL_WIDTH_IN + 1.2, sum(heights_in)), layout="constrained")
    rows = figure.subplots(len(cameras), 2, squeeze=False, height_ratios=heights_in)
    for row, camera in zip(rows, cameras, strict=True):
        calibration = camera.calibration
        longest_px = max(residuals.max_px for residuals in calibration.residuals.values())
        magnification = _magnification(longest_px, calibration.grid.pitch_mm / calibration.mm_per_px)
        for axis, (model, residuals) in zip(row, calibration.residuals.items(), strict=False):
            _draw_residuals(axis, calibration, residuals, magnification)
            axis.set_title(f"{camera.label}, {model}: residuals × {magnification:g}")
        for axis in row[len(calibration.residuals) :]:
            axis.set_axis_off()
    return png_uri(figure, dpi=130)


def _draw_residuals(axis: Any, calibration: Calibration, residuals: Residuals, magnification: float) -> None:
    uv = calibration.grid.uv_px
    axis.plot(*np.vstack([calibration.outline_px, calibration.outline_px[:1]]).T, color="#bbbbbb", lw=0.8)
    axis.plot(*uv.T, ".", color="#9a9a9a", markersize=1.5)
    arrows = axis.quiver(
        *uv.T, *residuals.px.T, color="#0072b2", angles="xy", scale_units="xy",
        scale=1.0 / magnification, width=0.003, headwidth=4,
    )  # fmt: skip
    # Exclude the arrows from the layout. They have no size before drawing, and the layout would move the axes
    # out of the figure.
    arrows.set_in_layout(False)
    height, width = calibration.image_shape
    axis.set(
        xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), aspect="equal", xlabel="x, px", ylabel="y, px"
    )
    axis.grid(False)


def _magnification(longest_px: float, spacing_px: float) -> float:
    """Return the largest magnification of 1, 2, 5, 10 … that keeps the vectors short.

    The longest magnified vector is at most about 1.5 times the distance between neighbouring grid points.
    """
    if longest_px <= 0.0:
        return 1.0
    limit = max(1.0, 1.5 * spacing_px / longest_px)
    decade = 10.0 ** math.floor(math.log10(limit))
    return max(step * decade for step in (1.0, 2.0, 5.0) if step * decade <= limit)
