"""Draws lines, dots and letters as pixels."""

from collections.abc import Sequence
from functools import cache
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from dic.pictures.marks import INK, MM_PER_IN, PT_PER_IN, Colour, Frame, Text
from dic.typing import Float

_SUBPIXEL_BITS = 4
_BOX_PT = 1.5
"""Width of the white edge of a boxed text."""


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


def draw_line(drawn: Frame, corners: Float, thickness: int, colour: Colour) -> None:
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


def draw_dots(drawn: Frame, places: Float, width: int, colour: Colour) -> None:
    """Draw squares of a whole width in px around places (n, 2) in px."""
    corners = np.floor(places - width / 2 + 0.5).astype(int)
    for down in range(width):
        for right in range(width):
            x, y = corners.T + np.array([[right], [down]])
            inside = (x >= 0) & (y >= 0) & (x < drawn.shape[1]) & (y < drawn.shape[0])
            drawn[y[inside], x[inside]] = colour


def draw_texts(drawn: Frame, texts: Sequence[Text], dpi: float) -> None:
    """Draw texts, whose places are in mm, on a page of pixels."""
    from PIL import Image, ImageDraw

    letters = Image.new("L", drawn.shape[1::-1])
    draw = ImageDraw.Draw(letters)
    for text in texts:
        font = _font(round(text.size_pt / PT_PER_IN * dpi, 1))
        x, y = (round(at / MM_PER_IN * dpi) for at in (text.x, text.y))
        anchor = {"left": "ls", "center": "ms", "right": "rs"}[text.align]
        if text.upright:
            _draw_upright(letters, text, (x, y), font)
            continue
        if text.boxed:
            pad = round(_BOX_PT / PT_PER_IN * dpi)
            left, top, right, bottom = map(round, draw.textbbox((x, y), text.text, font=font, anchor=anchor))
            drawn[max(top - pad, 0) : bottom + pad, max(left - pad, 0) : right + pad] = 255
        draw.text((x, y), text.text, fill=255, font=font, anchor=anchor)
    share, below = np.asarray(letters).ravel(), drawn.reshape(-1, 3)
    inked = np.flatnonzero(share > 0)
    covered = share[inked, None] / 255.0
    below[inked] = np.rint(covered * INK + (1.0 - covered) * below[inked])


def _draw_upright(letters: Any, text: Text, at: tuple[int, int], font: Any) -> None:
    from PIL import Image, ImageDraw

    ascent, descent = font.getmetrics()
    length = round(font.getlength(text.text))
    line = Image.new("L", (length + 2, ascent + descent))
    ImageDraw.Draw(line).text((0, ascent), text.text, fill=255, font=font, anchor="ls")
    turned = line.transpose(Image.Transpose.ROTATE_90)
    above = {"left": length, "center": length // 2, "right": 0}[text.align]
    letters.paste(turned, (at[0] - ascent, at[1] - above))
