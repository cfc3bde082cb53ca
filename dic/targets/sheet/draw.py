"""The sheet that is printed: a target with a title, and two rulers with which the print is checked."""

from pathlib import Path
from typing import Any

import numpy as np

from dic.errors import CalibrationError
from dic.files.writing import write_figure
from dic.targets.kinds import Target, require_target
from dic.targets.sheet.shapes import Shapes
from dic.typing import PathLike

_INCH_MM = 25.4
# Width and height of upright paper sheets, mm, the smallest first.
_PAPERS_MM = ((210.0, 297.0), (297.0, 420.0))
# Free space around the target, with the rulers and the title. Printers leave 5 mm of the paper white.
_MARGIN_MM = 20.0
_RULER_FROM_TARGET_MM = 8.0
_TICKS_MM = ((10, 3.0), (5, 2.2), (1, 1.4))
_SUFFIXES = (".pdf", ".png", ".svg")
_DPI = (72.0, 2400.0)
_MOST_PX = 400_000_000
_LONGEST_MM = 2000.0
"""Largest length of a sheet, because no plotter prints longer sheets."""


def draw_target(target: Target, path: PathLike, dpi: float = 600.0) -> tuple[float, float]:
    """Draw a calibration target to a file for printing at its true size.

    PDF and SVG files are exact, because they consist of lines and areas. A PNG file consists of pixels; the
    edges of the target have intermediate grey levels, so that they are exact to about a hundredth of a pixel.
    The target lies in the middle of the smallest sheet that has room for the target: A4 or A3, upright or
    landscape, or a larger sheet. One ruler below the target and one beside the target show whether the print
    has its true size.

    Parameters
    ----------
    target : Target
        Kind and size of the target.
    path : path
        The file to be written. The suffix, .pdf, .svg or .png, is its format.
    dpi : float
        Resolution of a PNG file in pixels per inch, 72 to 2400. The resolution is written into the file.

    Returns
    -------
    tuple of float
        Width and height of the sheet, mm.

    Raises
    ------
    CalibrationError
        If the target is not possible, the format is unknown, or the picture would be too large.
    OSError
        If the file cannot be written.
    """
    require_target(target, "target", "give dic.targets.DotTarget((14, 10), pitch_mm=5)")
    _require_drawable(target)
    suffix = Path(path).suffix.lower()
    if suffix not in _SUFFIXES:
        expected, got = f"a file whose name ends in {', '.join(_SUFFIXES)}", f"{Path(path).name!r}"
        raise CalibrationError("target", "draw", expected, got, "name a file such as target.pdf")
    if not _DPI[0] <= dpi <= _DPI[1]:
        raise CalibrationError("target", "draw", "72 to 2400 pixels per inch", f"{dpi:g}", "give --dpi 600")
    shapes = target.shapes()
    sheet_mm = _sheet_mm(shapes)
    pixels = sheet_mm[0] * sheet_mm[1] * (dpi / _INCH_MM) ** 2
    if suffix == ".png" and pixels > _MOST_PX:
        got = f"{pixels / 1e6:.0f} million on {sheet_mm[0]:.0f} × {sheet_mm[1]:.0f} mm"
        remedy = "lower --dpi, or write a PDF file"
        raise CalibrationError("target", "draw", f"at most {_MOST_PX / 1e6:.0f} million pixels", got, remedy)
    write_figure(_figure(target, shapes, sheet_mm, dpi), path, dpi, suffix[1:])
    return sheet_mm


def _require_drawable(target: Target) -> None:
    """Raise an error if the target is longer than any sheet, or has too few lines to be found again."""
    counts, fewest = target.counts, target.fewest
    longest_mm = max(counts) * target.pitch_mm
    if longest_mm > _LONGEST_MM:
        remedy = "give a smaller --pitch-mm or --count"
        expected = f"a target of at most {_LONGEST_MM:.0f} mm"
        raise CalibrationError("target", "draw", expected, f"{longest_mm:.0f} mm", remedy)
    if min(counts) < fewest:
        expected = f"at least {fewest} {target.counted} along X and along Y"
        raise CalibrationError("target", "draw", expected, f"{counts[0]} × {counts[1]}", "give --count 21x21")


def _sheet_mm(shapes: Shapes) -> tuple[float, float]:
    """Return the width and the height of the smallest sheet that the target fits on."""
    width, height = (size + 2 * _MARGIN_MM for size in shapes.size_mm())
    for short, long in _PAPERS_MM:
        for sheet in ((short, long), (long, short)):
            if width <= sheet[0] and height <= sheet[1]:
                return sheet
    return float(np.ceil(width)), float(np.ceil(height))


def _figure(target: Target, shapes: Shapes, sheet_mm: tuple[float, float], dpi: float) -> Any:
    """Return the sheet as a matplotlib figure; its axes are in mm, with the origin at the target's centre."""
    from matplotlib.collections import PatchCollection
    from matplotlib.figure import Figure
    from matplotlib.patches import Circle, Patch, Rectangle

    # Make the size a whole number of pixels. Otherwise matplotlib would round the size and stretch the
    # target.
    inches = tuple(round(size / _INCH_MM * dpi) / dpi for size in sheet_mm)
    figure = Figure(figsize=(inches[0], inches[1]), facecolor="white")
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_axis_off()
    half = [size * _INCH_MM / 2 for size in inches]
    axes.set_xlim(-half[0], half[0])
    axes.set_ylim(-half[1], half[1])
    patches: dict[str, list[Patch]] = {
        "black": [
            *(Rectangle((left, low), width, height) for left, low, width, height in shapes.rectangles),
            *(Circle((x, y), radius) for x, y, radius in shapes.discs),
        ],
        "white": [Circle((x, y), radius) for x, y, radius in shapes.holes],
    }
    for order, (colour, every) in enumerate(patches.items()):
        drawn = PatchCollection(every, facecolor=colour, edgecolor="none", linewidth=0, zorder=order)
        # Otherwise matplotlib would move the edges to whole pixels.
        drawn.set_snap(False)
        axes.add_collection(drawn, autolim=False)
    _draw_rulers(axes, shapes)
    title = f"offaxis   {target.description}   Check that both rulers measure what they say."
    axes.text(0, shapes.size_mm()[1] / 2 + _RULER_FROM_TARGET_MM, title, ha="center", fontsize=7)
    return figure


def _draw_rulers(axes: Any, shapes: Shapes) -> None:
    """Draw a ruler below and one at the left of the target; their lengths are multiples of 10 mm."""
    width, height = shapes.size_mm()
    for along_x, size, beside in ((True, width, height), (False, height, width)):
        length = max(10, int(size // 10) * 10)
        base = -beside / 2 - _RULER_FROM_TARGET_MM
        ticks = [(k, next(tick for step, tick in _TICKS_MM if k % step == 0)) for k in range(length + 1)]
        lines = [((k - length / 2, base), (k - length / 2, base - tick)) for k, tick in ticks]
        lines.append(((-length / 2, base), (length / 2, base)))
        for start, end in lines:
            xs, ys = zip(start, end, strict=True)
            axes.plot(
                *((xs, ys) if along_x else (ys, xs)), color="black", linewidth=0.3, solid_capstyle="butt"
            )
        for k in range(0, length + 1, 10 if length <= 100 else 50):
            place = (k - length / 2, base - 4.0)
            text = f"{k} mm" if k == 0 else f"{k}"
            x, y = place if along_x else place[::-1]
            turned = {} if along_x else {"rotation": 90}
            axes.text(x, y, text, ha="center", va="top" if along_x else "center", fontsize=6, **turned)
