"""Figures of the rotation test: the paper's figures 21 to 26, all runs together."""

from collections.abc import Sequence

from dic.report.series import COMPONENTS, CameraSeries, Run
from dic.report.style import legend_below, line_style, new_figure, svg_uri
from dic.run_file import RunStep

_NEAR_DEG = 15.0
_PARTS_DEG = (5.0, 15.0, 45.0, 90.0)


def strain_figure(runs: Sequence[Run], calibrated: bool) -> str:
    """Return εxx, εyy and εxy against the stage's angle, for every camera of every run.

    Parameters
    ----------
    runs : sequence of Run
    calibrated : bool
        Calibrated strain (figures 24 to 26), or raw (figures 21 to 23).
    """
    from matplotlib.ticker import MultipleLocator

    figure, axes = new_figure(3, 4.0)
    largest_deg = max(abs(step.angle_deg) for run in runs for step in run.steps)
    ticks_deg = next((part for part in _PARTS_DEG if 6 * part >= largest_deg), _PARTS_DEG[-1])
    for component, axis in enumerate(axes):
        axis.axhline(0.0, color="#999999", linewidth=0.8)
        for order, series in _ordered(runs):
            suffix = f", run {series.run}" if len(runs) > 1 else ""
            values = series.calibrated if calibrated else series.raw
            axis.plot(
                series.angles_deg,
                values[:, component],
                label=series.label + suffix,
                **line_style(series, order, calibrated),
            )
        axis.xaxis.set_major_locator(MultipleLocator(ticks_deg))
        axis.set_xlabel("rotation of the stage, °")
        axis.set_ylabel(f"{COMPONENTS[component]} {'calibrated' if calibrated else 'raw'}, µε")
    legend_below(figure, axes[0], columns=3)
    return svg_uri(figure)


def telling_steps(steps: list[RunStep]) -> list[tuple[RunStep, str]]:
    """Return the steps nearest 90° and 180°, or the last one if the run did not come so far."""
    chosen = []
    for angle_deg in (90.0, 180.0):
        near = [step for step in steps if abs(step.angle_deg - angle_deg) <= _NEAR_DEG]
        if near:
            step = min(near, key=lambda step: abs(step.angle_deg - angle_deg))
            chosen.append((step, f"the step at {step.angle_deg:.1f}°"))
    return chosen or [(step, "the last step") for step in steps[-1:]]


def _ordered(runs: Sequence[Run]) -> list[tuple[int, CameraSeries]]:
    on_axis = [run.on_axis for run in runs if run.on_axis is not None]
    off_axis = [camera for run in runs for camera in run.off_axis]
    # The largest angle is drawn last, so that it does not lie beneath the others.
    off_axis.sort(key=lambda camera: camera.off_axis_deg or 0.0)
    return [*enumerate(on_axis), *enumerate(off_axis)]
