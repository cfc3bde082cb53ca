"""The motion between two fields: what is expected, and how uncertain its age makes it."""

from dataclasses import replace

import numpy as np
import pytest

from dic.live import Bend, FieldMotion, SharedErrors
from dic.live.motion import VALUES, MotionTrack
from dic.out_of_plane.plane import Plane

NONE = np.zeros((3, 3))
ERRORS = SharedErrors(NONE, NONE, NONE, np.zeros((3, 0)))
BY_VALUES = np.eye(3, VALUES)


def motion(time_s, slope):
    return FieldMotion(time_s, Plane(slope), Bend(), ERRORS)


def test_a_steady_motion_goes_on_and_becomes_certain():
    track = MotionTrack(0.0)
    for k in range(1, 8):
        track.take(motion(float(k), 1e-3 * k), BY_VALUES)
    values, covariance = track.at(7.5)
    assert values[0] == pytest.approx(7.5e-3)
    assert np.sqrt(covariance[0, 0]) < 1e-4
    assert track.age_s(7.5) == 0.5


def test_a_motion_to_and_fro_is_held_and_its_error_grows_with_its_age():
    track = MotionTrack(0.0)
    for k in range(1, 8):
        track.take(motion(float(k), 1e-3 * (-1) ** k), BY_VALUES)
    values, covariance = track.at(7.5)
    assert values[0] == pytest.approx(-1e-3)
    assert np.sqrt(covariance[0, 0]) == pytest.approx(0.5 * 2e-3, rel=0.2)
    assert np.sqrt(track.at(8.0)[1][0, 0]) == pytest.approx(2 * np.sqrt(covariance[0, 0]))


def test_one_field_at_the_time_of_the_reference_tells_no_rate():
    track = MotionTrack(0.0)
    track.take(motion(0.0, 0.0), BY_VALUES)
    assert np.isnan(track.at(0.5)[1]).all()
    track.take(motion(1.0, 2e-3), BY_VALUES)
    assert np.sqrt(track.at(2.0)[1][0, 0]) == pytest.approx(2e-3)


def test_a_declined_or_older_field_changes_nothing():
    track = MotionTrack(0.0)
    track.take(motion(1.0, 1e-3), BY_VALUES)
    track.take(replace(motion(2.0, 9e-3), declined="it necks"), BY_VALUES)
    track.take(motion(0.5, 9e-3), BY_VALUES)
    assert track.at(1.0)[0][0] == 1e-3


def test_a_bend_is_found_from_the_displacements_that_it_causes():
    rng, centre_mm = np.random.default_rng(2), np.array([0.5, 20.0, 35.0])
    mm = rng.uniform(-3, 3, (40, 2))
    height_mm = 1e-3 * mm[:, 0] ** 2 - 2e-3 * mm[:, 0] * mm[:, 1] + 1e-4 * mm[:, 1] + 2e-3
    displaced = height_mm[:, None] * (mm - centre_mm[:2]) / centre_mm[2]
    bend = Bend.of(displaced, mm, centre_mm)
    np.testing.assert_allclose(bend.heights(mm), height_mm, atol=1e-9)
    np.testing.assert_allclose(bend.displacement(mm, centre_mm), displaced, atol=1e-9)
