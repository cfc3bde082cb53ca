"""A picture of a study: noise of local strain against spatial resolution."""

from typing import Any

from dic.errors import require_kind
from dic.files.writing import write_figure
from dic.study.result import Study, root_of
from dic.typing import PathLike

_SHAPES = {"affine": ("o", "#0072b2"), "quadratic": ("s", "#d55e00")}
"""Marker and colour of each shape function; the colours of Okabe and Ito suit colour-blind people."""
_BEST, _FRONT = "#000000", "0.45"


def draw_study(study: Study) -> Any:
    """Return a matplotlib figure: noise against resolution, and total error against resolution.

    Each shape function has its own marker, so that the figure can be read without colours.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13, 5.6), layout="constrained")
    by_noise, by_error = figure.subplots(1, 2)
    best = study.recommended
    for axes, value in (
        (by_noise, lambda each: root_of(each.strain_noise)),
        (by_error, lambda each: each.strain_error),
    ):
        for shape, (sign, colour) in _SHAPES.items():
            some = [each for each in study.settings if each.correlation.shape == shape]
            if some:
                places = [e.resolution_px for e in some], [1e6 * value(e) for e in some]
                axes.plot(*places, sign, color=colour, markersize=4.5, alpha=0.65, label=shape)
        place = best.resolution_px, 1e6 * value(best)
        axes.plot(*place, "*", color=_BEST, markersize=17, markeredgecolor="white", label="recommended")
        axes.set(xscale="log", yscale="log", xlabel="period of strain that keeps 90 % of its amplitude, px")
        axes.grid(alpha=0.3, which="both")
    front = study.front
    line = [e.resolution_px for e in front], [1e6 * root_of(e.strain_noise) for e in front]
    by_noise.plot(*line, color=_FRONT, linewidth=1.2, zorder=0, label="Pareto front")
    wave = study.wave
    by_error.axvline(wave.period_px, color=_FRONT, linestyle="--", linewidth=1.2, label="assumed period")
    by_noise.set(ylabel="noise of local strain, µε")
    by_error.set(ylabel="total error of local strain, µε")
    settings = best.correlation
    by_noise.set_title(
        f"recommended: {settings.shape}, subset {settings.subset_px} px, step {settings.step_px} px,"
        f" window {best.strain.window_points}",
        fontsize=10,
    )
    by_error.set_title(
        f"assumed: strain ±{1e6 * wave.strain_amplitude:.0f} µε of period {wave.period_px:.0f} px",
        fontsize=10,
    )
    for axes in (by_noise, by_error):
        axes.legend(fontsize=9)
        _plain_numbers(axes)
    return figure


def plot_study(study: Study, path: PathLike) -> None:
    """Write the figure of a study as a PNG file.

    Parameters
    ----------
    study : Study
    path : path
    """
    require_kind("study", study, Study, "study the settings first: dic.study_settings(image)")
    write_figure(draw_study(study), path, 100, "png")


def _plain_numbers(axes: Any) -> None:
    """Label a logarithmic axis with 100 instead of 10²; label a short axis also between powers of ten."""
    from matplotlib.ticker import FuncFormatter, LogLocator

    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(FuncFormatter(lambda value, _: ""))
