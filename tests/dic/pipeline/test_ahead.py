"""Images that are correlated ahead of their turn give the same bits as images one after the other."""

from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

import numpy as np
import pytest

from dic.correlation.series import Series
from dic.correlation.series_state import GUESS_DISTANCE
from dic.correlation.settings import CorrelationSettings
from dic.pipeline.correlated import correlate_series
from dic.workers.workers import Workers

SETTINGS = CorrelationSettings(subset_px=21, step_px=10)


class Eager(Workers):
    """Everything is done as soon as it is submitted, so before any earlier image has been judged."""

    count = 20

    def __init__(self) -> None:
        self.done = 0

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        self.done += 1
        future.set_result(fn(*args, **kwargs))
        return future


class Late(Workers):
    """Everything is done when its result is asked for, so what is withdrawn before is never done."""

    count = 20

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        class Lazy(Future[Any]):
            def result(self, timeout: float | None = None) -> Any:
                return fn(*args, **kwargs)

        return Lazy()


@pytest.fixture(scope="module")
def images(speckle):
    """A reference, images whose pattern changes in the middle, one of something else, and one too small."""
    first, then = speckle(seed=71, shape=(100, 100), noise=1.0), speckle(seed=72, shape=(100, 100))
    pictures = [first.draw()]
    for k in range(1, 11):
        # From the fifth image on, the pattern consists more and more of another one.
        share = np.clip((k - 4) / 7, 0.0, 0.8)
        moved = [own.draw(lambda x, y, by=0.6 * k: (x - by, y), k) for own in (first, then)]
        pictures.append((1 - share) * moved[0] + share * moved[1])
    pictures[3] = speckle(seed=73, shape=(100, 100)).draw()
    pictures[9] = pictures[9][:80]
    return pictures


def outcomes(images, workers, incremental="auto"):
    series = Series(images[0], None, SETTINGS, incremental=incremental, threads=1)
    return list(correlate_series(series, images[1:], workers=workers))


@pytest.fixture(scope="module")
def alone(images):
    return outcomes(images, None)


@pytest.mark.parametrize("kind", [Eager, Late])
def test_judging_in_order_makes_the_bits_independent_of_the_workers(images, alone, kind):
    ahead = outcomes(images, kind())
    assert max(each.field.updates for each in alone if each.fields) > 0
    assert [each.failure is None for each in alone] == [k not in (3, 9) for k in range(1, 11)]
    for one, other in zip(alone, ahead, strict=True):
        assert (one.label, one.failure) == (other.label, other.failure)
        if one.fields is not None:
            for name in ("warps", "std", "zncc", "iterations", "status"):
                np.testing.assert_array_equal(getattr(one.field, name), getattr(other.field, name))
            assert (one.field.start, one.field.updates) == (other.field.start, other.field.updates)


def test_images_of_a_plain_series_are_correlated_once(images):
    workers = Eager()
    plain = [images[0], *images[1:3] * 5]
    assert all(each.fields for each in outcomes(plain, workers, "never"))
    assert workers.done == 10


def test_guess_comes_from_the_same_image_before_and_after_an_interruption(images):
    plain = [images[0], *images[1:3] * 5]
    first, second = (Series(plain[0], None, SETTINGS, threads=1) for _ in range(2))
    fields = [first.correlate_fields(image) for image in plain[1:]]
    assert [each.from_first.start for each in fields].index("previous") == GUESS_DISTANCE
    for image, known in zip(plain[1:9], fields, strict=False):
        second.accept(lambda image=image: image, known)
    again = second.correlate(plain[9])
    np.testing.assert_array_equal(again.warps, fields[8].from_first.warps)
    assert again.start == "previous"
