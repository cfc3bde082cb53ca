"""Tests that a pattern that repeats is found, and that no displacement is wrong by whole periods."""

import numpy as np
import pytest

from dic.correlation.correlator import Correlator
from dic.correlation.initial_guess import rigid_motion
from dic.correlation.repetition import find_repetition
from dic.correlation.series import Series
from dic.correlation.settings import CorrelationSettings
from dic.correlation.status import Status
from dic.errors import CorrelationError
from dic.image.stored import StoredImage
from tests.dic.correlation.lattices import KINDS, halftone, image, lattice, speckles, vectors

SHAPE = (300, 300)
SMALL = CorrelationSettings(subset_px=31, step_px=10)
ALL = np.ones(SHAPE, bool)


def repetition_in(grey):
    return find_repetition(StoredImage(grey.astype(np.float32)), np.ones(grey.shape, bool))


def check_vectors(found, true):
    """Check that vectors are the shortest ones of a lattice, and that they take the lattice to itself."""
    for vector in found:
        lengths = np.hypot(*true.T)
        assert np.abs(np.hypot(*vector) / lengths - 1).min() < 0.02
        multiples = vector @ np.linalg.pinv(true)
        np.testing.assert_allclose(multiples, np.rint(multiples), atol=0.02)


def wrong_points(field, motion, gradient=((0.0, 0.0), (0.0, 0.0)), limit_px=1.0):
    """Return the number of points whose displacement is wrong by more than a limit."""
    x, y = np.meshgrid(field.x_px, field.y_px)
    shift = np.array(motion) - np.array(gradient) @ np.array(motion) * 0.0
    u, v = np.einsum("ab,bij->aij", np.array(gradient), np.stack([x, y]).astype(float)) + shift[:, None, None]
    error = np.hypot(field.u_px - u, field.v_px - v)
    return np.count_nonzero(error[field.converged] > limit_px)


@pytest.mark.parametrize("kind", KINDS)
def test_the_periods_of_a_lattice_are_measured(kind):
    angle = 0.3
    found = repetition_in(image(lattice(kind, 13.0, angle, irregular=0.01), SHAPE))
    true = vectors(kind, 13.0, angle)
    assert len(found.vectors) == len(true)
    check_vectors(found.vectors, true)
    for vector, direction in zip(found.vectors, found.directions_deg, strict=True):
        assert direction == pytest.approx(np.degrees(np.arctan2(-vector[1], vector[0])) % 180)


@pytest.mark.parametrize("size_px", [2, 6, 20])
def test_random_speckles_do_not_repeat(size_px):
    rng = np.random.default_rng(size_px)
    assert repetition_in(image(speckles(size_px, rng), SHAPE)) is None


def test_a_lattice_is_declined_because_it_may_have_moved_by_another_period():
    pattern = lattice("hexagonal", 14.0, 0.2)
    field = Correlator(image(pattern, SHAPE), ALL, SMALL).correlate(
        image(pattern, SHAPE, (14.6, 3.0), seed=2)
    )
    assert not field.converged.any()
    assert field.count(Status.REPEATING) > 0.9 * field.in_view
    assert "every 14.0 px" in field.repetition


def test_a_hint_near_the_motion_decides_and_another_does_not():
    pattern, motion = lattice("plain", 12.0, 0.1), (30.2, -4.7)
    correlator = Correlator(image(pattern, SHAPE), ALL, SMALL)
    deformed = image(pattern, SHAPE, motion, seed=2)
    field = correlator.correlate(deformed, hint=rigid_motion(0.0, (31.0, -5.5), (0, 0)))
    assert field.converged.sum() > 0.9 * field.in_view
    assert wrong_points(field, motion) == 0
    assert "hint decides" in field.repetition
    # Half a period off, and in a run the angle of a stage, which does not know the place of its axis
    assert not correlator.correlate(deformed, hint=rigid_motion(0.0, (36.2, -4.7), (0, 0))).converged.any()
    turning = Correlator(image(pattern, SHAPE), ALL, SMALL, hint_decides=False)
    assert not turning.correlate(deformed, hint=rigid_motion(0.0, motion, (0, 0))).converged.any()


@pytest.mark.parametrize("evidence", ["bright yarns", "marks", "half random"])
def test_what_does_not_repeat_shows_the_right_period(evidence):
    rng, gradient, motion = np.random.default_rng(4), ((0.004, 0.001), (0.001, -0.003)), (26.0, -13.5)
    regular = lattice("twill", 7.0, 0.2, rng, brightness=0.2 if evidence == "bright yarns" else 0.0)
    others = speckles(6.0, rng)

    def pattern(x, y):
        if evidence == "marks":
            marked = (np.hypot(x - 100, y - 180) < 18) | (np.hypot(x - 200, y - 90) < 14)
            return np.where(marked, 0.1, regular(x, y))
        return np.where(x < 130, others(x, y), regular(x, y)) if evidence == "half random" else regular(x, y)

    field = Correlator(image(pattern, SHAPE), ALL, SMALL).correlate(
        image(pattern, SHAPE, motion, gradient, seed=2)
    )
    assert field.converged.sum() > 0.9 * field.in_view
    assert wrong_points(field, motion, gradient) == 0
    assert "rest of the pattern" in field.repetition


