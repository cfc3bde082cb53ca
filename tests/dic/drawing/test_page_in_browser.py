"""The page is used by pointer and keys in a real browser, and the commands read the files that it saves."""

import json
import re
import shlex

import cv2
import numpy as np
import pytest

from dic import load_calibration, read_gauges, read_region
from dic.gauges import LineCut, PointGauge, StrainGauge, TransverseExtensometer
from dic.regions.read import read_drawn_region
from tests.browser import browser
from tests.command_line import run_dic
from tests.image_files import write_image
from tests.places import EXAMPLES

SHAPE = (300, 400)
# Pixels of a bright rectangle in the dark: columns 100 to 219, rows 80 to 179.
LEFT, TOP, RIGHT, BOTTOM = 100, 80, 220, 180


@pytest.fixture(scope="module")
def window(tmp_path_factory):
    with browser(tmp_path_factory.mktemp("profile")) as page:
        yield page
        assert page.errors == []
        # The page loads nothing but itself and the picture inside it.
        assert all(url.startswith(("file:", "data:", "blob:")) for url in page.requests)


def drawing(folder, grey, *options):
    image = write_image(folder / "reference.png", grey)
    result = run_dic("draw", image, "-o", folder / "draw.html", "--force", *options)
    assert result.status == 0, result
    return folder / "draw.html"


def bright(shape=SHAPE, times=1):
    grey = np.full(shape, 30, np.uint8)
    grey[TOP * times : BOTTOM * times, LEFT * times : RIGHT * times] = 220
    return grey


def seen_box(window, path):
    """The edges of the bright rectangle in a picture of the window: left, top, right, bottom."""
    window.picture(path)
    picture = cv2.imread(str(path))
    script = "JSON.stringify(document.querySelector('#image').getBoundingClientRect())"
    canvas = json.loads(window.ask(script))
    left, top = round(canvas["left"]), round(canvas["top"])
    part = picture[top : round(canvas["bottom"]), left : round(canvas["right"])]
    rows, columns = np.nonzero((part.min(axis=2) > 125) & (np.ptp(part, axis=2) < 20))
    return left + columns.min(), top + rows.min(), left + columns.max() + 1, top + rows.max() + 1


def places(window, *points):
    """Return the positions in the window of points given in the image."""
    corner = window.ask("(() => { const b = view.place.getBoundingClientRect(); return [b.x, b.y]; })()")
    found = [window.ask(f"view.onScreen({list(point)})") for point in points]
    return [(corner[0] + x, corner[1] + y) for x, y in found]


def draw(window, tool, *points, end=True):
    window.click(f"#tool-{tool}")
    for place in places(window, *points):
        window.click(place)
    if end:
        window.press("Enter")


@pytest.mark.extended
@pytest.mark.parametrize("times", [1, pytest.param(12, marks=pytest.mark.long)])
def test_a_click_means_the_pixel_that_is_seen(window, tmp_path, times):
    """The corners are seen in a picture of the window, and known from the image, without code of the page."""
    window.open(drawing(tmp_path, bright((300 * times, 400 * times), times)))
    left, top, right, bottom = seen_box(window, tmp_path / "window.png")
    window.click("#tool-region")
    for place in ((left, top), (right, top), (right, bottom), (left, bottom), (left, top)):
        window.click((float(place[0]), float(place[1])))
    saved = window.download("#save-region", tmp_path)
    (outline,) = read_drawn_region(str(saved)).polygons
    # The outer edges of the outermost bright pixels, and one pixel of the window on top of rounding.
    edges = np.array([[LEFT, TOP], [RIGHT, TOP], [RIGHT, BOTTOM], [LEFT, BOTTOM]]) * times - 0.5
    across = (RIGHT - LEFT) * times / (right - left)
    np.testing.assert_allclose(outline.corners, edges, atol=1.01 * across + 0.05)
    assert read_region(saved, (), (300 * times, 400 * times)).mean() == pytest.approx(0.1, rel=0.02)


