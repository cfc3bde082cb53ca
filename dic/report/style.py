"""The style of the report's figures, and functions that convert a figure to a data URI."""

from base64 import b64encode
from io import BytesIO
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from dic.report.series import CameraSeries
from dic.report.thinning import thin_lines, thinned
from dic.typing import Float

Kind = Literal["raw", "calibrated", "corrected"]

ON_AXIS_COLOUR = "#4d4d4d"
OFF_AXIS_COLOURS = ("#0072b2", "#e69f00", "#d55e00", "#009e73", "#cc79a7")
"""Colours of curves, chosen by Okabe and Ito so that colour-blind people can distinguish them."""
MARKERS = "osD^vP"
ON_AXIS_MARKERS = "x+1234"
PAIR_STYLE = {"color": "#009e73", "marker": "D", "linestyle": ":", "markersize": 3.5}
"""Line style of the joint results of two cameras."""

CONFIDENCE = 1.96
"""Half of the width of the 95 % interval of a normal distribution, in standard deviations."""


PAGE_WIDTH_IN = 9.0
"""Width of the figures. On paper they are 186 mm wide, so letters of 9 pt are printed with 7.3 pt."""
PICTURE_WIDTH_MM = 190.0
"""Width of pictures with maps, whose letters have 7 pt: about the width of the paper within its margins."""
PICTURE_DPI = 150
_LABELS_LEFT_IN = 0.96
"""Space for the labels of a vertical axis: the axis' name and numbers as long as "−100000"."""
_LABELS_BELOW_IN = 0.46
_RIGHT_IN = 0.1
_TOP_IN = 0.18
_LEGEND_LINE_IN = 0.19
_LEGEND_EDGE_IN = 0.16
_LETTER_IN, _SAMPLE_IN = 0.075, 0.62
"""Width of a letter of a legend, and of the sample of a line with the space around it."""
_MOST_LETTERS = 64
"""So many of the widest letters of 9 pt fit into the page's width beside the sample of a line."""
_LEAST_AXES_IN = 2.0
_MARGIN_PX = 6
# The type is Any, because matplotlib's own type for this dictionary is a long list of all possible keys.
_RC: Any = {
    "font.size": 9,
    "axes.titlesize": 10,
    # If the height of the titles is given, matplotlib need not measure all labels to find it.
    "axes.titley": 1.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e3e3e3",
    "grid.linewidth": 0.7,
    "axes.axisbelow": True,
    "axes.linewidth": 0.8,
    "lines.linewidth": 1.3,
    "lines.markersize": 4.5,
    "legend.frameon": False,
    # Matplotlib adds a random "salt" to the names in an SVG file. A fixed salt makes the files of equal
    # reports equal.
    "svg.hashsalt": "offaxis",
}


def plot_style() -> Any:
    """Return a context manager with matplotlib's settings for the report's figures.

    All figures must be drawn and saved within this context (a `with` statement).
    """
    import matplotlib as mpl

    return mpl.rc_context(_RC)


