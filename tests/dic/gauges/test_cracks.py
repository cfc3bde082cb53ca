"""Gauges beside a crack do not count its opening as strain, and include the errors of clipped subsets."""

import csv
from dataclasses import replace

import numpy as np
import pytest

from dic import measure_gauges
from dic.correlation.settings import CorrelationSettings
from dic.errors import GaugeError
from dic.gauges import Extensometer, LineCut, PointGauge, StrainGauge, write_gauge_table
from dic.gauges.points import GridPlaces
from dic.gauges.sums import covariance_at_points
from dic.image.point_grid import connected_part, place_points
from dic.strain.displacement import Noise
from dic.strain.error_overlap import clipped_subsets, error_overlap
from tests.dic.gauges.exact_fields import SHAPE, exact_field, exact_series

STRAIN = 1e-3
SLIT = slice(143, 149)
"""Columns of pixels of a slit across the whole specimen; points lie at x = 140 and 150."""


def opened(x, y):
    """Return the displacement of a plate with a strain along x and a slit that has opened by 2 px."""
    return STRAIN * x + np.where(x > 145, 2.0, 0.0), np.zeros_like(y)


def readings(*gauges, slit=SLIT):
    region = np.ones(SHAPE, bool)
    region[:, slit] = False
    field = exact_field(opened)
    series = exact_series(replace(field, region=region, active=region[np.ix_(field.y_px, field.x_px)]))
    (image,) = measure_gauges(series, gauges).images
    return [image.readings[gauge.name]["raw"] for gauge in gauges]


@pytest.mark.parametrize("width", [None, 30, 90])
@pytest.mark.parametrize("x", [140, 141.5, 150])
def test_a_point_beside_a_slit_does_not_take_the_opening_for_strain(x, width):
    (read,) = readings(PointGauge(name="p", at=(x, 200), width=width))
    assert read.strain == pytest.approx(STRAIN, abs=1e-9)
    assert read.values["u"] == pytest.approx(STRAIN * x + (2.0 if x > 145 else 0.0), abs=1e-9)


def test_a_place_in_a_slit_has_no_value():
    with pytest.raises(GaugeError, match="0 at its place"):
        readings(PointGauge(name="p", at=(146, 200)))
    (cut,) = readings(LineCut(name="c", start=(110, 200), end=(190, 200), places=41))
    x = 110 + cut.distance
    in_slit = (x >= SLIT.start) & (x < SLIT.stop)
    assert (np.isnan(cut.values["exx"]) == in_slit).all()
    np.testing.assert_allclose(cut.values["exx"][~in_slit], STRAIN + STRAIN**2 / 2, atol=1e-9)