@pytest.mark.long
def test_a_drawn_region_and_gauges_are_measured(window, tmp_path, speckle):
    pattern = speckle(seed=5, shape=SHAPE)
    page = drawing(tmp_path, pattern.draw())
    moved = write_image(tmp_path / "moved.png", pattern.draw(lambda x, y: (x / 1.002, y / 0.999)))
    window.open(page)
    draw(window, "region", (20, 20), (380, 20), (380, 280), (20, 280))
    draw(window, "hole", (300, 200), (395, 200), (395, 250), (300, 250))
    draw(window, "crack", (150, 15), (150, 120))
    draw(window, "extensometer", (60, 200), (260, 200), end=False)
    region, gauges = (window.download(f"#save-{file}", tmp_path) for file in ("region", "gauges"))
    result = run_dic(
        *("correlate", tmp_path / "reference.png", moved, "--subset", 21, "--roi", region),
        *("--gauges", gauges, "--json", tmp_path / "r.json"),
    )
    assert result.status == 0, result
    reading = result.report["gauge_readings"][0]["gauges"]["extensometer-1"]["raw"]
    assert reading["strain"] == pytest.approx(0.002, abs=4 * reading["strain_std"] + 1e-5)
    mask = read_region(region, (), SHAPE)
    assert not mask[200:250, 301:].any()
    assert not mask[20:120, 149:152].any()
    assert mask[130:190, 25:375].all()


