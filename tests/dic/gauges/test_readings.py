"""Gauges give exact readings of exact fields after any rigid motion, and say where they have no reading."""

import numpy as np
import pytest

from dic import measure_gauges
from dic.errors import GaugeError
from dic.gauges import Extensometer, LineCut, PointGauge, StrainGauge, TransverseExtensometer
from dic.gauges.placed import PlacedGauges
from tests.dic.gauges.exact_fields import exact_field, exact_series, stretched

STRETCH = np.array([[0.996, 0.002], [-0.001, 1.012]])
AXIAL = Extensometer(name="axial", start=(150, 60), end=(150, 340), patch=40)
OBLIQUE = Extensometer(name="oblique", start=(70, 90), end=(230, 310), patch=35)
WIDTH = TransverseExtensometer(name="width", start=(50, 200), end=(250, 200), patch=15, spread=200)
AREA = StrainGauge(name="area", centre=(150, 200), size=(120, 80), angle_deg=25, direction_deg=40)
POLYGON = StrainGauge(name="polygon", corners=((40, 40), (260, 60), (150, 350)), direction_deg=90)
CUT = LineCut(name="cut", start=(40, 60), end=(240, 330), places=21)
POINT = PointGauge(name="point", at=(103.7, 211.2), direction_deg=90)
GAUGES = (AXIAL, OBLIQUE, WIDTH, AREA, POLYGON, CUT, POINT)


def elongation(F, direction):
    """Return the engineering strain of a material line with the given direction."""
    direction = np.asarray(direction, float) / np.linalg.norm(direction)
    return np.linalg.norm(F @ direction) - 1.0


def direction_of(angle_deg):
    return np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))


def readings(moved, gauges=GAUGES, **how):
    (image,) = measure_gauges(exact_series(exact_field(moved, **how)), gauges).images
    return {name: kinds["raw"] for name, kinds in image.readings.items()}


def turned(F, angle_deg):
    c, s = direction_of(angle_deg)
    return np.array([[c, -s], [s, c]]) @ F


@pytest.mark.parametrize("angle_deg", [0.0, 25.0])
def test_strain_is_that_of_the_material_line_in_spite_of_a_rotation(angle_deg):
    read = readings(stretched(turned(STRETCH, angle_deg)))
    lines = {
        "axial": (0, 1),
        # y counts upwards in strain and downwards in pixels
        "oblique": (160, -220),
        "width": (1, 0),
        "area": direction_of(40),
        "polygon": (0, 1),
        "point": (0, 1),
    }
    for name, line in lines.items():
        assert read[name].strain == pytest.approx(elongation(STRETCH, line), abs=1e-12), name


def test_extensometer_states_the_length_that_it_has():
    read = readings(stretched(STRETCH))["axial"]
    # Points lie at 20, 30, … px: the patches reach from 40 to 80 and from 320 to 360.
    assert read.length == pytest.approx(280.0)
    assert (read.points, read.declared) == (50, 50)
    assert read.extension == pytest.approx(280.0 * elongation(STRETCH, (0, 1)))
    narrow = Extensometer(name="narrow", start=(152, 63), end=(152, 338), patch=12)
    # One point in each patch, in rows 60 and 340: the gauge length is between these, not the declared places.
    assert readings(stretched(STRETCH), [narrow])["narrow"].length == pytest.approx(280.0)


def test_gauge_lies_exactly_where_it_is_declared_between_the_points():
    # The middles of the patches are not those of their points.
    gauge = Extensometer(name="between", start=(143.7, 66.2), end=(158.1, 331.9), patch=37)
    read = readings(stretched(STRETCH), [gauge])["between"]
    assert read.length == pytest.approx(np.hypot(14.4, 265.7), abs=1e-9)
    assert read.strain == pytest.approx(elongation(STRETCH, (14.4, -265.7)), abs=1e-12)


def test_transverse_extensometer_averages_over_its_lines():
    def bulging(x, y):
        # The width grows with the square of the distance from the middle line.
        share = 1e-6 * (y - 200.0) ** 2
        return share * (x - 150.0), 0.0 * y

    read = readings(bulging, [WIDTH])["width"]
    assert read.lines == 40
    offsets = np.linspace(-100.0, 100.0, 40)
    # Each line takes the rows of points within half a patch of it.
    rows = np.arange(20, 380, 10)
    near = [rows[np.abs(rows - 200 - offset) <= 7.5] for offset in offsets]
    truth = np.mean([np.mean(1e-6 * (row - 200.0) ** 2) for row in near])
    assert read.strain == pytest.approx(truth, rel=1e-9)


