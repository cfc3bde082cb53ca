"""A page of pictures, lines and text, which is drawn as pixels at once or as a figure of matplotlib."""

import struct
import zlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from dic.files.writing import replacing, write_figure
from dic.pictures.ink import draw_dots, draw_line, draw_texts, fitting_pt
from dic.pictures.marks import (
    CAPITAL_MM,
    FONT_PT,
    INK,
    MARGIN_MM,
    MM_PER_IN,
    PT_PER_IN,
    Colour,
    Dots,
    Frame,
    Line,
    Rect,
    Text,
)
from dic.typing import PathLike

_HEADER_BYTES = 33
"""Length of the signature and the first chunk of a PNG file."""


@dataclass
class Page:
    """Pictures, then dots and lines, then text, in mm from the upper left corner of the page."""

    width_mm: float
    height_mm: float
    dpi: float
    pictures: list[tuple[Rect, Frame]] = field(default_factory=list)
    marks: list[Line | Dots] = field(default_factory=list)
    texts: list[Text] = field(default_factory=list)

    def add_title(self, title: str, top_mm: float, most_pt: float = FONT_PT + 2) -> None:
        """Add a title in the middle of the page, in smaller letters if it is long."""
        size = fitting_pt(title, self.width_mm - 2 * MARGIN_MM, most_pt)
        baseline = top_mm + CAPITAL_MM * most_pt
        self.texts.append(Text(self.width_mm / 2, baseline, title, size, "center"))

    def pixels(self) -> Frame:
        """Return the drawn page."""
        *_, width, height = Rect(0.0, 0.0, self.width_mm, self.height_mm).px(self.dpi)
        drawn = np.full((height, width, 3), 255, np.uint8)
        for place, picture in self.pictures:
            left, top, _, _ = place.px(self.dpi)
            drawn[top : top + picture.shape[0], left : left + picture.shape[1]] = picture
        for mark in self.marks:
            places, width_px = mark.places / MM_PER_IN * self.dpi, mark.width_pt / PT_PER_IN * self.dpi
            draw_mark = draw_line if isinstance(mark, Line) else draw_dots
            draw_mark(drawn, places, max(1, round(width_px)), mark.colour)
        draw_texts(drawn, self.texts, self.dpi)
        return drawn

    def figure(self) -> Any:
        """Return the page as a figure of matplotlib, whose lines and letters remain vectors."""
        from matplotlib.figure import Figure

        figure = Figure(figsize=(self.width_mm / MM_PER_IN, self.height_mm / MM_PER_IN), dpi=self.dpi)
        axis = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axis.set_axis_off()
        for place, picture in self.pictures:
            ends = (place.left, place.left + place.width, place.top + place.height, place.top)
            axis.imshow(picture, extent=ends, aspect="auto", interpolation="none")
        ink = _hex(INK)
        for mark in self.marks:
            colour = _hex(mark.colour)
            if isinstance(mark, Line):
                axis.plot(*mark.places.T, color=colour, linewidth=mark.width_pt, solid_capstyle="butt")
            else:
                axis.plot(*mark.places.T, "s", color=colour, markersize=mark.width_pt, markeredgewidth=0.0)
        box = {"facecolor": "white", "edgecolor": "none", "pad": 1.5}
        for text in self.texts:
            axis.text(
                text.x, text.y, text.text, fontsize=text.size_pt, ha=text.align, va="baseline", color=ink,
                rotation=90.0 * text.upright, rotation_mode="anchor", bbox=box if text.boxed else None,
            )  # fmt: skip
        axis.set(xlim=(0.0, self.width_mm), ylim=(self.height_mm, 0.0))
        return figure

    def write(self, path: PathLike) -> None:
        """Write the page in the format that the ending of the name gives; raise `OSError` if impossible."""
        if Path(path).suffix.lower() in (".png", ""):
            with replacing(path) as partial:
                partial.write_bytes(png_of(self.pixels(), self.dpi))
        else:
            write_figure(self.figure(), path, self.dpi)


def _hex(colour: Colour) -> str:
    return "#" + bytes(colour).hex()


def png_of(pixels: Frame, dpi: float) -> bytes:
    """Return pixels as a PNG file that states its resolution."""
    import cv2

    # OpenCV's own choice for PNG is the fast one; noise hardly compresses anyway.
    _, content = cv2.imencode(".png", cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR))
    file, per_m = content.tobytes(), round(1000.0 * dpi / MM_PER_IN)
    resolution = b"pHYs" + struct.pack(">IIB", per_m, per_m, 1)
    chunk = struct.pack(">I", 9) + resolution + struct.pack(">I", zlib.crc32(resolution))
    return file[:_HEADER_BYTES] + chunk + file[_HEADER_BYTES:]
