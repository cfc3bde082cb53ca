"""Tests of the positions, the colours, the scale and the size of maps."""

import re
from dataclasses import replace

import cv2
import matplotlib as mpl
import numpy as np
import pytest
from PIL import Image

import dic
from dic.pictures.colours import colour_table
from dic.pictures.contact_sheet import shown_of
from dic.pictures.maps import cut_ends
from dic.pictures.panels import maps_of
from dic.pictures.places import places_of
from tests.dic.pictures.fields import SHAPE, field_of, part_of, stretched
from tests.dic.pictures.pages import colours_at, drawn, maps_on

GREY = np.full(SHAPE, 128.0, np.float32)
SHEAR = np.array([[0.02, 0.3], [-0.25, -0.01]])
SHIFT = np.array([7.0, -4.0])
MATPLOTLIB = {
    "viridis": "viridis",
    "cividis": "cividis",
    "inferno": "inferno",
    "grey": "gray",
    "diverging": "RdBu_r",
}
"""Matplotlib's name of each colour map."""

# a camera that looks obliquely: px from mm, with the Y of the specimen upwards
OBLIQUE = np.array([[20.0, 3.0, 150.0], [1.0, -18.0, 120.0], [0.02, 0.004, 1.0]])


def image_of(points_mm: np.ndarray) -> np.ndarray:
    ends = np.concatenate([points_mm, np.ones((*points_mm.shape[:-1], 1))], axis=-1) @ OBLIQUE.T
    return ends[..., :2] / ends[..., 2:]


@pytest.fixture(scope="module")
def calibration() -> dic.Calibration:
    index = np.stack(np.meshgrid(np.arange(-8, 9), np.arange(-8, 9)), axis=-1).reshape(-1, 2)
    grid = dic.targets.GridPoints.on_lattice(index + 8, image_of(index * 0.75), (17, 17), 0.75)
    return dic.Calibration.fit(grid, SHAPE)


def test_on_the_deformed_image_cells_lie_where_the_motion_takes_them():
    lost = ((0, 0), (4, 5), (4, 6))
    field = field_of(lambda places: places @ SHEAR.T + SHIFT, SHEAR, lost)
    there = places_of(dic.measure(field), dic.pictures.MapSettings(on="deformed"))
    here = places_of(dic.measure(field), dic.pictures.MapSettings())
    assert here.corners[0, 0] == pytest.approx([30, 20])
    assert here.corners[-1, -1] == pytest.approx([270, 220])
    moved = here.corners @ (np.eye(2) + SHEAR).T + SHIFT
    beside = np.ones(moved.shape[:2], bool)
    beside[0, 0] = False  # the only corner all of whose points failed
    np.testing.assert_allclose(there.corners[beside], moved[beside], atol=1e-9)
    assert np.isfinite(there.corners).all()


def test_axes_in_mm_show_the_specimen_as_seen_straight_on(calibration):
    field = stretched(0.001)
    places = places_of(dic.measure(field, calibration), dic.pictures.MapSettings())
    assert places.unit == "mm"
    drawn = places.drawn_corners()
    # a bicubic map is no homography: a tenth of a pixel is left, which nobody sees in a picture
    np.testing.assert_allclose(image_of(drawn), places.corners, atol=0.15)


@pytest.mark.parametrize(
    ("rows", "columns"),
    [(1, 1), (1, 2), (1, 9), (9, 1)],
    ids=["a point", "two points", "a row", "a column"],
)
def test_points_that_cannot_be_rectified_are_drawn_in_px_and_refused_in_mm(calibration, rows, columns):
    field = part_of(stretched(0.001), slice(rows), slice(columns))
    measurement = dic.measure(field, calibration)
    assert places_of(measurement, dic.pictures.MapSettings()).unit == "px"
    with pytest.raises(
        dic.MeasurementError, match=rf"expected at least four points.*, got {rows * columns} "
    ):
        places_of(measurement, dic.pictures.MapSettings(axes="mm"))


