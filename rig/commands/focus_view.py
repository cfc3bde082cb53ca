"""The figures of the cameras while a rig is set up, as lines of a terminal."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rig.commands.focus_figures import MIDDLE_PX, SlowFigures
from rig.commands.focusing import CameraFocus, Focus, ImageFigures
from rig.commands.live_view import broken_lines

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, RenderResult
    from rich.table import Table
    from rich.text import Text

_BAR_WIDTH = 40
_FINDINGS = 2
_BAD = "bold red"
NO_IMAGE = "NO IMAGE"
KEYS = "s: save images, r: forget the best, q: end"


def light_line(figures: ImageFigures) -> str:
    """Return the grey levels, the saturated share and the rate."""
    rate = "" if math.isnan(figures.rate_hz) else f", {figures.rate_hz:.3g} images/s"
    frozen = ", FROZEN PICTURE" if figures.frozen else ""
    return (
        f"grey {figures.darkest} to {figures.brightest} of {figures.full}, mean {figures.mean:.0f}, "
        f"saturated {figures.saturated:.2%}{rate}{frozen}"
    )


def sharpness_text(figures: ImageFigures) -> str:
    """Return the sharpness, and how it compares with the best one."""
    if math.isnan(figures.sharpness):
        return "sharpness unknown: the picture is black or too small"
    share = figures.sharpness / figures.best if figures.best > 0.0 else 1.0
    compared = "" if math.isnan(figures.rate_hz) else f", {share:.0%} of the best"
    return f"sharpness {figures.sharpness:.4f}{compared}"


def slow_lines(slow: SlowFigures, now_s: float | None) -> list[str]:
    """Return the speckles or the grid, with their age at `now_s` on the computer's clock if it is given."""
    age = "" if now_s is None else f" ({now_s - slow.taken_s:.1f} s old)"
    lines = []
    if slow.grid is not None:
        grid = slow.grid
        residual = f"{grid.rms_px:.3f} px rms, {grid.max_px:.3f} px at most"
        lines.append(f"grid of {grid.points} points, residual {residual}{age}")
    if slow.quality:
        place = f"middle {MIDDLE_PX} px: " if slow.in_middle else ""
        lines.append(f"{place}{_speckles(slow.quality)}{age}")
    if slow.no_grid:
        lines.append(f"no grid: {slow.no_grid}")
    return lines


def _speckles(quality: dict[str, Any]) -> str:
    x, y = quality.get("speckle_x_px"), quality.get("speckle_y_px")
    parts = [f"speckles {x:.1f} x {y:.1f} px" if x is not None and y is not None else "no speckles"]
    named = (("contrast", "contrast", ""), ("noise", "noise", ""), ("blur_px", "blur", " px"))
    parts += [f"{name} {quality[key]:.3g}{unit}" for key, name, unit in named if quality.get(key) is not None]
    return ", ".join(parts)


def camera_lines(camera: CameraFocus, now_s: float | None = None) -> list[str]:
    """Return all that is known of a camera; first what is wrong with its images."""
    lines = [f"{NO_IMAGE}: {camera.trouble}"] if camera.trouble else []
    if camera.figures is not None:
        lines += [sharpness_text(camera.figures), light_line(camera.figures)]
    if camera.slow is not None:
        lines += slow_lines(camera.slow, now_s)
    return lines or ["no image yet"]


def sentence(focus: Focus, now_s: float) -> str:
    """Return one line with all cameras, for an output that is no terminal."""
    return "; ".join(f"{each.camera_name}: {', '.join(camera_lines(each, now_s))}" for each in focus.cameras)


def problems(focus: Focus) -> list[str]:
    """Return a sentence for each figure that is not good."""
    return [
        f"cameras.{each.camera_name}: {finding}"
        for each in focus.cameras
        if each.slow is not None
        for finding in each.slow.findings
    ]


@dataclass(frozen=True)
class FocusPanel:
    """What stands at the bottom of a terminal, for Rich.

    Attributes
    ----------
    focus : Focus
    now_s : float
        The time on the computer's clock.
    note : str
        What the last key has done.
    keys : bool
        True if keys can be read.
    """

    focus: Focus
    now_s: float
    note: str
    keys: bool

    def __rich_console__(self, console: "Console", options: "ConsoleOptions") -> "RenderResult":
        """Draw the lines of all cameras, each with a bar for the sharpness."""
        for camera in self.focus.cameras:
            yield _line(camera.camera_name, "bold")
            if camera.figures is not None:
                yield _bar(camera.figures)
            for line in camera_lines(camera, self.now_s):
                style = _BAD if line.startswith(NO_IMAGE) else ""
                yield from (_line(f"  {part}", style) for part in broken_lines(line, options.max_width - 3))
            for finding in [] if camera.slow is None else camera.slow.findings[:_FINDINGS]:
                yield _line(f"  {finding}", "yellow")
        below = f"Nothing moves. {KEYS}" if self.keys else "Nothing moves. Ctrl-C: end"
        yield from (_line(line, "") for line in (self.note, below) if line)


def _line(text: str, style: str) -> "Text":
    from rich.text import Text

    return Text(text, style, no_wrap=True, overflow="ellipsis")


def _bar(figures: ImageFigures) -> "Table":
    from rich.progress_bar import ProgressBar
    from rich.table import Table

    drawn = Table.grid(padding=(0, 1))
    share = figures.sharpness / figures.best if figures.best > 0.0 else 0.0
    drawn.add_row(" ", ProgressBar(1.0, share, _BAR_WIDTH))
    return drawn
