"""Figures of the tension test: strains as in figures 16 to 20 of Helm and Deaner's paper, and the load."""

from typing import Any

import numpy as np

from dic.report.series import CameraSeries, Run, difference
from dic.report.strains import COMPONENTS, XX, YY
from dic.report.style import (
    OFF_AXIS_COLOURS,
    ON_AXIS_COLOUR,
    PAIR_STYLE,
    Kind,
    draw_banded,
    legend_below,
    line_style,
    new_figure,
    svg_uri,
)
from dic.runfile.reader import RunStep
from dic.typing import Float

_SHADE: Any = {"color": "#0072b2", "alpha": 0.07, "linewidth": 0}


def strain_figure(run: Run) -> str:
    """Return a figure of raw, calibrated and corrected εxx and εyy of all cameras at each step.

    The figure corresponds to figures 16 and 17 of Helm and Deaner's paper.
    """
    figure, axes = new_figure(2, 4.4)
    for axis, component in zip(axes, (XX, YY), strict=True):
        for order, series in ordered(run):
            for kind, values in _kinds(series):
                label, style = f"{series.label}, {kind}", line_style(series, order, kind)
                axis.plot(_places(run, series.steps), values[:, component], label=label, **style)
        _label_steps(axis, run)
        axis.set_ylabel(f"{COMPONENTS[component]}, µε")
    legend_below(figure, columns=3)
    return svg_uri(figure)


def difference_figure(run: Run, on_axis: CameraSeries) -> str:
    """Return a figure of the strains of all cameras minus the raw strains of the on-axis camera.

    The figure corresponds to figures 18 to 20 of Helm and Deaner's paper.
    """
    figure, axes = new_figure(3, 4.1)
    for component, axis in enumerate(axes):
        axis.axhline(0.0, color="#999999", linewidth=0.8)
        for order, series in ordered(run):
            for kind, values in _kinds(series):
                if series.on_axis and kind == "raw":
                    continue
                steps, differences = difference(series.steps, values, on_axis)
                label, style = f"{series.label}, {kind}", line_style(series, order, kind)
                axis.plot(_places(run, steps), differences[:, component], label=label, **style)
        _label_steps(axis, run)
        axis.set_ylabel(f"Δ{COMPONENTS[component]}, µε")
    legend_below(figure, columns=3)
    return svg_uri(figure)


def corrected_difference_figure(run: Run, on_axis: CameraSeries) -> str:
    """Return a figure of corrected strains minus the raw strains of the on-axis camera, with 95 % bands.

    The result is an empty text if no step was corrected.
    """
    shown = [
        (s.label, s.steps, s.corrected, s.corrected_std, line_style(s, order, "calibrated"))
        for order, s in ordered(run)
    ]
    if run.pair is not None:
        pair = run.pair
        shown.append((pair.label, pair.steps, pair.corrected, pair.corrected_std, dict(PAIR_STYLE)))
    shown = [line for line in shown if np.isfinite(line[2]).any()]
    if not shown:
        return ""
    figure, axes = new_figure(3, 3.9)
    for component, axis in enumerate(axes):
        axis.axhline(0.0, color="#999999", linewidth=0.8)
        for label, of, values, std, style in shown:
            steps, differences = difference(of, values, on_axis)
            common = {step.index for step in steps}
            known = std[[step.index in common for step in of], component]
            draw_banded(axis, _places(run, steps), differences[:, component], known, label, style)
        _label_steps(axis, run)
        axis.set_ylabel(f"Δ{COMPONENTS[component]} corrected, µε")
    legend_below(figure, columns=3)
    return svg_uri(figure)


def load_figure(run: Run) -> str:
    """Return a figure of the load–displacement curve, and of load and displacement at every step."""
    figure, axes = new_figure(3, 3.3)
    steps = run.steps
    load_kn = np.array([step.load_n for step in steps]) / 1000
    displacement_mm = np.array([step.displacement_mm for step in steps])
    place = _places(run, steps)
    curve = {"color": "#0072b2", "marker": "o"}
    axes[0].plot(displacement_mm, load_kn, **curve)
    axes[0].set(xlabel="crosshead displacement, mm", ylabel="load, kN")
    axes[1].plot(place, load_kn, **curve)
    axes[1].set_ylabel("load, kN")
    axes[2].plot(place, displacement_mm, **(curve | {"color": "#d55e00", "marker": "s"}))
    axes[2].set_ylabel("crosshead displacement, mm")
    for axis in axes[1:]:
        _label_steps(axis, run)
    for axis in axes:
        axis.set_ylim(bottom=min(0.0, axis.get_ylim()[0]))
    axes[0].set_xlim(left=min(0.0, axes[0].get_xlim()[0]))
    return svg_uri(figure)