def test_point_and_cut_read_displacement_and_strain_at_their_places():
    read = readings(stretched(STRETCH))
    x, y = 103.7 - 150.0, -(211.2 - 200.0)
    u, v = (STRETCH - np.eye(2)) @ (x, y) + (3.3, 2.1)
    assert (read["point"].values["u"], read["point"].values["v"]) == pytest.approx((u, v), abs=1e-12)
    profile = read["cut"]
    assert profile.distance[[0, -1]] == pytest.approx([0.0, np.hypot(200, 270)])
    places = np.linspace((40.0, 60.0), (240.0, 330.0), 21)
    truth = [(STRETCH - np.eye(2)) @ (x - 150.0, 200.0 - y) + (3.3, 2.1) for x, y in places]
    np.testing.assert_allclose(np.column_stack([profile.values["u"], profile.values["v"]]), truth, atol=1e-11)
    green = (STRETCH.T @ STRETCH - np.eye(2)) / 2
    np.testing.assert_allclose(profile.values["exy"], green[0, 1], atol=1e-12)


@pytest.mark.parametrize("measure", ["green-lagrange", "hencky"])
def test_area_gives_the_strain_of_the_chosen_measure(measure):
    series = exact_series(exact_field(stretched(STRETCH)), measure_of_strain=measure)
    (image,) = measure_gauges(series, [AREA]).images
    C = STRETCH.T @ STRETCH
    values, axes = np.linalg.eigh(C)
    tensor = (C - np.eye(2)) / 2 if measure != "hencky" else axes @ np.diag(np.log(values) / 2) @ axes.T
    read = image.readings["area"]["raw"].values
    assert [read[name] for name in ("exx", "eyy", "exy")] == pytest.approx(
        tensor[[0, 1, 0], [0, 1, 1]], abs=1e-12
    )


def test_rectangle_turns_from_x_upwards():
    thin = StrainGauge(name="thin", centre=(150, 200), size=(240, 12), angle_deg=45)
    series = exact_series(exact_field(stretched(STRETCH)))
    placed = PlacedGauges.of([thin], series.images[0].measurement, None, (400, 300))
    (points,) = placed.points_of(series.images[0].measurement)
    # Up to the right: x + y is constant in pixels, where y counts downwards.
    assert np.ptp(points.sum(axis=1)) <= 20
    assert np.ptp(points[:, 0]) >= 150


def test_lost_points_are_counted_and_too_few_give_no_reading_but_the_reason():
    # Rows 2 to 6 and columns 11 to 15 are the patch at the start of "axial".
    patch = [(row, column) for row in range(2, 7) for column in range(11, 16)]
    read = readings(stretched(STRETCH), lost=patch[:12])
    assert (read["axial"].points, read["axial"].declared) == (38, 50)
    assert read["axial"].strain == pytest.approx(elongation(STRETCH, (0, 1)), abs=1e-12)
    read = readings(stretched(STRETCH), lost=patch[:13])["axial"]
    assert np.isnan(read.strain)
    assert read.as_dict()["strain"] is None
    assert read.reason == "too few points have a displacement: 12 of 25 at the start, 25 of 25 at the end"


def test_transverse_extensometer_needs_32_lines():
    left = [(row, column) for row in range(8, 15) for column in range(6)]
    read = readings(stretched(STRETCH), [WIDTH], lost=left)["width"]
    assert np.isnan(read.strain)
    assert read.lines < 32
    assert f"only {read.lines} lines have displacements at both ends, 32 are needed" in read.reason
    read = readings(stretched(STRETCH), [WIDTH], lost=left[:6])["width"]
    assert 32 <= read.lines < 40
    # Where a patch keeps a single row, its middle moves by half a spacing, which turns the line a little.
    assert read.strain == pytest.approx(elongation(STRETCH, (1, 0)), abs=2e-6)


@pytest.mark.parametrize(
    ("gauge", "words"),
    [
        (
            Extensometer(name="a", start=(150, 60), end=(150, 500), patch=40),
            "the image of 300 × 400 px",
        ),
        (Extensometer(name="a", start=(150, 60), end=(150, 399), patch=12), "none at the end; the measured"),
        (StrainGauge(name="a", centre=(10, 10), size=(8, 8)), "at least 3 measured points, got 0"),
        (PointGauge(name="a", at=(3, 3)), "at least 3 measured points, got 0"),
        (Extensometer(name="a", unit="mm", start=(0, 0), end=(0, 3), patch=1), "a calibration, because"),
        (
            TransverseExtensometer(name="a", start=(2, 200), end=(250, 200), patch=12, spread=100),
            "at least 32 lines with measured points at both ends, got 0 of 40",
        ),
    ],
)
def test_gauge_off_the_measured_points_is_refused_in_one_sentence(gauge, words):
    with pytest.raises(GaugeError) as caught:
        measure_gauges(exact_series(exact_field(stretched(STRETCH))), [gauge])
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_all_gauges_at_wrong_places_are_named_together():
    wrong = [PointGauge(name="one", at=(3, 3)), AXIAL, PointGauge(name="two", at=(500, 5))]
    with pytest.raises(GaugeError, match=r"'one'.*'two'"):
        measure_gauges(exact_series(exact_field(stretched(STRETCH))), wrong)


def test_two_gauges_of_one_name_are_refused():
    with pytest.raises(GaugeError, match="'axial' twice"):
        measure_gauges(exact_series(exact_field(stretched(STRETCH))), [AXIAL, AXIAL])
