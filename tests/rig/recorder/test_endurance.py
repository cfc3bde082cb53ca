"""Tests of the recorder and of acquisitions in real time, with functions of the benchmarks."""

from pathlib import Path

import pytest

from benchmarks.acquire import acquire, is_good as acquired_all
from benchmarks.endurance import endure, is_good
from benchmarks.recorder import LEAST_RATIO, compare


@pytest.mark.extended
def test_every_image_of_a_short_run_is_recorded_and_read_back(tmp_path):
    figures = endure(tmp_path / "run.h5", minutes=0.05, recycle=False)
    assert figures["images_checked"] == {"left": 15, "right": 15}
    assert is_good(figures)


@pytest.mark.long
@pytest.mark.realtime
@pytest.mark.timeout(3600)
def test_thirty_real_minutes_of_two_cameras(tmp_path):
    figures = endure(tmp_path / "run.h5", minutes=30.0, recycle=True)
    assert is_good(figures), figures


@pytest.mark.long
@pytest.mark.realtime
@pytest.mark.timeout(1800)
def test_recorder_is_nearly_as_fast_as_plain_writing(tmp_path: Path) -> None:
    assert compare(tmp_path, rounds=9, count=200) >= LEAST_RATIO


@pytest.mark.extended
@pytest.mark.realtime
@pytest.mark.parametrize("keep_s", [None, 2.0])
def test_an_acquisition_of_two_large_cameras_and_eight_channels_loses_nothing(tmp_path, keep_s):
    figures = acquire(tmp_path / "run.h5", 5.0, keep_s)
    # On a busy computer an image may be late, but none is lost or wrong. The queues still fill in this time.
    assert acquired_all(figures | {"late": 0, "memory_growth_mb": 0.0}), figures


@pytest.mark.long
@pytest.mark.realtime
@pytest.mark.timeout(3600)
def test_five_minutes_of_an_acquisition(tmp_path):
    figures = acquire(tmp_path / "run.h5", 300.0)
    assert acquired_all(figures), figures


@pytest.mark.long
@pytest.mark.realtime
@pytest.mark.timeout(7200)
def test_thirty_minutes_of_an_acquisition_into_a_ring_of_five(tmp_path):
    figures = acquire(tmp_path / "run.h5", 1800.0, 300.0)
    assert acquired_all(figures), figures
