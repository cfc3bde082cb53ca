"""Tests of interpolation bias and smoothing in result files, and in files of versions without them."""

import h5py
import numpy as np
import pytest

from benchmarks.speckle import Speckle, shift
from dic import CorrelationSettings, Correlator, measure
from dic.correlation.series_state import SeriesFields
from dic.results.finished import FinishedImage
from dic.results.provenance import Provenance
from dic.results.reader import read_measurements
from dic.results.schema import CameraLayout
from dic.results.writer import ResultWriter

SMOOTHING_PX = 0.4


@pytest.fixture(scope="module")
def measured():
    speckle = Speckle(seed=8, shape=(140, 140), sigma_px=(0.6, 0.8), density=0.22)
    still, moved = (speckle.draw(shift(u, 0.1)).astype(np.float32) for u in (0.0, 0.3))
    settings = CorrelationSettings(21, 10, smoothing_px=SMOOTHING_PX)
    return measure(Correlator(still, settings=settings).correlate(moved))


@pytest.fixture
def path(measured, tmp_path):
    with ResultWriter(tmp_path / "r.h5", Provenance.of([])) as writer:
        layout, fields = CameraLayout.of(""), SeriesFields(measured.field)
        writer.add_field(layout, FinishedImage(measured.label, fields=fields))
        writer.add(layout, measured)
        writer.finish()
    return tmp_path / "r.h5"


def test_what_was_written_is_read(measured, path):
    with h5py.File(path) as file:
        (read,) = read_measurements(file["series"], None)
        stored = file["series/std_u_px"][0]
    np.testing.assert_array_equal(stored, measured.field.std_u_px)
    assert read.settings == measured.settings
    assert read.field.smoothing_px == SMOOTHING_PX
    assert read.field.greatest_bias_px == measured.field.greatest_bias_px
    np.testing.assert_array_equal(read.field.bias_px, measured.field.bias_px)
    np.testing.assert_array_equal(read.field.noise_std_px, measured.field.noise_std_px)
    np.testing.assert_allclose(read.field.std_v_px, measured.field.std_v_px, rtol=1e-12)
    ours, theirs = (m.summary()["interpolation"] for m in (read, measured))
    assert ours == pytest.approx(theirs, rel=1e-12)


def test_a_file_of_the_time_before_is_read_as_not_smoothed(measured, path):
    with h5py.File(path, "r+") as file:
        series = file["series"]
        for name in ("bias_u_px", "bias_v_px", "greatest_bias_px", "smoothing_px", "noise_std_px"):
            del series[name]
        del series.attrs["smoothing_px"]
    with h5py.File(path) as file:
        (read,) = read_measurements(file["series"], None)
    assert read.settings.smoothing_px == read.field.smoothing_px == 0.0
    assert not read.field.bias_px[read.field.converged].any()
    np.testing.assert_array_equal(read.field.std_u_px, measured.field.std_u_px)
