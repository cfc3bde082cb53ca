"""Figures of a set-up: harmonics of false strain, motion of the specimen's plane, and heights of points."""

from typing import Any

import numpy as np

from dic.out_of_plane.diagnosis import Harmonics, in_grid_axes
from dic.report import rotation, tension
from dic.report.series import LONG, Run
from dic.report.strains import COMPONENTS, MICRO, plane_slopes
from dic.report.style import (
    CONFIDENCE,
    PAIR_STYLE,
    legend_below,
    line_style,
    new_figure,
    png_uri,
    svg_uri,
)
from dic.report.thinning import some_of
from dic.runfile.reader import RunStep
from dic.typing import Float

_SMOOTH = 181
_MM_TO_UM = 1e3
_MOST_BARS = 40
_HARDLY = 20.0
"""A slope is not drawn if its standard deviation is more than this multiple of the smallest one."""


def harmonics_figure(run: Run) -> str:
    """Return a figure of the calibrated strain in the grid's axes against the stage's angle.

    The figure also shows the fitted first and second harmonic. The result is an empty text if the angles do
    not determine the harmonics.
    """
    fits = [
        (order, s, Harmonics.of(s.angles_deg, s.calibrated / MICRO))
        for order, s in rotation.ordered([run])
        if s.steps
    ]
    if not any(fit for _, _, fit in fits):
        return ""
    figure, axes = new_figure(3, 4.0)
    for component, axis in enumerate(axes):
        axis.axhline(0.0, color="#999999", linewidth=0.8)
        for order, series, fit in fits:
            style = line_style(series, order, "calibrated")
            standing = in_grid_axes(series.angles_deg, series.calibrated)[:, component]
            axis.plot(series.angles_deg, standing, label=series.label, **(style | {"linestyle": "none"}))
            if fit is not None:
                angles_deg = np.linspace(series.angles_deg.min(), series.angles_deg.max(), _SMOOTH)
                wave = MICRO * _waves(angles_deg) @ fit.coefficients[:, component]
                label = f"{series.label}, both harmonics"
                axis.plot(angles_deg, wave, color=style["color"], label=label)
        rotation.label_angles(axis, [run])
        axis.set_ylabel(f"{COMPONENTS[component]} in the grid's axes, µε")
    legend_below(figure)
    return svg_uri(figure)


def motion_figure(run: Run) -> str:
    """Return a figure of the slopes of the specimen's plane against the load.

    The figure also shows the shift of the plane, if two cameras measured the shift. The result is an empty
    text if no slope is known.
    """
    series = [
        (s.label, line_style(s, order, "calibrated"), _loads_kn(s.steps), *plane_slopes(s.corrections))
        for order, s in tension.ordered(run)
    ]
    pair = run.pair
    if pair is not None:
        loads = _loads_kn(pair.steps)
        series.append((pair.label, dict(PAIR_STYLE), loads, pair.slopes_deg, pair.slopes_std_deg))
    series = [s for s in series if np.isfinite(s[2][:, None] + s[3]).any()]
    if not series:
        return ""
    shifted = pair is not None and bool(np.isfinite(pair.shift_um).any())
    figure, axes = new_figure(3 if shifted else 2, 3.7)
    for k, axis in enumerate(axes[:2]):
        known = [float(np.nanmedian(stds[:, k])) for *_, stds in series]
        for std, (label, style, loads_kn, slopes, stds) in zip(known, series, strict=True):
            # Leave out slopes with very long error bars, because these bars would hide the other slopes.
            if std <= _HARDLY * min(known):
                _draw_bars(axis, loads_kn, slopes[:, k], stds[:, k], label, style)
        axis.set_ylabel(f"slope along {'XY'[k]}, °")
    if pair is not None and shifted:
        _draw_bars(
            axes[2], _loads_kn(pair.steps), pair.shift_um, pair.shift_std_um, pair.label, dict(PAIR_STYLE)
        )
        axes[2].set_ylabel("shift towards the cameras, µm")
    for axis in axes:
        axis.axhline(0.0, color="#999999", linewidth=0.8)
        axis.set_xlabel("load, kN")
    legend_below(figure)
    return svg_uri(figure)


def height_step(run: Run) -> tuple[RunStep, int] | None:
    """Return the step with the largest load among those with a map of heights, and its index.

    The index counts only the steps that both cameras measured. The result is None if there is no map of
    heights.
    """
    if run.pair is None:
        return None
    known = [
        (np.nan_to_num(step.load_n, nan=-np.inf), k)
        for k, (step, found) in enumerate(zip(run.pair.steps, run.pair.found, strict=True))
        if found.declined is None and found.plane is not None
    ]
    if not known:
        return None
    at = max(known)[1]
    return run.pair.steps[at], at


def height_figure(run: Run) -> str:
    """Return a figure of the heights of the specimen's points at the step with the largest load.

    A second panel shows the heights minus the fitted plane. The result is an empty text if no heights were
    measured.
    """
    from matplotlib.figure import Figure

    chosen = height_step(run)
    joint = run.result.corrections.joint
    if chosen is None or run.pair is None or joint is None:
        return ""
    step = chosen[0]
    camera = next(c for c in run.cameras if c.camera == run.pair.cameras[0])
    measurement = camera.measurements[[each.index for each in camera.steps].index(step.index)]
    found = joint.steps[step.index]
    if found.heights_mm is None or found.plane is None or measurement.calibrated is None:
        return ""
    place = measurement.calibrated.position + measurement.calibrated.vector
    plane_mm = found.plane.shift_mm + place @ np.array([found.plane.slope_x, found.plane.slope_y])
    field = measurement.field
    figure = Figure(figsize=(9.6, 4.0), layout="constrained")
    panels = [("height, µm", found.heights_mm), ("height less the plane, µm", found.heights_mm - plane_mm)]
    for axis, (title, values_mm) in zip(figure.subplots(1, 2), panels, strict=True):
        values = _MM_TO_UM * values_mm
        reach = float(np.nanpercentile(np.abs(values), 99))
        mesh = axis.pcolormesh(
            field.x_px, field.y_px, values,
            shading="nearest", cmap="RdBu_r", vmin=-reach, vmax=reach,
        )  # fmt: skip
        figure.colorbar(mesh, ax=axis, shrink=0.85, pad=0.02)
        axis.set_title(title)
        axis.set(
            xlim=(field.x_px[0], field.x_px[-1]),
            ylim=(field.y_px[-1], field.y_px[0]),
            aspect="equal",
            xlabel="x, px",
            ylabel="y, px",
        )
        axis.grid(False)
    return png_uri(figure, dpi=130)


def _waves(angles_deg: Float) -> Float:
    phi = np.radians(angles_deg)
    return np.column_stack([np.ones_like(phi), np.cos(phi), np.sin(phi), np.cos(2 * phi), np.sin(2 * phi)])


def _draw_bars(
    axis: Any, loads_kn: Float, values: Float, std: Float, label: str, style: dict[str, Any]
) -> None:
    if len(values) > LONG:
        # So many bars would lie upon each other: some are drawn, and all values as a line.
        axis.plot(loads_kn, values, color=style["color"], linewidth=0.8, alpha=0.6)
        some = some_of(len(values), _MOST_BARS)
        loads_kn, values, std, style = loads_kn[some], values[some], std[some], style | {"linestyle": "none"}
    axis.errorbar(loads_kn, values, yerr=CONFIDENCE * std, label=label, capsize=2, elinewidth=0.8, **style)


def _loads_kn(steps: list[RunStep]) -> Float:
    return np.array([step.load_n for step in steps]) / 1000.0
