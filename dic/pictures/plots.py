"""Size, style and colours of pictures of lines, for a screen and for print."""

from typing import Any

import numpy as np

from dic.files.writing import write_figure
from dic.pictures.marks import MM_PER_IN
from dic.pictures.settings import PlotSettings, require_format
from dic.typing import Float, PathLike

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")
"""Colours of Okabe and Ito, which colour-blind people can distinguish, without yellow, which is pale on
white.
"""
MARKERS = "os^Dv"
DASHES = {"corrected": "-", "calibrated": "--", "raw": ":"}
"""Dashes of a line for each kind of values."""
HALF_BAND = 1.959964
"""Half width of the 95 % interval of a normal distribution, in standard deviations."""
BAND_TEXT = "band: 95 % interval (± 1.96 standard deviations)"

_LABELS_LEFT_MM, _LABELS_BELOW_MM, _TITLE_MM, _EDGE_MM, _LEGEND_LINE_MM = 17.0, 9.5, 6.0, 3.0, 4.0
"""Space for an axis' name and numbers, for the title of a panel, at an edge, and for a line of the legend."""
_MICRO_BELOW = 0.01
"""Strains are drawn in µε if all are below this bound, otherwise in %."""
_RC: Any = {
    "font.size": 8,
    "axes.titlesize": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e3e3e3",
    "grid.linewidth": 0.6,
    "axes.linewidth": 0.8,
    "lines.linewidth": 1.1,
    "lines.markersize": 3.0,
    "legend.frameon": False,
    "legend.fontsize": 7.5,
    "legend.title_fontsize": 7,
    # Text stays text, which other programs can search and edit.
    "svg.fonttype": "none",
    "pdf.fonttype": 42,
    "svg.hashsalt": "offaxis",
}


def plot_style() -> Any:
    """Return a context manager with matplotlib's settings; draw and save pictures within it."""
    import matplotlib as mpl

    return mpl.rc_context(_RC)


def new_plot(settings: PlotSettings, panels: int = 1) -> tuple[Any, Any]:
    """Return a matplotlib figure, and the axes of its panels one below the other, for `legend_below`."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(settings.width_mm / MM_PER_IN, panels * settings.height_mm / MM_PER_IN))
    return figure, figure.subplots(panels, 1, squeeze=False)[:, 0]


def write_plot(figure: Any, path: PathLike, settings: PlotSettings) -> None:
    """Write a figure in the format that the ending of the name gives; call it within `plot_style`."""
    write_figure(figure, path, settings.dpi, require_format(path))


def strain_unit(values: Float) -> tuple[str, float]:
    """Return the unit in which strains (n,) are drawn, "µε" or "%", and its number in a strain of 1."""
    known = np.abs(values[np.isfinite(values)])
    small = not known.size or float(known.max()) < _MICRO_BELOW
    return ("µε", 1e6) if small else ("%", 100.0)


def draw_banded(axis: Any, x: Float, values: Float, std: Float, label: str, style: dict[str, Any]) -> None:
    """Draw values (n,) against x with the 95 % interval of each value as a band.

    Line and band have a gap where a value is NaN. A single value between two gaps is drawn as a marker with
    an error bar.
    """
    axis.plot(x, values, label=label, **style)
    reach = HALF_BAND * std
    colour = style["color"]
    axis.fill_between(x, values - reach, values + reach, color=colour, alpha=0.18, linewidth=0)
    alone = np.isfinite(values) & ~_has_neighbour(values)
    if alone.any():
        axis.errorbar(x[alone], values[alone], reach[alone], color=colour, fmt="none", elinewidth=0.8)


def _has_neighbour(values: Float) -> Any:
    known = np.concatenate([[False], np.isfinite(values), [False]])
    return known[:-2] | known[2:]


def legend_below(figure: Any, note: str) -> None:
    """Draw one legend for all panels below them, with a note as its title, and give all parts their places.

    The distances for labels are fixed: a layout engine of matplotlib takes as long as drawing the figure.
    """
    named: dict[str, Any] = {}
    for axis in figure.axes:
        named |= dict(zip(*reversed(axis.get_legend_handles_labels()), strict=True))
    longest = max(map(len, named), default=1)
    width_in = figure.get_figwidth()
    columns = max(1, min(len(named), int(width_in * MM_PER_IN / (12.0 + 1.4 * longest))))
    figure.legend(
        list(named.values()),
        list(named),
        loc="lower center",
        ncols=columns,
        title=note,
        handlelength=3.0,
    )
    width_mm, height_mm = width_in * MM_PER_IN, figure.get_figheight() * MM_PER_IN
    number, rows = len(figure.axes), -(-len(named) // columns)
    above_mm = _TITLE_MM if any(axis.get_title() for axis in figure.axes) else _EDGE_MM
    below_mm = _LABELS_BELOW_MM + _LEGEND_LINE_MM * (rows + 1) + _EDGE_MM
    between_mm = _LABELS_BELOW_MM + above_mm
    panel_mm = (height_mm - above_mm - below_mm - (number - 1) * between_mm) / number
    figure.subplots_adjust(
        left=_LABELS_LEFT_MM / width_mm,
        right=1.0 - _EDGE_MM / width_mm,
        bottom=below_mm / height_mm,
        top=max(1.0 - above_mm / height_mm, (below_mm + 1.0) / height_mm),
        hspace=between_mm / max(panel_mm, 1.0),
    )
