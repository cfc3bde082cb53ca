"""A page of pictures, lines and text, which is drawn as pixels at once or as a figure of matplotlib."""

import struct
import zlib
from dataclasses import dataclass, field
from functools import cache
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from dic.files.writing import replacing, write_figure
from dic.typing import Float, PathLike

MM_PER_IN = 25.4
PT_PER_IN = 72.0
FONT_PT = 7.0
CAPITAL_MM = 0.257
"""Height of a capital letter or a digit of 1 pt."""

Frame = NDArray[np.uint8]
"""Red, green and blue of each pixel, shape (height, width, 3)."""

_INK = 30
"""Grey level of lines and text."""
_MARGIN_MM = 1.5
_MARGIN_MM = 1.5
_SUBPIXEL_BITS = 4
_HEADER_BYTES = 33
"""Length of the signature and the first chunk of a PNG file."""


@dataclass(frozen=True)
class Rect:
    """A rectangle of a page, in mm from the upper left corner."""

    left: float
    top: float
    width: float
    height: float

    def px(self, dpi: float) -> tuple[int, int, int, int]:
        """Return left, top, width and height in whole pixels."""
        sides = (self.left, self.top, self.width, self.height)
        left, top, width, height = (round(side / MM_PER_IN * dpi) for side in sides)
        return left, top, max(1, width), max(1, height)

    def on_pixels(self, dpi: float) -> "Rect":
        """Return the rectangle with its edges between pixels."""
        return Rect(*(side * MM_PER_IN / dpi for side in self.px(dpi)))

    def fitted(self, aspect: float, dpi: float) -> "Rect":
        """Return the largest rectangle of an aspect (height over width) in the middle of this one."""
        width = min(self.width, self.height / aspect)
        left, top = self.left + (self.width - width) / 2, self.top + (self.height - width * aspect) / 2
        return Rect(left, top, width, width * aspect).on_pixels(dpi)

    @property
    def middle(self) -> tuple[float, float]:
        """The middle of the rectangle."""
        return self.left + self.width / 2, self.top + self.height / 2

    def outline(self) -> Float:
        """Return the corners, shape (5, 2); the last is the first."""
        right, bottom = self.left + self.width, self.top + self.height
        corners = [(self.left, self.top), (right, self.top), (right, bottom), (self.left, bottom)]
        return np.array([*corners, corners[0]])


@dataclass(frozen=True)
class Text:
    """A line of text: the place of its baseline's left end, middle or right end in mm, and its size."""

    x: float
    y: float
    text: str
    size_pt: float = FONT_PT
    align: Literal["left", "center", "right"] = "left"
    upright: bool = False
    """True if the text reads from below to above."""
    boxed: bool = False
    """True for a white box behind the text."""


@dataclass(frozen=True)
class Line:
    """Straight lines between places (n, 2) in mm; the colour is red, green and blue."""

    places: Float
    width_pt: float = 0.5
    colour: tuple[int, int, int] = (_INK, _INK, _INK)


@dataclass(frozen=True)
class Dots:
    """Equal squares around places (n, 2) in mm."""

    places: Float
    width_pt: float
    colour: tuple[int, int, int]


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
        size = fitting_pt(title, self.width_mm - 2 * _MARGIN_MM, most_pt)
        baseline = top_mm + CAPITAL_MM * most_pt
        self.texts.append(Text(self.width_mm / 2, baseline, title, size, "center"))

    def pixels(self) -> Frame:
        """Return the drawn page."""
        from PIL import Image, ImageDraw

        *_, width, height = Rect(0.0, 0.0, self.width_mm, self.height_mm).px(self.dpi)
        drawn = np.full((height, width, 3), 255, np.uint8)
        for place, picture in self.pictures:
            left, top, _, _ = place.px(self.dpi)
            drawn[top : top + picture.shape[0], left : left + picture.shape[1]] = picture
        for mark in self.marks:
            places, width_px = mark.places / MM_PER_IN * self.dpi, mark.width_pt / PT_PER_IN * self.dpi
            draw_mark = _draw_line if isinstance(mark, Line) else _draw_dots
            draw_mark(drawn, places, max(1, round(width_px)), mark.colour)
        page = Image.fromarray(drawn)
        draw = ImageDraw.Draw(page)
        for text in self.texts:
            _draw_text(page, draw, text, self.dpi)
        return np.asarray(page)

    def figure(self) -> Any:
        """Return the page as a figure of matplotlib, whose lines and letters remain vectors."""
        from matplotlib.figure import Figure

        figure = Figure(figsize=(self.width_mm / MM_PER_IN, self.height_mm / MM_PER_IN), dpi=self.dpi)
        axis = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axis.set_axis_off()
        for place, picture in self.pictures:
            ends = (place.left, place.left + place.width, place.top + place.height, place.top)
            axis.imshow(picture, extent=ends, aspect="auto", interpolation="none")
        ink = str(_INK / 255)
        for mark in self.marks:
            colour = "#" + bytes(mark.colour).hex()
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


