"""Draws every picture of the documentation: runs commands and Python of gallery.md and keeps the pictures.

The picture of a printed target comes from `photograph.py`.

python docs/pictures.py    (or `make gallery`)
"""

import base64
import html
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

DOCS = Path(__file__).resolve().parent
IMAGES = DOCS / "images"

MADE_BY_COMMANDS = {
    "grid-found.png": "grid-found.png",
    "quality.png": "quality.png",
    "specimen.png": "specimen-overlay.png",
    "plate-maps.png": "maps/loaded.png",
    "line-cuts.png": "line-cuts.png",
    "contact-sheet.png": "sheet.png",
    "animation.gif": "film.gif",
    "gauges-load.png": "gauges-load.png",
    "assessment.png": "assessment/overview.png",
}
"""Maps each picture of the documentation to the file that a command of the gallery writes."""

OUT_OF_THE_REPORT = {
    "rotation-raw.svg": "Raw mean strains against the angle of rotation",
    "rotation-calibrated.svg": "Calibrated mean strains against the angle of rotation",
    "rotation-corrected.svg": "Corrected mean strains against the angle of rotation",
    "tension-differences.svg": "Differences from the raw strain of the on-axis camera",
    "tension-motion.svg": "Motion of the specimen's plane against the load",
    "tension-heights.png": "Heights of the specimen's surface",
    "tensile-values.png": "Stress against strain with the elastic line",
    "tensile-curves.svg": "Stress against strain of all cameras",
}
"""Maps each picture of the documentation to the title of a figure in the demo's report."""

REPORT = "demo/report.html"

PHOTOGRAPH = "printed-target.jpg"
"""The picture of a printed target, on the page about printing."""

COMPARED = "dice-difference.png"
"""The comparison on the page about exports. No script draws it, because its images are not kept here."""

PAGE = "drawing.png"
"""The page on which regions are drawn; `page_picture.py` draws it if there is a browser."""

_SHEET = "dic target dots --count 20x14 --pitch-mm 12 --dpi 200 -o sheet-of-dots.png"
_SHEET_DPI = 200.0


def commands(page: str) -> list[str]:
    """Return the commands of a Markdown page: the lines of its console blocks that begin with a prompt."""
    blocks = re.findall(r"^```console\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    return [line[2:] for block in blocks for line in block.splitlines() if line.startswith("$ ")]


def python(page: str) -> str:
    """Return the Python of a Markdown page: all of its blocks, which follow one another."""
    return "\n".join(re.findall(r"^```python\n(.*?)^```", page, re.MULTILINE | re.DOTALL))


def report_figure(report: str, title: str) -> bytes:
    """Return the first figure of a report that has this title."""
    figures = re.findall(r'<img src="data:image/[a-z+]+;base64,([^"]+)" alt="([^"]*)"', report)
    figure = next(base64.b64decode(data) for data, alt in figures if html.unescape(alt) == title)
    # Drawings of the report are transparent; on a dark page of the documentation nobody could read them.
    return figure.replace(b"<svg ", b'<svg style="background: #fff" ', 1)


def draw(work: Path, images: Path) -> None:
    """Run the gallery's commands in the folder `work`, and put the pictures into the folder `images`.

    After them the gallery's Python runs in the same folder, so that every line of it is known to work.
    """
    shutil.copytree(DOCS.parent / "examples", work / "examples")
    search = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    gallery = (DOCS / "gallery.md").read_text(encoding="utf-8")
    for command in [*commands(gallery), _SHEET]:
        print(f"$ {command}", flush=True)
        subprocess.run(command, shell=True, check=True, cwd=work, env={**os.environ, "PATH": search})
    report = (work / REPORT).read_text(encoding="utf-8")
    for name, file in MADE_BY_COMMANDS.items():
        keep = shutil.copyfile if file.endswith(".gif") else _keep_small
        keep(work / file, images / name)
    for name, title in OUT_OF_THE_REPORT.items():
        (images / name).write_bytes(report_figure(report, title))
    keep_photograph(work / "sheet-of-dots.png", images / PHOTOGRAPH)
    print("Python of the gallery", flush=True)
    subprocess.run([sys.executable, "-c", python(gallery)], check=True, cwd=work)


def keep_photograph(sheet: Path, kept: Path) -> None:
    """Save the picture that a camera takes of a printed sheet, drawn with `_SHEET_DPI`."""
    from PIL import Image

    sys.path.insert(0, str(DOCS))
    from photograph import photograph

    Image.fromarray(photograph(sheet, _SHEET_DPI)).save(kept, quality=85, optimize=True)


def _keep_small(drawn: Path, kept: Path) -> None:
    """Save a picture with 256 colours, which makes no visible difference in plots and maps."""
    from PIL import Image

    colours = Image.open(drawn).convert("RGB").quantize(256, dither=Image.Dither.NONE)
    colours.save(kept, optimize=True)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        draw(Path(folder), IMAGES)
    subprocess.run([sys.executable, DOCS / "page_picture.py"], check=True)