def stress_figure(run: Run) -> str:
    """Return a figure of the stress of a long run over the strain of each camera along the specimen, %.

    Without the size of the specimen, the figure shows the load. The result is an empty text if the load or
    the strain is not known.
    """
    shown = [(each.label, each.steps, best_strain(each)) for _, each in ordered(run)]
    if run.pair is not None and np.isfinite(run.pair.corrected).any():
        shown.append((run.pair.label, run.pair.steps, run.pair.corrected))
    strains = np.concatenate([values for *_, values in shown])
    loads_n = np.array([step.load_n for step in run.steps])
    if not (np.isfinite(strains).any() and np.isfinite(loads_n).any()):
        return ""
    along = int(np.nanargmax(np.nanmax(np.abs(strains[:, :2]), axis=0, initial=0.0)))
    area_mm2 = run.result.info.width_mm * run.result.info.thickness_mm
    unit, factor = ("stress, MPa", 1.0 / area_mm2) if np.isfinite(area_mm2) else ("load, kN", 1e-3)
    figure, (axis,) = new_figure(1, 4.0)
    for k, (label, steps, values) in enumerate(shown):
        stress = factor * np.array([step.load_n for step in steps])
        colour = ON_AXIS_COLOUR if k == 0 else OFF_AXIS_COLOURS[(k - 1) % len(OFF_AXIS_COLOURS)]
        axis.plot(1e-4 * values[:, along], stress, color=colour, linewidth=1.1, label=label)
    axis.set(xlabel=f"mean {COMPONENTS[along]}, %", ylabel=unit)
    legend_below(figure, columns=3)
    return svg_uri(figure)


def best_strain(series: CameraSeries) -> Float:
    """Return the best mean strain at each step, µε, shape (k, 3): corrected, or else calibrated strain."""
    return np.where(np.isfinite(series.corrected), series.corrected, series.calibrated)


def telling_images(steps: list[RunStep], proof: RunStep | None = None) -> list[tuple[RunStep, str]]:
    """Return the steps of a long run whose maps are shown, each with its caption.

    These are the first step, `proof`, which is the step at the proof strength, the step at the maximum load,
    and the last step.
    """
    loads_n = np.array([step.load_n for step in steps])
    chosen = [(steps[0], "the first image")]
    chosen += [(proof, "the proof strength")] if proof is not None else []
    chosen += [(steps[int(np.nanargmax(loads_n))], "the maximum load")] if np.isfinite(loads_n).any() else []
    chosen.append((steps[-1], "the last image"))
    words: dict[int, list[str]] = {}
    for step, said in chosen:
        words.setdefault(step.index, []).append(said)
    of_index = {step.index: step for step, _ in chosen}
    return [(of_index[index], " and ".join(words[index])) for index in sorted(words)]


def telling_steps(steps: list[RunStep]) -> list[tuple[RunStep, str]]:
    """Return the first step, the last elastic step and the last step, each with its caption.

    Load control ends with the step at which plastic deformation is evident. The load step before it is the
    last elastic step.
    """
    if not steps:
        return []
    loads = [step for step in steps if step.kind == "load"]
    chosen = [(steps[0], "the first step")]
    if len(loads) >= 2 and steps[-1].kind == "displacement":
        chosen.append((loads[-2], "the last step before plastic deformation was evident"))
    chosen.append((steps[-1], "the last step"))
    return list({step.index: (step, words) for step, words in reversed(chosen)}.values())[::-1]


def ordered(run: Run) -> list[tuple[int, CameraSeries]]:
    """Return the cameras of a run in the order of drawing, each with the index of its colour."""
    on_axis = [(0, camera) for camera in run.cameras if camera.on_axis]
    # A single off-axis camera, as in the paper's tension test at 30°, has the colour of a third camera.
    off_axis = list(enumerate(run.off_axis, 2 if len(run.off_axis) == 1 else 0))
    return on_axis + off_axis


def _kinds(series: CameraSeries) -> list[tuple[Kind, Float]]:
    kinds: list[tuple[Kind, Float]] = [("raw", series.raw), ("calibrated", series.calibrated)]
    if np.isfinite(series.corrected).any():
        kinds.append(("corrected", series.corrected))
    return kinds


def _places(run: Run, of: list[RunStep]) -> list[float]:
    """Return the places of steps on the horizontal axis: their ranks, or the times in s of a long run."""
    if _is_over_time(run):
        return [step.time_s for step in of]
    place = {step.index: float(place) for place, step in enumerate(run.steps)}
    return [place[step.index] for step in of]


def _is_over_time(run: Run) -> bool:
    return run.is_long and all(np.isfinite(step.time_s) for step in run.steps)


def _label_steps(axis: Any, run: Run) -> None:
    """Label the horizontal axis with the numbers of the steps, and shade the steps under load control.

    The axis of a long run is the time. Otherwise neighbouring steps have equal distances on the axis, even if
    their numbers have gaps. The numbers have gaps if conditional steps of a test plan were not executed, or
    if a step could not be measured.
    """
    steps, places = run.steps, _places(run, run.steps)
    loads = [place for place, step in zip(places, steps, strict=True) if step.kind == "load"]
    if _is_over_time(run):
        axis.set_xlabel("time, s" + (" (shaded: load control)" if loads else ""))
        if loads:
            axis.axvspan(loads[0], loads[-1], **_SHADE)
        return
    every = max(1, -(-len(steps) // 7))
    axis.set_xticks(range(0, len(steps), every), [str(step.index) for step in steps[::every]])
    axis.set_xlim(-0.6, len(steps) - 0.4)
    axis.set_xlabel("step (shaded: load control)")
    if loads:
        axis.axvspan(loads[0] - 0.5, loads[-1] + 0.5, **_SHADE)