def png_of(pixels: Frame, dpi: float) -> bytes:
    """Return pixels as a PNG file that states its resolution."""
    import cv2

    # OpenCV's own choice for PNG is the fast one; noise hardly compresses anyway.
    _, content = cv2.imencode(".png", cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR))
    file, per_m = content.tobytes(), round(1000.0 * dpi / MM_PER_IN)
    resolution = b"pHYs" + struct.pack(">IIB", per_m, per_m, 1)
    chunk = struct.pack(">I", 9) + resolution + struct.pack(">I", zlib.crc32(resolution))
    return file[:_HEADER_BYTES] + chunk + file[_HEADER_BYTES:]


def width_mm(text: str, size_pt: float) -> float:
    """Return the width of a text."""
    return float(_font(100).getlength(text)) / 100.0 * size_pt / PT_PER_IN * MM_PER_IN


def fitting_pt(title: str, room_mm: float, most_pt: float, least_pt: float = 4.0) -> float:
    """Return the size of a title's letters: `most_pt`, or less if the title would not fit into the room."""
    needed = width_mm(title, most_pt)
    return most_pt if needed <= room_mm else max(least_pt, most_pt * room_mm / needed)


@cache
def _font(size_px: float) -> Any:
    """Return the letters that matplotlib draws, of any size; matplotlib itself is not imported for them."""
    from PIL import ImageFont

    spec = find_spec("matplotlib")
    assert spec is not None
    assert spec.origin is not None
    file = Path(spec.origin).parent / "mpl-data/fonts/ttf/DejaVuSans.ttf"
    if not file.exists():
        # Some Linux distributions keep the data of matplotlib elsewhere.
        import matplotlib as mpl

        file = Path(mpl.get_data_path()) / "fonts/ttf/DejaVuSans.ttf"
    return ImageFont.truetype(str(file), size_px, layout_engine=ImageFont.Layout.BASIC)


def _draw_line(drawn: Frame, corners: Float, thickness: int, colour: tuple[int, int, int]) -> None:
    """Draw lines between corners (n, 2) in px: sharp along rows and columns of pixels, otherwise smooth."""
    import cv2

    for start, end in pairwise(corners):
        if (start == end).any():
            least, most = np.minimum(start, end), np.maximum(start, end)
            (x0, y0), (x1, y1) = (np.floor(each - thickness / 2 + 0.5).astype(int) for each in (least, most))
            drawn[max(y0, 0) : y1 + thickness, max(x0, 0) : x1 + thickness] = colour
        else:
            ends = np.round((np.stack([start, end]) - 0.5) * 2**_SUBPIXEL_BITS).astype(np.int32)
            cv2.polylines(drawn, [ends], False, colour, thickness, cv2.LINE_AA, _SUBPIXEL_BITS)


def _draw_dots(drawn: Frame, places: Float, width: int, colour: tuple[int, int, int]) -> None:
    corners = np.floor(places - width / 2 + 0.5).astype(int)
    for down in range(width):
        for right in range(width):
            x, y = corners.T + np.array([[right], [down]])
            inside = (x >= 0) & (y >= 0) & (x < drawn.shape[1]) & (y < drawn.shape[0])
            drawn[y[inside], x[inside]] = colour


def _draw_text(page: Any, draw: Any, text: Text, dpi: float) -> None:
    font = _font(round(text.size_pt / PT_PER_IN * dpi, 1))
    x, y = (round(at / MM_PER_IN * dpi) for at in (text.x, text.y))
    ink = (_INK, _INK, _INK)
    anchor = {"left": "ls", "center": "ms", "right": "rs"}[text.align]
    if text.upright:
        _draw_upright(page, text, (x, y), font)
        return
    if text.boxed:
        left, top, right, bottom = draw.textbbox((x, y), text.text, font=font, anchor=anchor)
        pad = round(1.5 / PT_PER_IN * dpi)
        draw.rectangle((left - pad, top - pad, right + pad, bottom + pad), fill="white")
    draw.text((x, y), text.text, fill=ink, font=font, anchor=anchor)


def _draw_upright(page: Any, text: Text, at: tuple[int, int], font: Any) -> None:
    from PIL import Image, ImageDraw

    ascent, descent = font.getmetrics()
    length = round(font.getlength(text.text))
    letters = Image.new("L", (length + 2, ascent + descent))
    ImageDraw.Draw(letters).text((0, ascent), text.text, fill=255, font=font, anchor="ls")
    turned = letters.transpose(Image.Transpose.ROTATE_90)
    above = {"left": length, "center": length // 2, "right": 0}[text.align]
    page.paste((_INK, _INK, _INK), (at[0] - ascent, at[1] - above), turned)
