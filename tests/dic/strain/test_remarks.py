"""A picture that is torn, or the reference itself, is remarked on; other sharp changes of strain are not."""

import numpy as np
import pytest

from dic.correlation.correlator import Correlator
from dic.correlation.settings import CorrelationSettings
from dic.strain.remarks import remarks_on
from tests.conftest import SpecklePattern

SHAPE = (260, 200)


def field_of(u, noise: float = 1.0, seed: int = 1):
    """Correlate a drawn pattern with itself, moved to the right by u(x, y) in px."""
    pattern = SpecklePattern(seed=3, shape=SHAPE)
    rng = np.random.default_rng(seed)
    reference, deformed = (
        drawn + rng.normal(0.0, noise, SHAPE).astype(np.float32) if noise else drawn
        for drawn in (pattern.draw(), pattern.draw(lambda x, y: (x - u(x, y), y)))
    )
    return Correlator(reference, np.ones(SHAPE, bool), CorrelationSettings(21, 10)).correlate(deformed)


@pytest.mark.parametrize("jump_px", [0.3, -1.2])
def test_torn_picture_is_remarked_on_at_its_line(jump_px):
    (said,) = remarks_on(field_of(lambda x, y: 0.2 + 0.001 * x + np.where(y > 140, jump_px, 0.0)))
    # a subset over the line overshoots
    assert float(said.split("jump by ")[1].split()[0]) == pytest.approx(jump_px, rel=0.15)
    assert abs(float(said.split("y = ")[1].split()[0]) - 140) <= 10


@pytest.mark.parametrize(
    "u",
    [
        lambda x, y: 0.3 + 0.01 * x - 0.02 * y,
        lambda x, y: 2.0 / (1.0 + np.exp(-(y - 130) / 12.0)),
        lambda x, y: np.where(y > 60 + 0.5 * x, 0.6, 0.0),
        lambda x, y: np.where((y > 140) & (x > 100), 0.6, 0.0),
        lambda x, y: np.where(y > 24, 0.6, 0.0),
        lambda x, y: 0.0 * x,
    ],
    ids=["affine", "neck", "inclined crack", "half a crack", "background at the edge", "rest"],
)
def test_other_displacements_are_not_remarked_on(u):
    assert remarks_on(field_of(u)) == []


def test_reference_against_itself_is_remarked_on():
    (said,) = remarks_on(field_of(lambda x, y: 0.0 * x, noise=0.0))
    assert "the reference's own picture, or a copy of it" in said


def test_part_of_the_reference_in_a_picture_is_remarked_on():
    pattern = SpecklePattern(seed=3, shape=SHAPE)
    rng = np.random.default_rng(2)
    reference, deformed = (
        drawn + rng.normal(0.0, 1.0, SHAPE).astype(np.float32)
        for drawn in (pattern.draw(), pattern.draw(lambda x, y: (x, y - 0.004 * (y - 130))))
    )
    deformed[140:] = reference[140:]
    field = Correlator(reference, np.ones(SHAPE, bool), CorrelationSettings(21, 10)).correlate(deformed)
    assert (
        "of the points have not moved at all: a part of this picture is the reference's"
        in remarks_on(field)[0]
    )