def test_two_points_in_two_rows_are_enough_to_rectify(calibration):
    field = part_of(stretched(0.001), slice(2), slice(2))
    places = places_of(dic.measure(field, calibration), dic.pictures.MapSettings(axes="mm"))
    np.testing.assert_allclose(image_of(places.drawn_corners()), places.corners, atol=0.15)


def test_a_point_beside_a_line_of_points_does_not_determine_a_homography(calibration):
    """Nine points on a line and one beside it have many homographies to the same places in mm."""
    measurement = dic.measure(part_of(stretched(0.001), slice(2), slice(9)), calibration)
    position = measurement.calibrated.position.copy()
    position[1, 1:] = np.nan
    known = replace(measurement, calibrated=replace(measurement.calibrated, position=position))
    assert places_of(known, dic.pictures.MapSettings()).unit == "px"
    assert places_of(measurement, dic.pictures.MapSettings()).unit == "mm"


def viridis(values: np.ndarray) -> np.ndarray:
    """Return the colours of values from 0 to 1."""
    return np.array(mpl.colormaps["viridis"](values))[:, :3] * 255


PLAIN = {"quantities": ("u",), "opacity": 1.0, "limits": {"u": (0.0, 3.0)}}


def test_a_value_has_its_colour_at_its_place():
    """At points and between them: u is linear, so it is known everywhere."""
    page, maps = drawn(dic.measure(stretched(0.01)), GREY, **PLAIN)
    places = np.array([(40, 30), (160, 110), (260, 210), (151, 113), (97, 181), (268, 217)])
    # the last place lies beyond the last point, in its cell
    expected = viridis(0.01 * np.minimum(places[:, 0], 260) / 3.0)
    # a pixel of the picture is about 0.4 px wide, which is 0.4 of 256 colours
    np.testing.assert_allclose(colours_at(page, maps, GREY, places), expected, atol=3.0)


def test_points_without_a_value_stay_empty_and_their_neighbours_keep_their_cells():
    lost = ((4, 5), (4, 6), (5, 5), (0, 11))
    page, maps = drawn(dic.measure(stretched(0.01, lost)), GREY, **PLAIN)
    x, y = np.arange(40, 261, 20), np.arange(30, 211, 20)
    empty = np.array([(x[column], y[row]) for row, column in lost])
    seen = colours_at(page, maps, GREY, np.concatenate([empty, [(35, 15), (272, 30)]]))
    assert np.ptp(seen, axis=1).max() == 0
    beside = np.array([(x[4], y[4]), (x[7], y[4]), (x[5], y[3]), (x[6], y[5]), (x[4] + 8, y[4])])
    # beyond the last point before a lost one, nothing is extrapolated: the cell has the colour of its point
    values = 0.01 * np.minimum(beside[:, 0], [300, 300, 300, 300, x[4]])
    np.testing.assert_allclose(colours_at(page, maps, GREY, beside), viridis(values / 3.0), atol=3.0)


def test_a_crack_that_has_opened_is_empty_and_its_sides_keep_their_values():
    """The lower half has moved down by 40 px; the points along the crack are lost."""
    field = field_of(
        lambda places: np.stack([0 * places[..., 0], 40.0 * (places[..., 1] > 120)], axis=-1),
        np.zeros((2, 2)),
        tuple((4, column) for column in range(12)),
    )
    settings = {"quantities": ("v",), "opacity": 1.0, "limits": {"v": (-40.0, 0.0)}, "on": "deformed"}
    page, maps = drawn(dic.measure(field), GREY, **settings)
    # cells end at 100 px, and begin again at 120 + 40 px
    places = np.array([(150, y) for y in (60, 97, 105, 120, 145, 155, 164, 180)])
    seen = colours_at(page, maps, GREY, places)
    np.testing.assert_allclose(seen[:2], viridis(np.ones(2)), atol=3.0)
    assert np.ptp(seen[2:6], axis=1).max() == 0
    np.testing.assert_allclose(seen[6:], viridis(np.zeros(2)), atol=3.0)


