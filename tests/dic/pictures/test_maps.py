"""Tests of the positions, the colours, the scale and the size of maps."""

import re
from dataclasses import replace

import cv2
import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

import dic
from dic.pictures.contact_sheet import shown_of
from dic.pictures.maps import cut_ends, draw_maps
from dic.pictures.panels import maps_of, scale_of
from dic.pictures.places import places_of
from dic.pictures.settings import COLOURS
from tests.dic.pictures.fields import SHAPE, field_of, part_of, stretched

GREY = np.full(SHAPE, 128.0, np.float32)
SHEAR = np.array([[0.02, 0.3], [-0.25, -0.01]])
SHIFT = np.array([7.0, -4.0])

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


def test_a_value_has_its_colour_at_its_place():
    measurement = dic.measure(stretched(0.01))
    settings = dic.pictures.MapSettings(quantities=("u",), opacity=1.0, limits={"u": (0.0, 3.0)})
    maps = maps_of(measurement, settings)
    figure = draw_maps(maps, GREY, "", settings, scale_of([maps], settings))
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    pixels = np.asarray(canvas.buffer_rgba())
    for x, y in ((40, 30), (160, 110), (260, 210)):
        across, up = figure.axes[0].transData.transform((x, y))
        seen = pixels[pixels.shape[0] - 1 - int(up), int(across), :3]
        expected = np.array(mpl.colormaps["viridis"](0.01 * x / 3.0)[:3]) * 255
        assert np.abs(seen - expected).max() < 2.5


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
    rgb = mpl.colormaps[COLOURS[name]](np.linspace(0, 1, 256))[:, :3]
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    luminance = linear @ [0.2126, 0.7152, 0.0722]
    return np.where(luminance > 0.008856, 116 * np.cbrt(luminance) - 16, 903.3 * luminance)


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

    def test_a_pdf_has_the_width_that_was_asked_for_and_text_as_text(self, tmp_path):
        content = self.write(tmp_path / "m.pdf", width_mm=170.0, quantities=("exx",)).read_bytes()
        box = re.search(rb"/MediaBox \[ ?0 0 ([\d.]+) ([\d.]+)", content)
        assert float(box[1]) == pytest.approx(170.0 / 25.4 * 72, abs=0.1)
        assert b"/Font" in content

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
    settings = dic.pictures.MapSettings(quantities=("exx",), axes="off", width_mm=width_mm)
    maps = maps_of(dic.measure(stretched(0.001)), settings)
    figure = draw_maps(
        maps, GREY, "step-13.png · 13 of 16 · 2800 N · 120.0 s", settings, scale_of([maps], settings)
    )
    FigureCanvasAgg(figure).draw()
    box = figure._suptitle.get_window_extent()
    assert box.x0 >= 0
    assert box.x1 <= figure.bbox.width
