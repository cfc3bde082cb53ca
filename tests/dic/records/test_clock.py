"""Offset and rate of the machine's clock are found or assumed, and missing images are named."""

import numpy as np
import pytest

from dic import material_properties
from dic.derived import ImageClock, gauge_curve, join_record
from dic.errors import CurveError
from dic.gauges import GaugeImage, GaugeSeries, PointGauge, Reading
from dic.properties import PropertySettings
from dic.records import MachineRecord
from dic.records.lost import lost_by_strain, lost_by_time, places_of
from tests.dic.records.timed_tests import AREA_MM2, timed_test

POINT = PointGauge(name="point", at=(1, 1))
AUTO = {"offset_s": None}


def series_of(test, numbers=None, known=None):
    numbers = np.arange(1, len(test.strain) + 1) if numbers is None else numbers
    images = [
        GaugeImage(
            f"img_{number:04d}.tif",
            {"point": {"raw": Reading("px", strain=strain)}},
            {} if known is None else {"time_s": known[k], "time_source": "file"},
        )
        for k, (number, strain) in enumerate(zip(numbers, test.strain, strict=True))
    ]
    return GaugeSeries("r.h5", (POINT,), tuple(images), reference="img_0000.tif")


def joined_of(test, clock, numbers=None, known=None):
    record = MachineRecord("m.csv", test.load_n, time_s=test.machine_s)
    return join_record(series_of(test, numbers, known), record, "time", clock=clock)


def properties_of(test, clock, numbers=None):
    series, joined = joined_of(test, clock, numbers)
    read = gauge_curve(series, "point")
    return read.judged(material_properties(read.curve, PropertySettings(AREA_MM2))), joined


def z_scores(tests, clock_of, numbers=None):
    """Return the errors of E and Rp0.2 divided by their stated standard deviations, shape (tests, 2)."""
    scores = []
    for test in tests:
        found = properties_of(test, clock_of(test), numbers)[0].values
        pairs = (found["E_gpa"], test.e_gpa), (found["Rp02_mpa"], test.rp02_mpa)
        scores.append(
            [(value.value - truth) / value.std for value, truth in pairs if value.value is not None]
        )
    return np.array([score for score in scores if len(score) == 2])


@pytest.mark.parametrize("rate", [1.0, None])
def test_offset_and_rate_are_found_together_within_their_stated_uncertainty(rate):
    scores = []
    for seed in range(12):
        test = timed_test(seed, unloaded=True, late=(-1.0, 1.0))
        _, joined = joined_of(test, ImageClock(test.interval_s, offset_s=None, clock_rate=rate))
        clock = joined.clock
        offset, share = clock.offset_s - test.offset_s, clock.rate - test.rate
        covariance = np.outer([clock.offset_std_s, clock.rate_std], [clock.offset_std_s, clock.rate_std])
        covariance[0, 1] = covariance[1, 0] = clock.correlation * covariance[0, 1]
        assert clock.offset_std_s < test.interval_s
        scores.append(np.array([offset, share]) @ np.linalg.solve(covariance, [offset, share]))
    # The sum of 12 values of chi squared with two degrees of freedom: within 99.9 %.
    assert 7.0 < np.sum(scores) < 51.0


def test_a_rate_that_nothing_shows_is_refused_or_keeps_what_was_known():
    test = timed_test(0, unloaded=False)
    with pytest.raises(CurveError, match=r"find the clock's rate: .* give the rate with --clock-rate"):
        joined_of(test, ImageClock(test.interval_s, offset_s=None, clock_rate=None))
    _, joined = joined_of(test, ImageClock(test.interval_s, offset_s=None, clock_rate_std_percent=0.2))
    assert joined.clock.rate_std == pytest.approx(0.002, rel=0.02)
    assert (joined.clock.offset_from, joined.clock.rate_from) == ("found", "given")


@pytest.mark.parametrize("clock", [{}, AUTO])
def test_a_wrong_clock_is_within_the_stated_uncertainty(clock):
    tests = [timed_test(seed) for seed in range(6)]
    scores = z_scores(tests, lambda test: ImageClock(test.interval_s, **clock))
    assert np.abs(scores).max() < 3.5
    exact = ImageClock(1.0, offset_s=1.0, clock_rate=1.001).machine_clock(np.arange(9.0))
    assert (exact.offset_std_s, exact.rate_std) == (0.0, 0.0)
    assumed = ImageClock().machine_clock(2.0 * np.arange(9.0))
    # Uniform within one interval, and within 1 %.
    assert assumed.offset_std_s == pytest.approx(2.0 / np.sqrt(3.0))
    assert assumed.rate_std == pytest.approx(0.01 / np.sqrt(3.0))


@pytest.mark.extended
@pytest.mark.parametrize("clock", [{}, AUTO])
def test_deviations_of_many_tests_with_wrong_clocks_are_as_stated(clock):
    tests = [timed_test(seed, late=(-1.0, 1.0)) for seed in range(100, 200)]
    scores = z_scores(tests, lambda test: ImageClock(test.interval_s, **clock))
    assert len(scores) >= 95
    inside = np.count_nonzero(np.abs(scores) < 1.96, axis=0) / len(scores)
    rms = np.sqrt((scores**2).mean(axis=0))
    assert (inside > 0.90).all(), inside
    assert ((rms > 0.65) & (rms < 1.25)).all(), rms


