"""The finders find the targets of printed sheets exactly where they were drawn."""

import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from dic.errors import CalibrationError
from dic.targets.find import find_target
from dic.targets.kinds import (
    AsymmetricDotTarget,
    CharucoTarget,
    CheckerboardTarget,
    DotTarget,
    LineGridTarget,
    Target,
)
from dic.targets.sheet.draw import draw_target
from tests.dic.targets.drawings import asymmetric_places

DPI = 100
PX_PER_MM = DPI / 25.4
TARGETS = [
    LineGridTarget((11, 9), 8.0),
    CheckerboardTarget((10, 7), 12.0),
    CharucoTarget((7, 5), 18.0, 13.5),
    DotTarget((12, 9), 10.0),
    AsymmetricDotTarget((5, 11), 20.0),
]


@pytest.mark.parametrize(
    "target",
    [
        *TARGETS[:3:2],
        *(pytest.param(each, marks=pytest.mark.extended) for each in (TARGETS[1], *TARGETS[3:])),
    ],
    ids=lambda target: type(target).__name__,
)
def test_a_drawn_target_is_found_where_it_was_drawn(target: Target, tmp_path: Path) -> None:
    width_mm, height_mm = draw_target(target, tmp_path / "target.png", DPI)
    picture = cv2.imread(str(tmp_path / "target.png"), cv2.IMREAD_GRAYSCALE)
    # A camera blurs the edges; the finders are made for cameras.
    image = cv2.GaussianBlur(picture.astype(np.float32), (0, 0), 1.0)
    grid = find_target(image, target)

    assert picture.shape == (round(height_mm * PX_PER_MM), round(width_mm * PX_PER_MM))
    assert grid.orientation == "mark"
    assert grid.found == grid.expected
    # The target's centre is the middle of the sheet, X points right and Y up. The origin of a plate of dots
    # is its mark.
    from_centre_mm = (grid.index - (np.array(grid.lines) - 1) / 2) * target.pitch_mm
    if isinstance(target, AsymmetricDotTarget):
        from_top = target.dots[1] - 1 - grid.index[:, 1]
        from_centre_mm = asymmetric_places(target.dots, target.pitch_mm)[from_top, grid.index[:, 0]]
    middle_px = (np.array(picture.shape[::-1]) - 1) / 2
    expected_px = middle_px + from_centre_mm * PX_PER_MM * [1, -1]
    assert np.abs(grid.uv_px - expected_px).max() < 0.03


def test_a_pdf_sheet_has_the_size_that_is_said(tmp_path: Path) -> None:
    size_mm = draw_target(DotTarget((20, 12), 12.0), tmp_path / "target.pdf")
    box = re.search(rb"/MediaBox \[ 0 0 ([\d.]+) ([\d.]+) \]", (tmp_path / "target.pdf").read_bytes())

    assert size_mm == (297.0, 210.0)
    assert box is not None
    # A point is 1/72 inch; the sheet is rounded to a pixel of 1/600 inch.
    np.testing.assert_allclose([float(side) * 25.4 / 72 for side in box.groups()], size_mm, atol=0.03)


@pytest.mark.parametrize(
    ("path", "dpi", "sentence"),
    [
        ("target.bmp", 600.0, "ends in .pdf, .png, .svg, got 'target.bmp'; name a file such as target.pdf"),
        ("target.png", 5000.0, "72 to 2400 pixels per inch, got 5000; give --dpi 600"),
    ],
)
def test_what_cannot_be_drawn_is_refused(path: str, dpi: float, sentence: str, tmp_path: Path) -> None:
    with pytest.raises(CalibrationError, match=re.escape(sentence)):
        draw_target(TARGETS[0], tmp_path / path, dpi)
    assert not list(tmp_path.iterdir())
