"""Draw a calibration: the grid points on the image, and the residuals of each model."""

from typing import Any

import numpy as np

from dic.calibration.calibration import Calibration
from dic.calibration.residuals import Residuals
from dic.files.writing import write_figure
from dic.image.given import grey_image
from dic.typing import Grey, ImageLike, PathLike


def draw_calibration(calibration: Calibration, image: Grey) -> Any:
    """Return a matplotlib figure with the grid points and axes, and with the residuals of each model.

    The residuals are drawn as arrows. Each calibration model has its own magnification of the arrows. The
    colours of the arrows have the same scale for all models.

    `image`, shape (height, width): the first grid image.
    """
    from matplotlib.figure import Figure

    residuals = calibration.residuals
    panels = 1 + len(residuals)
    height, width = image.shape
    figure = Figure(figsize=(6 * panels + 0.8, 5.6 * height / width + 0.6), layout="constrained")
    first, *others = figure.subplots(1, panels)
    low, high = np.percentile(image, [0.5, 99.5])
    _draw_image(first, calibration, image, (low, high))
    first.plot(*calibration.grid.uv_px.T, "+", color="tab:red", markersize=5, markeredgewidth=0.8)
    _draw_axes(first, calibration)
    first.set_title(f"{calibration.grid.found} of {calibration.grid.expected} intersections, calibrated area")
    longest = max(residual.max_px for residual in residuals.values())
    arrows: Any = None
    for axes, (model, residual) in zip(others, residuals.items(), strict=True):
        # Draw the image pale, so that the arrows stand out.
        _draw_image(axes, calibration, image, (low - 6 * (high - low), high))
        arrows = _draw_residual(axes, calibration, residual, longest)
        in_use = " (in use)" if model == calibration.model and len(residuals) > 1 else ""
        axes.set_title(f"{model}{in_use}, {axes.get_title()}")
    figure.colorbar(arrows, ax=others, label="residual, px", shrink=0.8)
    return figure


def plot_calibration(calibration: Calibration, image: ImageLike, path: PathLike) -> None:
    """Write the figure of `draw_calibration` to a PNG file."""
    write_figure(draw_calibration(calibration, grey_image(image, "grid image")), path, 100, "png")


def _draw_image(axes: Any, calibration: Calibration, image: Grey, limits: tuple[float, float]) -> None:
    outline = np.vstack([calibration.outline_px, calibration.outline_px[:1]])
    axes.imshow(image, cmap="gray", vmin=limits[0], vmax=limits[1])
    axes.plot(*outline.T, color="tab:orange", linewidth=1)
    axes.set_xlabel("x, px")
    axes.set_ylabel("y, px")


def _draw_residual(axes: Any, calibration: Calibration, residual: Residuals, longest_px: float) -> Any:
    length = np.linalg.norm(residual.px, axis=1)
    magnification = _round_down(2.5 * _spacing_px(calibration) / max(residual.max_px, 1e-9))
    arrows = axes.quiver(
        *calibration.grid.uv_px.T,
        *residual.px.T,
        length,
        scale=1 / magnification,
        angles="xy",
        scale_units="xy",
        width=0.003,
        clim=(0, longest_px),
    )
    axes.set_title(
        f"residuals × {magnification:g}:\nrms {residual.rms_px:.4f} px = "
        f"{residual.rms_mm * 1000:.2f} µm, maximum {residual.max_px:.4f} px"
    )
    return arrows


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
    """Return the largest number of the series …, 0.1, 0.2, 0.5, 1, 2, 5, 10, … up to `value`."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(step for step in (1, 2, 5) if step * power <= value))
