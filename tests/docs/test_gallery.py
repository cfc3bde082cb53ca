"""The gallery has seventeen pictures, each with the command that draws it; one script draws all of them."""

import base64
import importlib.util
import re

import pytest

from tests.places import DOCS

_spec = importlib.util.spec_from_file_location("pictures", DOCS / "pictures.py")
assert _spec is not None
assert _spec.loader is not None
pictures = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(pictures)

DRAWN = set(pictures.MADE_BY_COMMANDS) | set(pictures.OUT_OF_THE_REPORT)
GALLERY = (DOCS / "gallery.md").read_text(encoding="utf-8")


def test_seventeen_pictures_are_shown_drawn_and_kept():
    assert len(DRAWN) == 17
    assert {path.name for path in (DOCS / "images").iterdir()} == DRAWN | {
        pictures.PHOTOGRAPH,
        pictures.COMPARED,
        pictures.PAGE,
    }
    shown = re.findall(r"\(images/([^)]+)\)", GALLERY)
    # each as a thumbnail that leads to its part of the page, and in this part
    assert sorted(shown) == sorted([*DRAWN, *DRAWN])
    parts = re.split(r"^## ", GALLERY, flags=re.MULTILINE)[1:]
    assert [part.splitlines()[0] for part in parts if "```python" not in part] == []


def test_pictures_are_small():
    assert sum(path.stat().st_size for path in (DOCS / "images").iterdir()) < 3e6


def test_a_drawing_of_the_report_is_white_behind_also_on_a_dark_page():
    svg = b'<?xml version="1.0"?><svg width="5"><path/></svg>'
    page = f'<img src="data:image/svg+xml;base64,{base64.b64encode(svg).decode()}" alt="A &amp; B">'
    drawing = pictures.report_figure(page, "A & B")
    assert drawing == b'<?xml version="1.0"?><svg style="background: #fff" width="5"><path/></svg>'


def test_files_that_are_kept_are_made_by_the_commands_shown():
    shown = " ".join(pictures.commands(GALLERY))
    for made in pictures.MADE_BY_COMMANDS.values():
        # The option names the file, the folder that it is put into, or the mask that it belongs to.
        assert made.split("/")[0].replace("-overlay", "") in re.split(r"[ =]", shown)
    assert "rig demo -o demo" in shown


@pytest.mark.long
def test_every_picture_can_be_drawn_again(tmp_path):
    work, images = tmp_path / "work", tmp_path / "images"
    work.mkdir()
    images.mkdir()
    pictures.draw(work, images)
    drawn = {path.name for path in images.iterdir() if path.stat().st_size > 1000}
    assert drawn == DRAWN | {pictures.PHOTOGRAPH}