def test_the_table_of_a_cut_says_why_a_place_has_no_value(tmp_path):
    region = np.ones(SHAPE, bool)
    region[:, SLIT] = False
    cut = LineCut(name="c", start=(110, 200), end=(190, 200), places=41)
    series = measure_gauges(exact_series(replace(exact_field(opened), region=region)), [cut])
    write_gauge_table(series, tmp_path / "g.csv")
    with (tmp_path / "g.c.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    empty = [row for row in rows if not row["raw_exx"]]
    assert len(empty) == 3
    assert all("off the surface" in row["problem"] for row in empty)
    assert not any(row["problem"] for row in rows if row["raw_exx"])


def test_patches_end_at_a_slit_and_an_extensometer_across_it_reads_the_opening():
    along, across = readings(
        Extensometer(name="left", start=(60, 200), end=(130, 200), patch=60),
        Extensometer(name="over", start=(100, 200), end=(200, 200), patch=20),
    )
    assert along.strain == pytest.approx(STRAIN, abs=1e-9)
    assert across.extension == pytest.approx(2.0 + 100 * STRAIN, abs=1e-9)


@pytest.mark.parametrize("slit", [SLIT, slice(125, 176)])
def test_an_area_that_a_gap_divides_has_no_reading(slit):
    whole, left = readings(
        StrainGauge(name="both", centre=(150, 200), size=(160, 80)),
        StrainGauge(name="left", centre=(90, 200), size=(60, 80)),
        slit=slit,
    )
    assert np.isnan(whole.strain)
    assert "divides the area into 2 pieces" in whole.reason
    assert left.strain == pytest.approx(STRAIN, abs=1e-9)


def test_an_area_around_the_end_of_a_slit_is_one_piece():
    region = np.ones(SHAPE, bool)
    region[:200, SLIT] = False
    series = exact_series(replace(exact_field(opened), region=region))
    (image,) = measure_gauges(series, [StrainGauge(name="a", centre=(150, 200), size=(160, 160))]).images
    assert image.readings["a"]["raw"].reason == ""


@pytest.mark.parametrize("at", [(400, 500), (405, 500), (405, 505), (403.2, 496.9)])
def test_a_window_has_as_many_points_as_that_of_local_strain_wherever_it_lies(at):
    x, y = np.meshgrid(np.arange(100, 701, 10.0), np.arange(100, 901, 10.0))
    places = GridPlaces.of(np.stack([x, -y], -1), np.ones(x.shape, bool))
    assert len(places.around(np.array([at[0], -at[1]]), None, 3)) == 9


def test_an_area_has_the_points_on_its_edges_and_the_displacement_of_its_middle():
    turn = np.radians(5.0)

    def moved(x, y):
        c, s = np.cos(turn) - 1.0, np.sin(turn)
        return c * x + s * y, -s * x + c * y

    area = StrainGauge(name="a", centre=(150, 200), size=(200, 100))
    lost = [(row, column) for row in range(12, 17) for column in range(26)]
    (image,) = measure_gauges(exact_series(exact_field(moved, lost=lost)), [area]).images
    read = image.readings["a"]["raw"]
    # Points every 10 px from 20: x from 50 to 250, y from 150 to 250.
    assert read.declared == 21 * 11
    u, v = moved(150.0, 200.0)
    assert read.values["u"] == pytest.approx(u, abs=1e-9)
    # Displacements in images count y downwards, those of readings upwards.
    assert read.values["v"] == pytest.approx(-v, abs=1e-9)


@pytest.mark.parametrize("few", [0, 1000])
def test_clipped_subsets_have_the_covariance_of_the_sum_over_their_pixels(monkeypatch, few):
    """Theory: the error of a sum is the sum of white noise over pixels, with the weights of each fit."""
    monkeypatch.setattr("dic.gauges.sums._FEW", few)
    region = np.ones((90, 120), bool)
    region[:60, 55:58] = False
    settings = CorrelationSettings(subset_px=21, step_px=6, shape="affine")
    grid = place_points(region, region, 21, 6)
    rows, columns = np.nonzero(grid.active)
    assert 10 < np.count_nonzero(grid.pixels[rows, columns] < 21**2) < len(rows) - 10
    rng = np.random.default_rng(3)
    weights = rng.normal(size=(len(rows), 2, 3))
    pixels = np.zeros((2, 3, *region.shape))
    for row, column, weight in zip(rows, columns, weights, strict=True):
        x0, y0 = int(grid.x[column]), int(grid.y[row])
        y, x = np.nonzero(connected_part(grid.usable, x0, y0, 10))
        own = np.linalg.pinv(np.column_stack([np.ones(len(x)), x - 10, y - 10]))[0]
        pixels[:, :, y0 - 10 + y, x0 - 10 + x] += weight[..., None] * own / np.linalg.norm(own)
    theory = np.einsum("aphw,aqhw->pq", pixels, pixels)
    shape = grid.active.shape
    noise = Noise(
        np.broadcast_to(np.eye(2), (*shape, 2, 2)),
        error_overlap(settings),
        np.zeros((*shape, 4, 4)),
        clipped=clipped_subsets(grid, settings),
    )
    found = covariance_at_points(rows, columns, weights, noise)
    np.testing.assert_allclose(found, theory, rtol=1e-4, atol=1e-4 * np.abs(theory).max())
    whole = covariance_at_points(rows, columns, weights, replace(noise, clipped=None))
    assert np.abs(whole - theory).max() > 0.02 * np.abs(theory).max()


def test_a_patch_is_no_wider_than_the_gauge():
    with pytest.raises(GaugeError, match="patch: expected at most 270, the distance between start and end"):
        Extensometer(name="e", start=(100, 50), end=(100, 320), patch=800)


def test_an_area_without_a_reading_has_the_same_keys_as_one_with():
    whole, left = readings(
        StrainGauge(name="both", centre=(150, 200), size=(160, 80)),
        StrainGauge(name="left", centre=(90, 200), size=(60, 80)),
    )
    assert whole.as_dict().keys() == left.as_dict().keys()
    assert whole.as_dict()["exx"] is None
    assert "extension" not in whole.as_dict()
