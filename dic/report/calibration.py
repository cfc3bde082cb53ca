"""The figure of a calibration: where its map misses the grid points, and by how much."""

import math

import numpy as np

from dic.process import CameraResult
from dic.report.style import PAGE_WIDTH_IN, new_figure, png_uri


def residual_figure(cameras: list[CameraResult]) -> str:
    """Return the residual vectors of every camera's calibration, magnified, in its grid image."""
    columns = max(2, len(cameras))
    tallest = max(camera.calibration.image_shape[0] / camera.calibration.image_shape[1] for camera in cameras)
    # Room for titles and labels, which the layout does not make for axes of equal scales.
    figure, axes = new_figure(columns, (PAGE_WIDTH_IN / columns - 0.5) * tallest + 1.0)
    for axis in axes[len(cameras) :]:
        axis.set_axis_off()
    for axis, camera in zip(axes, cameras, strict=False):
        calibration = camera.calibration
        uv, residual = calibration.grid.uv_px, calibration.residual_px
        magnification = _magnification(calibration.max_px, calibration.grid.pitch_mm / calibration.mm_per_px)
        axis.plot(*np.vstack([calibration.outline_px, calibration.outline_px[:1]]).T, color="#bbbbbb", lw=0.8)
        axis.plot(*uv.T, ".", color="#9a9a9a", markersize=1.5)
        arrows = axis.quiver(
            *uv.T, *residual.T, color="#0072b2", angles="xy", scale_units="xy",
            scale=1.0 / magnification, width=0.003, headwidth=4,
        )  # fmt: skip
        # A quiver has no size before it is drawn, and would push the axes out of the figure.
        arrows.set_in_layout(False)
        height, width = calibration.image_shape
        axis.set(
            xlim=(-0.5, width - 0.5),
            ylim=(height - 0.5, -0.5),
            aspect="equal",
            xlabel="x, px",
            ylabel="y, px",
        )
        axis.grid(False)
        axis.set_title(f"{camera.camera}: residuals × {magnification:g}")
    return png_uri(figure, dpi=130)


def _magnification(longest_px: float, spacing_px: float) -> float:
    """Return the largest of 1, 2, 5, 10 … that keeps the longest vector near the distance of two points."""
    if longest_px <= 0.0:
        return 1.0
    limit = max(1.0, 1.5 * spacing_px / longest_px)
    decade = 10.0 ** math.floor(math.log10(limit))
    return max(step * decade for step in (1.0, 2.0, 5.0) if step * decade <= limit)
