"""A picture of a calibration: the points over the grid image, and what the map leaves of them."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dic.calibration import Calibration

Floats = NDArray[np.float64]


def draw_calibration(calibration: Calibration, image: NDArray[np.float32]) -> Any:
    """Return a matplotlib figure: left the points found and the axes, right the residuals, magnified.

    Parameters
    ----------
    calibration : Calibration
    image : ndarray, shape (height, width)
        The grid image it was made from.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(14, 7), layout="constrained")
    left, right = figure.subplots(1, 2)
    low, high = np.percentile(image, [0.5, 99.5])
    points = calibration.grid.uv_px
    outline = np.vstack([calibration.outline_px, calibration.outline_px[:1]])
    for axes in (left, right):
        # residuals are read against a pale image
        faded = low - (0.0 if axes is left else 3 * (high - low))
        axes.imshow(image, cmap="gray", vmin=faded, vmax=high)
        axes.plot(*outline.T, color="tab:orange", linewidth=1)
        axes.set_xlabel("x, px")
        axes.set_ylabel("y, px")
    left.plot(*points.T, "+", color="tab:red", markersize=5, markeredgewidth=0.8)
    _draw_axes(left, calibration)
    left.set_title(f"{calibration.grid.found} of {calibration.grid.expected} intersections, calibrated area")

    residual = calibration.residual_px
    length = np.linalg.norm(residual, axis=1)
    magnification = _round_down(1.5 * _spacing_px(calibration) / max(float(length.max()), 1e-9))
    arrows = right.quiver(
        *points.T, *residual.T, length, scale=1 / magnification, angles="xy", scale_units="xy", width=0.003
    )
    figure.colorbar(arrows, ax=right, label="residual, px", shrink=0.8)
    right.set_title(
        f"residuals × {magnification:g}: rms {calibration.rms_px:.4f} px = "
        f"{calibration.rms_mm * 1000:.2f} µm, maximum {calibration.max_px:.4f} px"
    )
    return figure


def plot_calibration(path: Path, calibration: Calibration, image: NDArray[np.float32]) -> None:
    """Write `draw_calibration`'s figure as a PNG file."""
    draw_calibration(calibration, image).savefig(path, dpi=100, format="png")


def _draw_axes(axes: Any, calibration: Calibration) -> None:
    grid = calibration.grid
    origin = grid.uv_px[np.argmin((grid.xy_mm**2).sum(axis=1))]
    per_px = calibration.jacobian(origin[None])[0]
    for name, direction in zip("XY", np.linalg.inv(per_px).T * 2 * grid.pitch_mm, strict=True):
        arrow = {"arrowstyle": "->", "color": "tab:blue", "linewidth": 2}
        axes.annotate("", origin + direction, origin, arrowprops=arrow)
        place = {"ha": "center", "va": "center", "weight": "bold", "color": "tab:blue"}
        axes.annotate(name, origin + 1.25 * direction, **place)


def _spacing_px(calibration: Calibration) -> float:
    return calibration.grid.pitch_mm / calibration.mm_per_px


def _round_down(value: float) -> float:
    """Return the largest of 1, 2, 5 × 10^n not above `value`."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(step for step in (1, 2, 5) if step * power <= value))