def test_on_the_deformed_image_values_lie_where_the_motion_takes_them():
    """Points that are turned by 40° and stretched have their colours at their new places."""
    angle = np.deg2rad(40.0)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    gradient = turn @ np.diag([0.9, 0.6]) - np.eye(2)
    centre = np.array([150.0, 120.0])
    field = field_of(lambda places: (places - centre) @ gradient.T, gradient)
    page, maps = drawn(
        dic.measure(field), GREY, **(PLAIN | {"on": "deformed", "limits": {"u": (-99.0, 99.0)}})
    )
    before = np.array([(60.0, 50.0), (151.0, 133.0), (240.0, 190.0), (75.0, 201.0)])
    motion = (before - centre) @ gradient.T
    seen = colours_at(page, maps, GREY, before + motion)
    np.testing.assert_allclose(seen, viridis(motion[:, 0] / 198.0 + 0.5), atol=4.0)


def test_more_points_than_pixels_are_averaged():
    """Alternating values on a fine grid have the colour of their mean."""
    field = stretched(0.0)
    values = np.indices((900, 1200)).sum(axis=0) % 2 * 3.0
    warps = np.zeros((*values.shape, 6))
    warps[..., 0] = values
    shape, one = values.shape, np.ones(values.shape)
    fine = replace(
        field,
        x_px=np.linspace(20, 280, 1200), y_px=np.linspace(20, 220, 900), warps=warps,
        std=np.full((*shape, 6), 1e-4), zncc=one, iterations=np.full(shape, 3, np.int16),
        status=np.zeros(shape, np.int8), active=np.ones(shape, bool),
    )  # fmt: skip
    page, maps = drawn(dic.measure(fine), GREY, **(PLAIN | {"width_mm": 50.0}))
    seen = colours_at(page, maps, GREY, np.array([(60, 60), (151, 121), (230, 170)]))
    np.testing.assert_allclose(seen, viridis(np.full(3, 0.5)), atol=12.0)


def test_numbers_at_axes_stand_at_their_places_of_the_image():
    """A black cross through (100, 150) px of a white image meets the numbers 100 and 150."""
    image = np.full(SHAPE, 255.0, np.float32)
    image[149:152] = image[:, 99:102] = 0.0
    page, _ = drawn(dic.measure(part_of(stretched(0.01), slice(9), slice(11))), image, quantities=("u",))
    (place,), pixels = maps_on(page), page.pixels().astype(int)
    beside = {text.text: text for text in page.texts if text.align == "right"}
    below = {text.text: text for text in page.texts if text.align == "center" and text.y > place.top}
    across = round(below["100"].x / 25.4 * page.dpi)
    down = round((beside["150"].y - 0.257 * 6 / 2) / 25.4 * page.dpi)
    left, top, *_ = place.px(page.dpi)
    row, column = pixels[top + 12], pixels[:, left + 12]
    assert row[across, 0] < 190 < min(row[across - 12, 0], row[across + 12, 0])
    assert column[down, 0] < 190 < min(column[down - 12, 0], column[down + 12, 0])


@pytest.mark.parametrize("colours", ["viridis", "diverging"])
def test_numbers_at_a_colour_bar_stand_at_their_colours(colours):
    """The bar has the colours of the map over light grey, as they look over the image."""
    page, _ = drawn(
        dic.measure(stretched(0.01)), GREY, quantities=("u",), limits={"u": (-1.0, 3.0)}, colours=colours
    )
    place = next(place for place, _ in page.pictures if place.height < 3.0)
    numbers = [text for text in page.texts if place.top + 2.0 < text.y < place.top + 6.0]
    assert len(numbers) >= 5
    row = round((place.top + place.height / 2) / 25.4 * page.dpi)
    for number in numbers:
        share = (float(number.text.replace("−", "-")) + 1.0) / 4.0
        if share in (0.0, 1.0):
            continue  # the outline of the bar is here
        expected = 0.85 * np.array(mpl.colormaps[MATPLOTLIB[colours]](share)[:3]) + 0.15 * 0.8
        seen = page.pixels()[row, round(number.x / 25.4 * page.dpi)]
        np.testing.assert_allclose(seen, 255 * expected, atol=4.0)


