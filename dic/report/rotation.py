"""Figures of the rotation test, like figures 21 to 26 of Helm and Deaner, for all rotation runs together."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from dic.report.series import CameraSeries, Run
from dic.report.strains import COMPONENTS
from dic.report.style import Kind, draw_banded, legend_below, line_style, new_figure, svg_uri
from dic.runfile.reader import RunStep
from dic.typing import Float

_NEAR_DEG = 15.0
_PARTS_DEG = (5.0, 15.0, 45.0, 90.0)
_GUIDE = 20.0


def strain_figure(runs: Sequence[Run], kind: Kind) -> str:
    """Return a figure of εxx, εyy and εxy against the stage's angle, for every camera of every run.

    The result is a data URI, or an empty text if no camera has strains of the given kind.

    `kind`: kind of strain: "raw" (figures 21 to 23 of Helm and Deaner), "calibrated" (figures 24 to 26), or
    "corrected". The figure of corrected strain shows a band around each curve, the 95 % interval. The figure
    of corrected strain also has lines at ±20 µε as a guide, because its three panels have different scales.
    """
    shown = [(o, s) for o, s in ordered(runs) if np.isfinite(_strains(s, kind)).any()]
    if not shown:
        return ""
    figure, axes = new_figure(3, 4.0)
    for component, axis in enumerate(axes):
        axis.axhline(0.0, color="#999999", linewidth=0.8)
        for order, series in shown:
            label = series.label + (f", run {series.run}" if len(runs) > 1 else "")
            style = line_style(series, order, "raw" if kind == "raw" else "calibrated")
            values = _strains(series, kind)[:, component]
            if kind == "corrected":
                std = series.corrected_std[:, component]
                draw_banded(axis, series.angles_deg, values, std, label, style)
            else:
                axis.plot(series.angles_deg, values, label=label, **style)
        if kind == "corrected":
            for guide in (-_GUIDE, _GUIDE):
                axis.axhline(guide, color="#999999", linewidth=0.8, linestyle=(0, (1, 2)))
        label_angles(axis, runs)
        axis.set_ylabel(f"{COMPONENTS[component]} {kind}, µε")
    legend_below(figure, columns=3)
    return svg_uri(figure)


def label_angles(axis: Any, runs: Sequence[Run]) -> None:
    """Label the horizontal axis with the stage's rotation, and set its ticks at round angles."""
    from matplotlib.ticker import MultipleLocator

    largest_deg = max(abs(step.angle_deg) for run in runs for step in run.steps)
    ticks_deg = next((part for part in _PARTS_DEG if 6 * part >= largest_deg), _PARTS_DEG[-1])
    axis.xaxis.set_major_locator(MultipleLocator(ticks_deg))
    axis.set_xlabel("rotation of the stage, °")


def not_corrected(runs: Sequence[Run]) -> list[str]:
    """Return one sentence for each camera and each reason why steps of the camera were not corrected."""
    return [
        f"run {series.run}, {series.label}: {reason}"
        for run in runs
        for series in run.cameras
        for reason in sorted({r for r in series.declined if r is not None})
    ]


def _strains(series: CameraSeries, kind: Kind) -> Float:
    return {"raw": series.raw, "calibrated": series.calibrated, "corrected": series.corrected}[kind]


def telling_steps(steps: list[RunStep]) -> list[tuple[RunStep, str]]:
    """Return the steps nearest to 90° and 180°, each with its caption.

    Only steps within 15° of 90° or 180° are returned. If no step is within 15° of 90° or 180°, the result is
    the last step.
    """
    chosen = []
    for angle_deg in (90.0, 180.0):
        near = [step for step in steps if abs(step.angle_deg - angle_deg) <= _NEAR_DEG]
        if near:
            step = min(near, key=lambda step: abs(step.angle_deg - angle_deg))
            chosen.append((step, f"the step at {step.angle_deg:.1f}°"))
    return chosen or [(step, "the last step") for step in steps[-1:]]


def ordered(runs: Sequence[Run]) -> list[tuple[int, CameraSeries]]:
    """Return the cameras of all runs in the order of drawing, each with the index of its colour."""
    on_axis = [run.on_axis for run in runs if run.on_axis is not None]
    off_axis = [camera for run in runs for camera in run.off_axis]
    # Draw the camera with the largest off-axis angle last, so that its curve is on top of the others.
    off_axis.sort(key=lambda camera: camera.off_axis_deg)
    return [*enumerate(on_axis), *enumerate(off_axis)]
