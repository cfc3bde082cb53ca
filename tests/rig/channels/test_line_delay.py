"""The delay of a channel against a camera's line is that of a simulated line, within its uncertainty."""

import math
from itertools import product

import numpy as np
import pytest

from rig.channels.delay import Delay
from rig.channels.line_delay import edges_of_line, find_line_delay

EXPOSURE_S = 0.05
GRIDS = ("locked", "drifting", "irregular")
JITTERS = ("none", "uniform", "normal")


def exposures(rng, grid: str, interval_s: float, count: int) -> np.ndarray:
    """Return when exposures begin: on the samples' own grid, near it, or when somebody triggers them."""
    if grid == "irregular":
        return 0.4 + np.cumsum(rng.uniform(0.12, 0.5, count))
    faster = 1.0 + (2e-5 * rng.normal() if grid == "drifting" else 0.0)
    return 0.4 + rng.uniform(0.0, interval_s) + faster * interval_s * np.arange(count)


def jitter_s(rng, kind: str, count: int) -> np.ndarray:
    if kind == "none":
        return np.zeros(count)
    return 0.02 * (rng.uniform(size=count) - 0.5) if kind == "uniform" else 0.004 * rng.normal(size=count)


def sampled(rng, begins_s, delays_s, step_s: float):
    """Return the times and the voltages of samples of the line, which is high during each exposure."""
    times_s = np.arange(0.0, begins_s[-1] + 1.0, step_s)
    volts = 0.05 * rng.normal(size=len(times_s))
    for on_s in begins_s + delays_s:
        volts[(times_s >= on_s) & (times_s < on_s + EXPOSURE_S)] += 5.0
    return times_s, volts


def error_of(rng, grid: str, kind: str, step_s: float) -> tuple[float, Delay]:
    interval_s, count = float(rng.choice([0.1, 0.2])), int(rng.integers(12, 150))
    # of regular frames, nobody can tell delays that differ by a whole interval
    delay_s = rng.uniform(0.0, 0.2 if grid == "irregular" else 0.8 * interval_s - 0.03)
    begins_s = exposures(rng, grid, interval_s, count)
    times_s, volts = sampled(rng, begins_s, delay_s + jitter_s(rng, kind, count), step_s)
    line = edges_of_line(times_s, volts, rising=True)
    told_s = begins_s + rng.choice([0.0, 5e-4]) * rng.normal(size=count)
    found = find_line_delay(told_s, line, (times_s[0], times_s[-1]))
    assert isinstance(found, Delay), found
    return found.delay_s - delay_s, found


def test_the_delay_is_within_two_of_its_standard_deviations_in_95_of_100():
    """Also if each edge lies at the same place between two samples, and whatever the delays' distribution."""
    rng = np.random.default_rng(1)
    within = []
    for _ in range(5):
        for grid, kind, step_s in product(GRIDS, JITTERS, (0.002, 0.01, 0.02)):
            error_s, found = error_of(rng, grid, kind, step_s)
            within.append(abs(error_s) <= 2.0 * found.mean_std_s)
            # and it is worth something
            assert found.mean_std_s < 0.6 * step_s + 0.004
    assert np.mean(within) >= 0.95


def test_many_edges_at_all_places_tell_far_more_than_one():
    rng = np.random.default_rng(4)
    error_s, found = error_of(rng, "irregular", "none", 0.02)
    assert found.mean_std_s < 0.002
    assert abs(error_s) < 0.005
    assert found.jitter_s < 0.003


def test_the_jitter_is_found():
    rng = np.random.default_rng(5)
    begins_s = exposures(rng, "irregular", 0.1, 140)
    times_s, volts = sampled(rng, begins_s, 0.08 + jitter_s(rng, "uniform", 140), 0.002)
    found = find_line_delay(begins_s, edges_of_line(times_s, volts, rising=True), (0.0, times_s[-1]))
    assert found.jitter_s == pytest.approx(0.02 / math.sqrt(12.0), rel=0.2)
    assert found.delay_std_s == pytest.approx(found.jitter_s, rel=0.05)
    assert found.others_s == ()


def test_delays_that_differ_by_whole_intervals_are_told_for_regular_frames():
    rng = np.random.default_rng(6)
    begins_s = exposures(rng, "locked", 0.1, 100)
    times_s, volts = sampled(rng, begins_s, np.full(100, 0.03), 0.002)
    found = find_line_delay(begins_s, edges_of_line(times_s, volts, rising=True), (0.0, times_s[-1]))
    assert found.delay_s == pytest.approx(0.03, abs=0.002)
    assert found.others_s[:2] == pytest.approx([0.13, 0.23], abs=0.003)


def test_a_counter_shows_pulses_that_are_shorter_than_its_samples():
    rng = np.random.default_rng(7)
    begins_s = exposures(rng, "irregular", 0.1, 100)
    times_s = np.arange(0.0, begins_s[-1] + 1.0, 0.05)
    counts = np.searchsorted(begins_s + 0.012, times_s).astype(float) + 1234.0
    found = find_line_delay(begins_s, edges_of_line(times_s, counts, rising=True), (0.0, times_s[-1]))
    assert found.delay_s == pytest.approx(0.012, abs=2.0 * found.mean_std_s)
    assert found.mean_std_s < 0.004


def test_a_line_that_is_active_at_its_low_level_has_falling_edges():
    rng = np.random.default_rng(8)
    begins_s = exposures(rng, "irregular", 0.1, 60)
    times_s, volts = sampled(rng, begins_s, np.full(60, 0.03), 0.002)
    falling = edges_of_line(times_s, 5.0 - volts, rising=False)
    found = find_line_delay(begins_s, falling, (0.0, times_s[-1]))
    assert found.delay_s == pytest.approx(0.03, abs=0.001)


def test_what_cannot_be_measured_is_told():
    rng = np.random.default_rng(9)
    begins_s = exposures(rng, "irregular", 0.1, 60)
    times_s, volts = sampled(rng, begins_s, np.full(60, 0.03), 0.002)
    line, span_s = edges_of_line(times_s, volts, rising=True), (0.0, times_s[-1])
    assert edges_of_line(times_s, np.full(len(times_s), 1.0), rising=True) is None
    assert "4 exposures, and at least 8 are needed" in find_line_delay(begins_s[:4], line, span_s)
    others_s = exposures(np.random.default_rng(10), "irregular", 0.1, 60)
    assert "only a part of the 60 exposures is in the channel" in find_line_delay(others_s, line, span_s)