def test_every_map_is_named_with_its_quantity_and_unit_and_its_bar_has_numbers():
    gradient = np.array([[0.011, 0.001], [0.002, -0.003]])
    page, _ = drawn(dic.measure(field_of(lambda places: places @ gradient.T, gradient)), GREY, "image 7")
    texts = [text.text for text in page.texts]
    assert texts[0] == "image 7"
    for title in ("u to the right, px", "v upwards, px", "εxx raw, %", "εyy raw, µε", "εxy raw, µε"):
        assert title in texts


def test_tiny_values_have_short_numbers_and_a_power_of_ten():
    page, _ = drawn(dic.measure(stretched(1e-9)), GREY, quantities=("u",))
    assert any("10⁻⁹ px" in text.text for text in page.texts)
    assert max(len(text.text) for text in page.texts if text.text[-1].isdigit()) <= 6


def test_maps_of_a_narrow_specimen_use_the_room():
    """A specimen of 1 : 8 has maps of at least 24 % of the picture's height over 8, and no text overlaps."""
    image = np.full((1600, 200), 128.0, np.float32)
    field = stretched(0.001)
    narrow = replace(field, x_px=np.linspace(20, 180, 12), y_px=np.linspace(20, 1580, 10))
    page, _ = drawn(dic.measure(narrow), image)
    places = maps_on(page)
    assert len({place.top for place in places}) == 1
    *_, width, height = places[0].px(page.dpi)
    assert width >= 230
    assert height / width == pytest.approx(8.0, abs=0.2)
    assert page.height_mm <= 1.4 * page.width_mm + 0.1


def test_one_scale_serves_a_series_and_each_image_may_have_its_own():
    small, large = dic.measure(stretched(0.002)), dic.measure(stretched(0.004))
    settings = dic.pictures.MapSettings(quantities=("u", "exx"))
    # u = exx · x, and x goes from 40 to 260 px; percentiles cut little of it
    both = dic.pictures.map_scale([small, large], settings)
    assert both["u"] == pytest.approx((0.08, 1.04), abs=0.02)
    own = dic.pictures.map_scale([small], settings)
    assert own["u"] == pytest.approx((0.08, 0.52), abs=0.02)
    assert both["u"] == (own["u"][0], dic.pictures.map_scale([large], settings)["u"][1])
    given = dic.pictures.map_scale([small], replace(settings, limits={"exx": (-5.0, 5.0)}))
    assert given["exx"] == (-5.0, 5.0)
    low, high = dic.pictures.map_scale([small], replace(settings, colours="diverging"))["u"]
    assert low == -high


def test_arrows_mark_the_ends_of_the_scale_that_values_exceed():
    panel = maps_of(dic.measure(stretched(0.01)), dic.pictures.MapSettings()).panels[0]
    ends = {(0.0, 3.0): "neither", (0.0, 1.0): "max", (1.0, 3.0): "min", (1.0, 2.0): "both"}
    for scale, cut in ends.items():
        assert cut_ends([panel], {"u": scale}) == cut


def lightness(name: str) -> np.ndarray:
    """Return the lightness L* (CIE 1976) along a colour map, from sRGB values by IEC 61966-2-1."""
    rgb = colour_table(name) / 255
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    luminance = linear @ [0.2126, 0.7152, 0.0722]
    return np.where(luminance > 0.008856, 116 * np.cbrt(luminance) - 16, 903.3 * luminance)


@pytest.mark.parametrize("name", list(MATPLOTLIB))
def test_colours_are_those_of_matplotlib(name):
    expected = mpl.colormaps[MATPLOTLIB[name]](np.arange(256))[:, :3] * 255
    np.testing.assert_allclose(colour_table(name), expected, atol=1.0)


@pytest.mark.parametrize("name", ["viridis", "cividis", "inferno", "grey"])
def test_lightness_grows_with_the_value(name):
    assert (np.diff(lightness(name)) > -0.05).all()
    assert np.ptp(lightness(name)) > 60


def test_diverging_colours_are_lightest_at_zero():
    assert abs(int(np.argmax(lightness("diverging"))) - 127.5) < 4