def new_figure(columns: int, height_in: float = 3.6) -> tuple[Any, Any]:
    """Return a matplotlib figure as wide as the page, and its axes side by side.

    The distances for labels are fixed. Matplotlib's layout engines could find suitable distances, but they
    take as long for this as for drawing the figure.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(PAGE_WIDTH_IN, height_in))
    width_in = (PAGE_WIDTH_IN - _RIGHT_IN) / columns - _LABELS_LEFT_IN
    axes = figure.subplots(1, columns, squeeze=False)[0]
    figure.subplots_adjust(
        left=_LABELS_LEFT_IN / PAGE_WIDTH_IN,
        right=1.0 - _RIGHT_IN / PAGE_WIDTH_IN,
        bottom=_LABELS_BELOW_IN / height_in,
        top=1.0 - _TOP_IN / height_in,
        wspace=_LABELS_LEFT_IN / width_in,
    )
    return figure, axes


def legend_below(figure: Any, columns: int = 4) -> None:
    """Draw one legend for all axes below them, where the legend hides no data.

    The legend has at most the given number of columns, and fewer if its labels are too long for this. Labels
    that are longer than the page is wide are shortened. The figure grows if the legend leaves too little
    height for the axes.
    """
    drawn = [pair for axis in figure.axes for pair in zip(*axis.get_legend_handles_labels(), strict=True)]
    named = {label: handle for handle, label in reversed(drawn)}
    labels = list(dict.fromkeys(label for _, label in drawn))
    shown = [_shortened(label) for label in labels]
    longest_in = _SAMPLE_IN + _LETTER_IN * max(map(len, shown), default=0)
    columns = max(1, min(columns, len(labels), int(PAGE_WIDTH_IN / longest_in)))
    figure.legend(
        [named[label] for label in labels],
        shown,
        loc="lower center",
        ncols=columns,
    )
    legend_in = _LEGEND_EDGE_IN + _LEGEND_LINE_IN * -(-len(labels) // columns)
    bottom_in = _LABELS_BELOW_IN + legend_in
    above_in = (1.0 - figure.subplotpars.top) * figure.get_figheight()
    height_in = max(figure.get_figheight(), bottom_in + _LEAST_AXES_IN + above_in)
    figure.set_figheight(height_in)
    figure.subplots_adjust(bottom=bottom_in / height_in, top=1.0 - above_in / height_in)


def _shortened(label: str) -> str:
    """Return a label without its middle if it is too long for a line, because names differ at their ends."""
    half = _MOST_LETTERS // 2
    return label if len(label) <= _MOST_LETTERS else f"{label[: half - 1]}…{label[-half:]}"


def line_style(series: CameraSeries, order: int, kind: Kind) -> dict[str, Any]:
    """Return the colour, the marker and the line style for the strains of a camera.

    Raw strain is a dashed line, calibrated strain a solid line, corrected strain a broad transparent line.
    Off-axis cameras have open markers for raw strain and filled ones for calibrated strain. The markers of
    on-axis cameras are crosses for both strains.

    `order`: index of the camera among the on-axis or the off-axis cameras of the figure, from 0. `kind`: kind
    of strain: "raw", "calibrated" or "corrected".
    """
    if series.on_axis:
        colour, marker = ON_AXIS_COLOUR, ON_AXIS_MARKERS[order % len(ON_AXIS_MARKERS)]
    else:
        colour, marker = OFF_AXIS_COLOURS[order % len(OFF_AXIS_COLOURS)], MARKERS[order % len(MARKERS)]
    if kind == "corrected":
        return {"color": colour, "linewidth": 4.0, "alpha": 0.4, "solid_capstyle": "butt"}
    return {
        "color": colour,
        "marker": marker,
        "linestyle": "-" if kind == "calibrated" else (0, (4, 2)),
        "markerfacecolor": colour if kind == "calibrated" else "white",
    }


def draw_banded(axis: Any, x: Any, values: Float, std: Float, label: str, style: dict[str, Any]) -> None:
    """Draw values (n,) against x as a line with a band, the 95 % interval of each value.

    Where a value is NaN, the line and the band have a gap. Of thousands of points, those that are seen are
    drawn.
    """
    drawn = thinned(values, std)
    x, values, std = np.asarray(x, np.float64)[drawn], values[drawn], std[drawn]
    axis.plot(x, values, label=label, **style)
    reach = CONFIDENCE * std
    axis.fill_between(x, values - reach, values + reach, color=style["color"], alpha=0.15, linewidth=0)


def svg_uri(figure: Any) -> str:
    """Return a figure as a data URI in SVG format, for figures that consist of lines.

    The figure is transparent, so that it does not hide a watermark of the page. Of lines with thousands of
    points, those that are seen are drawn.
    """
    thin_lines(figure)
    buffer = BytesIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None}, transparent=True)
    return "data:image/svg+xml;base64," + b64encode(buffer.getvalue()).decode()


def png_uri(figure: Any, dpi: int = 100) -> str:
    """Return a figure as a data URI in PNG format, for figures with images or many marks."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure.set_dpi(dpi)
    canvas: Any = FigureCanvasAgg(figure)
    canvas.draw()
    return pixels_uri(np.asarray(canvas.buffer_rgba())[..., :3])


def pixels_uri(pixels: NDArray[np.uint8], *, all_colours: bool = False) -> str:
    """Return a picture (height, width, 3) as a data URI in PNG format.

    The picture has narrow margins, and 256 colours unless `all_colours` is true.
    """
    from PIL import Image

    marked = (pixels != 255).any(axis=2)
    rows, columns = np.flatnonzero(marked.any(axis=1)), np.flatnonzero(marked.any(axis=0))
    top, left = max(0, rows[0] - _MARGIN_PX), max(0, columns[0] - _MARGIN_PX)
    drawn = np.ascontiguousarray(pixels[top : rows[-1] + _MARGIN_PX, left : columns[-1] + _MARGIN_PX])
    buffer = BytesIO()
    picture = Image.fromarray(drawn)
    if not all_colours:
        picture = picture.quantize(256, dither=Image.Dither.NONE)
    picture.save(buffer, format="png")
    return "data:image/png;base64," + b64encode(buffer.getvalue()).decode()


def watermark_uri(word: str) -> str:
    """Return a picture of a faint diagonal word as a data URI; the page repeats it as a watermark."""
    svg = (
        '<svg xmlns="http://www.w3.org/2000/svg" width="640" height="460">'
        '<text x="320" y="250" transform="rotate(-30 320 230)" text-anchor="middle" fill="#b00020" '
        'fill-opacity="0.08" font-family="sans-serif" font-weight="bold" font-size="84" '
        f'letter-spacing="8">{word}</text></svg>'
    )
    return "data:image/svg+xml;base64," + b64encode(svg.encode()).decode()