def test_a_halftone_print_is_measured():
    rng, motion = np.random.default_rng(5), (11.3, -4.2)
    pattern = halftone(9.0, 6.0, 0.4, rng)
    field = Correlator(image(pattern, SHAPE), ALL, SMALL).correlate(image(pattern, SHAPE, motion, seed=2))
    assert field.converged.sum() > 0.95 * field.in_view
    assert wrong_points(field, motion) == 0


def test_uneven_light_that_stays_does_not_decide():
    x = np.arange(SHAPE[1])
    light = 1 - 0.4 * ((x - 150) / 150) ** 2
    first, second = (image(lattice("square", 16.0), SHAPE, motion) * light for motion in ((0, 0), (16.3, 0)))
    field = Correlator(first.astype(np.uint8), ALL, SMALL).correlate(second.astype(np.uint8))
    assert not field.converged.any()


def test_an_image_without_a_displacement_becomes_no_reference():
    pattern = lattice("square", 15.0)
    series = Series(image(pattern, SHAPE), ALL, SMALL)
    for k in (1, 2):
        assert not series.correlate(image(pattern, SHAPE, (0.4 * k, 0.0), seed=k + 1)).converged.any()
    always = Series(image(pattern, SHAPE), ALL, SMALL, incremental="always")
    always.correlate(image(pattern, SHAPE, (0.4, 0.0), seed=2))
    with pytest.raises(CorrelationError, match="new reference"):
        always.correlate(image(pattern, SHAPE, (0.8, 0.0), seed=3))


def test_lines_are_named_although_they_are_no_specimen():
    with pytest.raises(CorrelationError, match=r"repeats every 11\.0 px"):
        Correlator(image(lattice("lines", 11.0, 0.4), SHAPE), settings=SMALL)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(60))
def test_no_lattice_is_measured_wrong(seed):
    rng, kind = np.random.default_rng(seed), KINDS[seed % len(KINDS)]
    period_px, angle = float(np.exp(rng.uniform(np.log(6), np.log(60)))), rng.uniform(0, np.pi / 4)
    irregular = rng.uniform(0, 0.02) * (seed % 3 > 0)
    pattern, along = lattice(kind, period_px, angle, rng, irregular), rng.uniform(0, 2 * np.pi)
    motion = rng.uniform(0, 4) * period_px * np.array([np.cos(along), np.sin(along)])
    gradient = rng.uniform(-0.01, 0.01, (2, 2))
    look = {"noise": rng.uniform(1, 3), "blur": rng.uniform(0, 1.2)}
    shape = (420, 420)
    correlator = Correlator(image(pattern, shape, **look), np.ones(shape, bool))
    check_vectors(correlator.repetition.vectors, vectors(kind, period_px, angle))
    try:
        field = correlator.correlate(image(pattern, shape, motion, gradient, **look, seed=2))
        said, wrong = field.repetition, wrong_points(field, motion, gradient, 0.4 * period_px)
    except CorrelationError as error:
        said, wrong = str(error), 0
    assert str(correlator.repetition) in said
    assert wrong == 0


@pytest.mark.long
@pytest.mark.parametrize("seed", range(20))
def test_every_halftone_print_is_measured(seed):
    rng, shape = np.random.default_rng(100 + seed), (420, 420)
    pattern = halftone(rng.uniform(5, 15), rng.uniform(3, 8), rng.uniform(0, np.pi / 4), rng)
    motion, gradient = rng.uniform(-25, 25, 2), rng.uniform(-0.01, 0.01, (2, 2))
    look = {"noise": rng.uniform(1, 3), "blur": rng.uniform(0, 1.2)}
    field = Correlator(image(pattern, shape, **look), np.ones(shape, bool)).correlate(
        image(pattern, shape, motion, gradient, **look, seed=2)
    )
    assert field.converged.sum() > 0.95 * field.in_view
    assert wrong_points(field, motion, gradient) == 0


@pytest.mark.long
def test_of_three_hundred_random_patterns_none_repeats():
    for seed in range(300):
        rng = np.random.default_rng(1000 + seed)
        pattern = speckles(rng.uniform(2, 20), rng)
        grey = image(pattern, tuple(rng.integers(150, 500, 2)), noise=rng.uniform(0, 5))
        sharp = np.where(grey > 140, 200, 60).astype(np.uint8)
        assert repetition_in(sharp if seed % 2 else grey) is None, seed