@pytest.mark.long
class TestLong:
    def test_every_gauge_is_read_as_it_was_drawn(self, window, tmp_path):
        window.open(drawing(tmp_path, bright()))
        draw(window, "transverse", (60, 150), (340, 150), end=False)
        window.type("#value-spread", "90")
        window.type("#value-lines", "48")
        window.type("#value-name", "width")
        draw(window, "rectangle", (100, 80), (220, 180), end=False)
        window.type("#value-angle_deg", "30")
        draw(window, "polygon", (240, 60), (330, 60), (330, 120))
        window.type("#value-direction_deg", "90")
        draw(window, "cut", (50, 250), (350, 250), end=False)
        window.type("#value-places", "20")
        draw(window, "point", (200, 40), end=False)
        window.type("#value-width", "15")
        width, area, polygon, cut, point = read_gauges(window.download("#save-gauges", tmp_path))
        assert isinstance(width, TransverseExtensometer)
        assert (width.name, width.spread, width.lines) == ("width", 90.0, 48)
        assert width.start + width.end == pytest.approx((60, 150, 340, 150), abs=0.3)
        assert isinstance(area, StrainGauge)
        assert area.centre + area.size == pytest.approx((160, 130, 120, 100), abs=0.6)
        assert area.angle_deg == 30.0
        corners = np.array([[240, 60], [330, 60], [330, 120]])
        assert np.array(polygon.corners) == pytest.approx(corners, abs=0.3)
        assert polygon.direction_deg == 90.0
        assert isinstance(cut, LineCut)
        assert (cut.places, cut.width) == (20, None)
        assert isinstance(point, PointGauge)
        assert point.width == 15.0
        assert len({gauge.name for gauge in (width, area, polygon, cut, point)}) == 5

    def test_points_are_moved_inserted_and_deleted_and_all_is_undone(self, window, tmp_path):
        window.open(drawing(tmp_path, bright()))

        def corners():
            return window.ask("model.shapes[0]?.points")

        drawn = [(50, 50), (200, 50), (200, 200), (50, 200)]
        draw(window, "region", *drawn)
        start, end = places(window, (200, 200), (300, 250))
        window.drag(start, end)
        assert np.array(corners()) == pytest.approx(np.array([*drawn[:2], (300, 250), drawn[3]]), abs=0.3)
        middle, up = places(window, (125, 50), (125, 20))
        window.drag(middle, up)
        assert np.array(corners())[1] == pytest.approx([125, 20], abs=0.3)
        assert len(corners()) == 5
        (at,) = places(window, (200, 50))
        window.click(at, button="right")
        assert len(corners()) == 4
        (edge, aside) = places(window, (50, 120), (60, 130))
        window.drag(edge, aside)
        assert np.array(corners())[0] == pytest.approx([60, 60], abs=0.5)
        for _ in range(4):
            window.press("z", modifiers=2)
        assert np.array(corners()) == pytest.approx(np.array(drawn), abs=0.3)
        window.press("z", modifiers=2)
        assert corners() is None
        window.press("y", modifiers=2)
        assert len(corners()) == 4
        window.click("#shapes button")
        window.press("Delete")
        assert corners() is None

    def test_zoom_and_pan_change_the_view_alone(self, window, tmp_path):
        window.open(drawing(tmp_path, bright()))
        before = seen_box(window, tmp_path / "a.png")
        (middle,) = places(window, (160, 130))
        window.pointer("mouseWheel", middle, deltaX=0, deltaY=-300)
        after = seen_box(window, tmp_path / "b.png")
        assert (after[2] - after[0]) / (before[2] - before[0]) == pytest.approx(np.exp(0.45), abs=0.01)
        # The place under the pointer stays there.
        shares = [(middle[0] - box[0]) / (box[2] - box[0]) for box in (before, after)]
        assert shares[1] == pytest.approx(shares[0], abs=0.01)
        window.drag(middle, (middle[0] + 20, middle[1] + 10), (middle[0] + 40, middle[1] - 30))
        panned = seen_box(window, tmp_path / "c.png")
        assert panned[0] - after[0] == pytest.approx(40, abs=1)
        assert panned[1] - after[1] == pytest.approx(-30, abs=1)
        assert window.ask("model.shapes.length") == 0

    def test_what_the_commands_would_refuse_is_said_and_not_saved(self, window, tmp_path):
        window.open(drawing(tmp_path, bright()))

        def said(file):
            return window.ask(f"document.querySelector('#problems-{file}').innerText")

        draw(window, "region", (50, 50), (150, 150), (150, 50), (50, 150))
        assert "edges cross at (100, 100)" in said("region")
        assert window.ask("document.querySelector('#save-region').disabled")
        window.press("z", modifiers=2)
        draw(window, "region", (50, 50), (150, 50), (150, 150))
        draw(window, "region", (120, 20), (140, 20), (140, 250))
        assert "Region 1 and Region 2 cross at" in said("region")
        window.press("z", modifiers=2)
        # A triangle whose upper edge lies on that of the first one: no edges cross.
        draw(window, "region", (100, 50), (200, 50), (150, 150))
        assert "Region 1 and Region 2 overlap" in said("region")
        draw(window, "extensometer", (60, 200), (100, 200), end=False)
        window.type("#value-patch", "60")
        assert "smaller than the gauge is long" in said("gauges")
        window.type("#value-name", "no blanks")
        assert "give a name of letters" in said("gauges")
        assert window.ask("document.querySelector('#save-gauges').disabled")

    def test_files_are_loaded_changed_and_saved_again(self, window, tmp_path):
        (tmp_path / "old.toml").write_text(
            "polygons = [[[20, 20], [380, 20], [380, 280], [20, 280]]]\n"
            "holes = [[[100, 100], [150, 100], [150, 150]]]\n"
            "[[crack]]\npath = [[200, 20], [200, 90.5]]\nwidth_px = 6\n"
        )
        (tmp_path / "old-gauges.toml").write_text(
            '[[gauge]]\nname = "a"\nkind = "extensometer"\nstart = [60, 200]\nend = [260, 200]\npatch = 21\n'
            '[[gauge]]\nname = "b"\nkind = "area"\nunit = "mm"\ncentre = [0.1, 0.25]\nsize = [2, 1]\n'
            '[[gauge]]\nname = "c"\nkind = "area"\ncentre = [90, 90]\nsize = [40, 30]\nangle_deg = 20\n'
            '[[gauge]]\nname = "d"\nkind = "area"\ncorners = [[10, 10], [90, 10], [50, 90]]\n'
            '[[gauge]]\nname = "e"\nkind = "cut"\nstart = [60, 200]\nend = [260, 200]\nwidth = 9\n'
            '[[gauge]]\nname = "f"\nkind = "point"\nat = [60, 200]\ndirection_deg = 45\n'
            '[[gauge]]\nname = "g"\nkind = "transverse"\nstart = [60, 50]\nend = [60, 250]\n'
            "patch = 9\nspread = 40\n"
        )
        loaded = tmp_path / "old.toml", tmp_path / "old-gauges.toml"
        window.open(drawing(tmp_path, bright(), "--roi", loaded[0], "--gauges", loaded[1]))
        region, gauges = (window.download(f"#save-{file}", tmp_path) for file in ("region", "gauges"))
        masks = [read_region(path, (), SHAPE) for path in (loaded[0], region)]
        np.testing.assert_array_equal(*masks)
        before, after = ({one.name: one for one in read_gauges(path)} for path in (loaded[1], gauges))
        assert after == before

    def test_the_place_of_the_pointer_is_shown_in_px_and_mm(self, window, tmp_path):
        grid = EXAMPLES / "images" / "grid.png"
        assert run_dic("calibrate", grid, "-o", tmp_path / "cal.h5").status in (0, 1)
        image = cv2.imread(str(grid), cv2.IMREAD_GRAYSCALE)
        window.open(drawing(tmp_path, image, "--calibration", tmp_path / "cal.h5"))
        calibration = load_calibration(tmp_path / "cal.h5")
        for place in ((150, 200), (260, 301), (355, 120)):
            (at,) = places(window, place)
            window.pointer("mouseMoved", at)
            shown = window.ask("document.querySelector('#place').textContent")
            x, y, x_mm, y_mm = map(float, re.findall(r"-?\d+\.\d+", shown))
            # The window's pixels are whole, so the pointer is not exactly at the place.
            assert (x, y) == pytest.approx(place, abs=0.6)
            ((exact_x_mm, exact_y_mm),) = calibration.map(np.array([[x, y]]))
            scale = calibration.mm_per_px
            assert (x_mm, y_mm) == pytest.approx((exact_x_mm, exact_y_mm), abs=0.06 * scale + 0.0015)
        window.pointer("mouseMoved", places(window, (2, 2))[0])
        assert "outside of the calibration" in window.ask("document.querySelector('#place').textContent")

    def test_the_page_says_why_gauges_in_mm_cannot_be_moved(self, window, tmp_path):
        (tmp_path / "g.toml").write_text(
            '[[gauge]]\nname = "foil"\nkind = "area"\nunit = "mm"\ncentre = [0, 0]\nsize = [6, 3]\n'
            "direction_deg = 90\n"
        )
        hidden = "document.querySelector('#kept').hidden"
        window.open(drawing(tmp_path, bright()))
        assert window.ask(hidden)
        window.open(drawing(tmp_path, bright(), "--gauges", tmp_path / "g.toml"))
        assert not window.ask(hidden)
        said = window.ask("document.querySelector('#kept').innerText")
        assert said.startswith("Gauges in mm cannot be moved here: this page draws in px")
        listed = window.ask("document.querySelector('#shapes').innerText")
        assert listed == "foil (area, in mm): not shown without --calibration"

    def test_the_text_that_is_shown_is_the_file(self, window, tmp_path):
        window.open(drawing(tmp_path, bright()), width=800, height=600)
        draw(window, "region", (50, 50), (150, 50), (150, 150))
        saved = window.download("#save-region", tmp_path)
        window.click("#show-region")
        assert window.ask("document.querySelector('#text-content').value") == saved.read_text()
        use = shlex.split(window.ask("document.querySelector('.use code').textContent"))
        assert use[:3] == ["dic", "correlate", "reference.png"]
        window.click("#close")
        draw(window, "point", (200, 200), end=False)
        window.open(tmp_path / "draw.html")
        assert window.dialogs[-1] == "beforeunload"
