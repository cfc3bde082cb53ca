"""The report's figure of the calibrations: the residuals of each model at the points of the grid."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from dic.calibration.calibration import Calibration
from dic.calibration.residuals import Residuals
from dic.report.series import CameraSeries
from dic.report.style import png_uri

_PANEL_WIDTH_IN = 4.3
# Room around each panel for its title and labels
_LEFT_IN, _RIGHT_IN, _ABOVE_IN, _BELOW_IN = 0.65, 0.1, 0.3, 0.5


def residual_figure(cameras: Sequence[CameraSeries]) -> str:
    """Return a figure of the residuals of the calibration models at the grid points, as a data URI.

    The residuals are drawn as magnified vectors, with one row of panels per camera and one column per model.
    """
    from matplotlib.figure import Figure

    heights_in = [
        _PANEL_WIDTH_IN * height / width
        for height, width in (camera.calibration.image_shape for camera in cameras)
    ]
    width_in = 2 * (_PANEL_WIDTH_IN + _LEFT_IN) + _RIGHT_IN
    total_in = sum(heights_in) + len(cameras) * (_ABOVE_IN + _BELOW_IN)
    figure = Figure(figsize=(width_in, total_in))
    bottom_in = total_in
    for camera, height_in in zip(cameras, heights_in, strict=True):
        calibration = camera.calibration
        longest_px = max(residuals.max_px for residuals in calibration.residuals.values())
        magnification = _magnification(longest_px, calibration.grid.pitch_mm / calibration.mm_per_px)
        bottom_in -= _ABOVE_IN + height_in
        for column, (model, residuals) in enumerate(calibration.residuals.items()):
            left_in = _LEFT_IN + column * (_PANEL_WIDTH_IN + _LEFT_IN)
            box_in = np.array([left_in, bottom_in, _PANEL_WIDTH_IN, height_in])
            axis = figure.add_axes(tuple(box_in / (width_in, total_in, width_in, total_in)))
            _draw_residuals(axis, calibration, residuals, magnification)
            axis.set_title(f"{camera.label}, {model}: residuals × {magnification:g}")
        bottom_in -= _BELOW_IN
    return png_uri(figure, dpi=130)


def _draw_residuals(axis: Any, calibration: Calibration, residuals: Residuals, magnification: float) -> None:
    uv = calibration.grid.uv_px
    axis.plot(*np.vstack([calibration.outline_px, calibration.outline_px[:1]]).T, color="#bbbbbb", lw=0.8)
    axis.plot(*uv.T, ".", color="#9a9a9a", markersize=1.5)
    axis.quiver(
        *uv.T, *residuals.px.T, color="#0072b2", angles="xy", scale_units="xy",
        scale=1.0 / magnification, width=0.003, headwidth=4,
    )  # fmt: skip
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
