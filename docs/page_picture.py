"""Draws the picture of the page of `dic draw`: uses the page in Chromium, and photographs the window.

python docs/page_picture.py    (`make gallery` does it too)
"""

import subprocess
import sys
import tempfile
from pathlib import Path

DOCS = Path(__file__).resolve().parent
sys.path.insert(0, str(DOCS.parent))

from tests.browser import PROGRAM, Page, browser  # noqa: E402  # the checkout has to be found first

_SIZE = (1200, 760)
_SHAPES = {
    "crack": [(395, 118), (412, 150), (404, 176)],
    "extensometer": [(70, 60), (70, 400)],
    "rectangle": [(330, 230), (420, 290)],
    "point": [(250, 330)],
    "transverse": [(150, 95), (370, 95)],
}
_VALUES = {"transverse": {"spread": 60}}


def photograph_page(kept: Path) -> None:
    """Draw shapes on the page of an image of the documentation, and save a picture of the window."""
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "drawing.html"
        image = DOCS.parent / "examples" / "images" / "reference.png"
        dic = Path(sys.executable).parent / "dic"
        subprocess.run([dic, "draw", image, "--specimen", "-o", page], check=True)
        with browser(Path(folder) / "profile") as window:
            window.open(page, *_SIZE)
            for kind, points in _SHAPES.items():
                _draw(window, kind, points)
            window.pointer("mouseMoved", _places(window, [(232, 262)])[0])
            window.picture(kept)
    _reduce(kept)


def _reduce(kept: Path) -> None:
    """Save the picture with few colours: the page has few, and the image is grey."""
    from PIL import Image

    colours = Image.open(kept).convert("RGB").quantize(48, method=Image.Quantize.MAXCOVERAGE, dither=0)
    colours.save(kept, optimize=True)


def _draw(window: Page, kind: str, points: list[tuple[float, float]]) -> None:
    window.click(f"#tool-{kind}")
    for place in _places(window, points):
        window.click(place)
    window.press("Enter")
    for name, value in _VALUES.get(kind, {}).items():
        window.type(f"#value-{name}", str(value))


def _places(window: Page, points: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return where places of the image are in the window."""
    script = "(() => { const box = view.place.getBoundingClientRect(); return [box.x, box.y]; })()"
    left, top = window.ask(script)
    found = [window.ask(f"view.onScreen({list(point)})") for point in points]
    return [(left + x, top + y) for x, y in found]


if __name__ == "__main__":
    if PROGRAM is None:
        sys.exit("install chromium to draw the picture of the page")
    photograph_page(DOCS / "images" / "drawing.png")
