"""What a person sees of a run while a phase without interruption goes on, as lines of a terminal."""

import math
import os
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from typing import TYPE_CHECKING

from rig import EngineStatus, RigReading
from rig.commands.char_plot import LEAST_ROWS, name_of_curve, plot
from rig.live.values import GaugeValue, LiveNow, LiveReading
from rig.news.images_now import ImageNow

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, RenderableType, RenderResult

PLOT_ROWS_MAX = 18
_PLOT_COLUMNS_MAX = 120
OLD_S = 1.0
"""The age in s from which a value of a gauge is said to be old."""
_STYLES = ("cyan", "yellow", "green", "magenta", "blue", "white")
_BAD = "bold red"
_PLAIN_TERMINALS = ("linux",)
"""Types of terminals whose fonts have no Braille characters, such as the system's own console."""


@dataclass(frozen=True)
class RunView:
    """What is shown of a run.

    Attributes
    ----------
    status : EngineStatus
    running_s : float
        The time since the first reading; NaN before it.
    images : mapping of str to ImageNow
        Light and focus of the newest image of each camera.
    """

    status: EngineStatus
    running_s: float = math.nan
    images: Mapping[str, ImageNow] = field(default_factory=dict)

    def lines(self) -> list[tuple[str, bool]]:
        """Return all lines but the plot, and whether each of them tells of something bad."""
        live, told = self.status.live, []
        if live is not None:
            told += gauge_lines(live, self.status.reading)
            told += [(values_line(self.status.reading, self.running_s), False)]
            told += [(frames_line(live), live.lost > 0)]
        told += [(image_line(name, each), False) for name, each in self.images.items()]
        return [line for line in told if line[0]]

    def sentence(self) -> str:
        """Return one line for an output that is no terminal; empty without a phase that it can tell of."""
        live = self.status.live
        if live is None:
            return ""
        gauges = [line for line, _ in gauge_lines(live, self.status.reading, marked=False)]
        values = values_line(self.status.reading, self.running_s)
        return ", ".join(filter(None, [values, *gauges, frames_line(live)]))


def gauge_lines(live: LiveNow, reading: RigReading | None, *, marked: bool = True) -> list[tuple[str, bool]]:
    """Return a line with the newest value of each gauge, and whether the value is not valid.

    With `marked`, each of several gauges has the mark of its curve.
    """
    newest = live.reading
    if newest is None:
        return [("no value of a gauge yet", False)]
    old = _age(newest, reading)
    numbers = {name: k for k, name in enumerate(live.curves)}
    told = []
    for name, value in newest.gauges.items():
        mark = f"{name_of_curve(numbers[name])} " if marked and len(numbers) > 1 and name in numbers else ""
        told.append((f"{mark}{name} {gauge_value(value)}{old}", not value.valid or bool(old)))
    return told


def gauge_value(value: GaugeValue) -> str:
    """Return the value of a gauge with its standard deviation, or why it is not valid."""
    known = f"{100 * value.strain:.4f} ± {100 * value.std:.4f} %" if math.isfinite(value.strain) else ""
    how = ", ".join(filter(None, [known, value.kind, value.camera]))
    return how if value.valid else f"NOT VALID: {value.reason or 'no reason is known'} ({how})"


def _age(newest: LiveReading, reading: RigReading | None) -> str:
    age_s = math.nan if reading is None else reading.time_s - newest.time_s
    return f", {age_s:.1f} s OLD" if age_s > OLD_S else ""


def values_line(reading: RigReading | None, running_s: float) -> str:
    """Return the time, the load and the displacement."""
    shown = [] if math.isnan(running_s) else [f"{running_s:.1f} s"]
    if reading is not None:
        names = {"N": ("load", ".1f"), "mm": ("displacement", ".4f"), "deg": ("angle", ".2f")}
        shown += [
            f"{names[unit][0]} {value:{names[unit][1]}} {unit}" for unit, value in reading.by_unit().items()
        ]
    return ", ".join(shown)


def frames_line(live: LiveNow) -> str:
    """Return the frames recorded, lost and not measured, and the rates."""
    lost = f"{live.lost} LOST" if live.lost else "0 lost"
    parts = [f"{live.recorded} frames recorded{_rate(live.frames_per_s)}", lost]
    if live.reading is not None:
        parts += [f"{live.left_out} not measured", f"gauges{_rate(live.values_per_s) or ' -'}"]
    return ", ".join(parts)


def _rate(per_s: float) -> str:
    return "" if math.isnan(per_s) else f" {per_s:.3g}/s"


def image_line(name: str, image: ImageNow) -> str:
    """Return light and focus of the newest image of a camera."""
    sharp = "" if math.isnan(image.sharpness) else f", sharpness {image.sharpness:.0%} of the reference"
    return f"{name}: brightness {image.brightness:.0%}, saturated {image.saturated:.2%}{sharp}"


@dataclass(frozen=True)
class Panel:
    """The lines and the plot at the bottom of a terminal, for Rich.

    Attributes
    ----------
    view : RunView
    lines : sequence of (str, bool)
        Lines that follow those of the view, and whether each tells of something bad.
    below : RenderableType
        What stands in the last line.
    """

    view: RunView
    lines: Sequence[tuple[str, bool]]
    below: "RenderableType"

    def __rich_console__(self, console: "Console", options: "ConsoleOptions") -> "RenderResult":
        """Draw the plot as high as the terminal has room, and the lines."""
        from rich.text import Text

        columns = options.max_width
        every = [*self.view.lines(), *self.lines]
        broken = [(part, bad) for line, bad in every for part in broken_lines(line, columns)]
        # with room for broken lines, so that the plot seldom changes its height
        rows = min(PLOT_ROWS_MAX, console.height - max(len(broken), len(every) + 2) - 2)
        if self.view.status.live is not None and rows >= LEAST_ROWS:
            yield from self._plot(console, self.view.status.live, columns, rows)
        for part, bad in broken:
            yield Text(part, _BAD if bad else "", no_wrap=True, overflow="ellipsis")
        yield self.below

    def _plot(self, console: "Console", live: LiveNow, columns: int, rows: int) -> "RenderResult":
        from rich.text import Text

        curves = {
            name: [(100.0 * strain, force) for strain, force in tuple(points)]
            for name, points in live.curves.items()
        }
        titles = "strain, %", "stress, MPa" if live.unit == "MPa" else f"load, {live.unit}"
        braille = shows_braille(console)
        for cells in plot(curves, min(columns - 1, _PLOT_COLUMNS_MAX), rows, titles, braille=braille):
            line = Text(no_wrap=True, overflow="crop")
            for curve, same in groupby(cells, lambda cell: cell[1]):
                style = _STYLES[curve % len(_STYLES)] if curve >= 0 else ""
                line.append("".join(sign for sign, _ in same), style)
            yield line


def shows_braille(console: "Console") -> bool:
    """Return whether a terminal shows Braille characters."""
    return console.encoding.lower().startswith("utf") and os.environ.get("TERM", "") not in _PLAIN_TERMINALS


def broken_lines(line: str, columns: int) -> list[str]:
    """Return a line as lines that a terminal with this width shows whole."""
    return textwrap.wrap(line, max(20, columns), subsequent_indent="  ", break_long_words=True)