class TestFiles:
    def write(self, path, **settings):
        dic.write_maps(
            dic.measure(stretched(0.01)), GREY, path, settings=dic.pictures.MapSettings(**settings)
        )
        return path

    def test_a_picture_has_the_width_that_was_asked_for(self, tmp_path):
        picture = cv2.imread(str(self.write(tmp_path / "m.png", width_mm=85.0, dpi=300)))
        assert picture.shape[1] == pytest.approx(85.0 / 25.4 * 300, abs=1)
        with Image.open(tmp_path / "m.png") as stated:
            assert stated.info["dpi"] == pytest.approx((300, 300), abs=0.1)

    def test_a_pdf_has_the_width_that_was_asked_for_and_text_as_text(self, tmp_path):
        content = self.write(tmp_path / "m.pdf", width_mm=170.0, quantities=("exx",)).read_bytes()
        box = re.search(rb"/MediaBox \[ ?0 0 ([\d.]+) ([\d.]+)", content)
        assert float(box[1]) == pytest.approx(170.0 / 25.4 * 72, abs=0.1)
        assert b"/Font" in content
        assert b"/Subtype /Image" in content

    def test_an_svg_is_written(self, tmp_path):
        assert "<svg" in self.write(tmp_path / "m.svg", quantities=("v",)).read_text()

    def test_a_contact_sheet_shows_every_image(self, tmp_path):
        measurements = [dic.measure(stretched(0.001 * k), None) for k in range(1, 5)]
        dic.pictures.write_contact_sheet(measurements, GREY, tmp_path / "sheet.png", quantity="exx")
        assert cv2.imread(str(tmp_path / "sheet.png")).shape[1] == pytest.approx(250 / 25.4 * 150, abs=1)
        with pytest.raises(dic.MeasurementError, match="at least one measured image"):
            dic.pictures.write_contact_sheet([], GREY, tmp_path / "none.png")
        assert not (tmp_path / "none.png").exists()


@pytest.mark.parametrize("number", [1, 2, 47, 48, 49, 95, 1000])
def test_a_long_series_is_shown_from_its_first_to_its_last_image(number):
    shown = shown_of(number)
    assert len(shown) == min(number, 48)
    assert (shown[0], shown[-1]) == (0, number - 1)
    gaps = np.diff(shown)
    assert gaps.size == 0 or gaps.max() - gaps.min() <= 1


WRONG = [
    ({"quantities": ("ezz",)}, "quantities of maps: expected some of u, v, exx, eyy, exy, got ezz"),
    ({"on": "moved"}, "image under maps: expected one of reference, deformed, got moved"),
    ({"axes": "inch"}, "axes of maps: expected one of auto, mm, px, off, got inch"),
    ({"colours": "jet"}, "colours of maps: expected one of viridis"),
    ({"limits": {"exx": (5.0, 1.0)}}, "limits of maps: .* got exx=5.0,1.0; give for example eyy=0,2000"),
    ({"width_mm": 5.0}, "width of maps: expected 20 to 2000 mm, got 5.0"),
]


@pytest.mark.parametrize(("settings", "sentence"), WRONG, ids=[sentence[:20] for _, sentence in WRONG])
def test_a_wrong_setting_is_named_with_one_that_works(settings, sentence):
    with pytest.raises(dic.MeasurementError, match=sentence):
        dic.pictures.MapSettings(**settings)


def test_axes_in_mm_need_a_calibration():
    with pytest.raises(dic.MeasurementError, match="axes of maps: expected a calibration"):
        maps_of(dic.measure(stretched(0.01)), dic.pictures.MapSettings(axes="mm"))


@pytest.mark.parametrize("width_mm", [50.0, 120.0])
def test_a_title_fits_into_the_width_of_its_picture(width_mm):
    title = "step-13.png · 13 of 16 · 2800 N · 120.0 s"
    page, _ = drawn(
        dic.measure(stretched(0.001)), GREY, title, quantities=("exx",), axes="off", width_mm=width_mm
    )
    rows = page.pixels()[: round(6.0 / 25.4 * page.dpi)]
    inked = np.flatnonzero((rows < 128).any(axis=(0, 2)))
    assert 0 < inked[0] < inked[-1] < rows.shape[1] - 1
    assert inked[-1] - inked[0] > 0.6 * rows.shape[1] or width_mm > 100