def test_images_that_are_missing_by_their_numbers_count():
    for seed in range(3):
        test = timed_test(seed, rate_error=0.0, late=(0.0, 0.0))
        kept = np.flatnonzero(np.arange(len(test.strain)) % 9 != 8)
        exact = {"offset_s": 0.0, "offset_std_s": 0.0, "clock_rate_std_percent": 0.0}
        found, joined = properties_of(test.kept(kept), ImageClock(test.interval_s, **exact), kept + 1)
        # The times are the true ones, so only the noise is left.
        np.testing.assert_allclose(joined.time_s, test.interval_s * (kept + 1), atol=1e-9)
        lost = len(test.strain) - len(kept)
        lost -= int(kept[-1] < len(test.strain) - 1)  # the last image leaves no gap
        assert joined.lost.startswith(f"{lost} images are missing, as the numbers in the file names show: 1")
        assert joined.lost in joined.text
        assert abs(found.values["E_gpa"].value - test.e_gpa) < 3.5 * found.values["E_gpa"].std


def test_images_that_are_missing_by_their_times_count_and_are_named():
    test = timed_test(4, rate_error=0.0, late=(0.0, 0.0))
    kept = np.flatnonzero(np.arange(len(test.strain)) % 9 != 8)
    clock = ImageClock(test.interval_s)
    jitter = test.interval_s * np.random.default_rng(1).uniform(-0.1, 0.1, len(kept))
    _, joined = joined_of(test.kept(kept), clock, known=test.image_s[kept] + jitter)
    # A gap just before the end cannot be told from an image that was written late.
    np.testing.assert_allclose(joined.time_s[:-9], test.image_s[kept][:-9], atol=1e-9)
    assert "images are missing, as the times of the images show: 1 between img_0008.tif" in joined.lost
    # Times of copies say nothing about the test.
    copied = np.cumsum(np.random.default_rng(2).exponential(0.01, len(kept)))
    _, joined = joined_of(test.kept(kept), clock, known=copied)
    assert "times" not in joined.lost


def test_no_image_is_missing_in_clean_series():
    for seed in range(100):
        rng = np.random.default_rng(seed)
        count, interval_s = int(rng.integers(40, 200)), rng.uniform(0.2, 5.0)
        times_s = interval_s * np.arange(count)
        late = (
            rng.uniform(-0.1, 0.1, count),
            # Some files are written late, by up to two intervals.
            rng.exponential(0.05, count) + (rng.random(count) < 0.02) * rng.uniform(0.3, 2.0, count),
            4.0 * np.maximum(np.arange(count) - count // 2, 0.0) + rng.uniform(-0.1, 0.1, count),
        )[seed % 3]
        clean = np.maximum.accumulate(times_s + interval_s * late)
        assert not lost_by_time(clean).any(), seed
        gone = np.delete(clean, np.arange(8, count, 9))
        assert lost_by_time(gone).any(), seed
        test = timed_test(seed)
        assert not lost_by_strain(test.strain).any(), seed


def test_a_jump_of_strain_suggests_a_missing_image():
    test = timed_test(1)
    strain = np.delete(1e-4 * np.arange(40.0), 20) + np.random.default_rng(3).normal(0.0, 5e-6, 39)
    images = series_of(test.kept(slice(0, 39))).images
    lost = ImageClock(1.0).lost(images, np.arange(1.0, 40.0), strain)
    assert (
        lost == "1 image is missing, as jumps of the strain suggest: 1 between img_0020.tif and img_0021.tif"
    )


@pytest.mark.parametrize(
    ("names", "places"),
    [
        (["a7.tif", "a8.tif", "a10.tif"], [0, 1, 3]),
        (["x/a010.tif", "x/a020.tif", "x/a050.tif"], [0, 1, 4]),
        (["film.avi#1", "film.avi#2", "film.avi#4"], [0, 1, 3]),
        (["a1.tif", "b2.tif"], None),
        (["load_100.tif", "load_200.tif", "load_350.tif"], None),
        (["a2.tif", "a1.tif"], None),
        (["start.tif", "end.tif"], None),
        # Times of day: one second apart.
        (["t_120058.tif", "t_120059.tif", "t_120100.tif"], None),
    ],
)
def test_numbers_in_names_give_places(names, places):
    found = places_of(names)
    assert (None if found is None else found.tolist()) == places


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"offset_s": None, "offset_std_s": 1.0}, "beside a number for --offset-s"),
        ({"offset_std_s": -1.0}, "--offset-std-s: expected at least 0 s"),
        ({"clock_rate": 101.0}, "--clock-rate: expected between 0.5 and 2, got 101"),
        ({"clock_rate_std_percent": 50.0}, "--clock-rate-std-percent: expected from 0 % to 10 %"),
        ({"offset_s": np.nan}, "--offset-s: expected a number of seconds, got nan"),
    ],
)
def test_impossible_clocks_are_refused(given, words):
    with pytest.raises(CurveError, match=words):
        ImageClock(1.0, **given)
