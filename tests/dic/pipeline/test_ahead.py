"""Images that are correlated ahead of their turn give the same bits as images one after the other."""

import pickle
import platform
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
import pytest

from dic.correlation.reference import Reference
from dic.correlation.series import Series
from dic.correlation.series_state import GUESS_DISTANCE, Attempt
from dic.correlation.settings import CorrelationSettings
from dic.errors import ImageError, ImageWarning, WorkerError, warn_of_image
from dic.pipeline.correlated import correlate_series, series_job
from dic.pipeline.image_task import ImageTask
from dic.pipeline.series_image import UNREADABLE, FileDigests, SeriesImage
from dic.workers.workers import ThreadWorker, Workers

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
    first, then = speckle(seed=71, shape=(80, 80), noise=1.0), speckle(seed=72, shape=(80, 80))
    pictures = [first.draw()]
    for k in range(1, 11):
        # From the fifth image on, the pattern consists more and more of another one.
        share = np.clip((k - 4) / 7, 0.0, 0.8)
        moved = [own.draw(lambda x, y, by=0.6 * k: (x - by, y), k) for own in (first, then)]
        pictures.append((1 - share) * moved[0] + share * moved[1])
    pictures[3] = speckle(seed=73, shape=(80, 80)).draw()
    pictures[9] = pictures[9][:60]
    return pictures


def outcomes(images, workers, incremental="auto"):
    series = Series(images[0], None, SETTINGS, incremental=incremental, threads=1)
    return list(correlate_series(series, images[1:], workers=workers))


@pytest.fixture(scope="module")
def alone(images):
    return outcomes(images, None)


def held_by(series):
    """Return the fields that a series itself keeps of its last image."""
    return series._current.last.fields.args


def require_equal(some, others):
    """Compare all outcomes bit for bit."""
    for one, other in zip(some, others, strict=True):
        assert (one.label, one.failure) == (other.label, other.failure)
        if one.fields is not None:
            for name in ("warps", "std", "zncc", "iterations", "status"):
                np.testing.assert_array_equal(getattr(one.field, name), getattr(other.field, name))
            assert (one.field.start, one.field.updates) == (other.field.start, other.field.updates)


@pytest.mark.parametrize("kind", [pytest.param(Eager, marks=pytest.mark.extended), Late])
def test_judging_in_order_makes_the_bits_independent_of_the_workers(images, alone, kind):
    assert max(each.field.updates for each in alone if each.fields) > 0
    assert [each.failure is None for each in alone] == [k not in (3, 9) for k in range(1, 11)]
    require_equal(alone, outcomes(images, kind()))


@pytest.mark.parametrize("begun", [pytest.param(0, marks=pytest.mark.extended), 6])
@pytest.mark.parametrize("kind", [pytest.param(None, marks=pytest.mark.extended), Eager])
def test_fields_on_disk_are_used_if_their_image_becomes_a_reference(images, alone, kind, begun):
    found, workers = [], None if kind is None else kind()
    for stop in filter(None, (begun, len(images) - 1)):
        series, before = Series(images[0], None, SETTINGS, threads=1), found
        found, stored = [], []
        for outcome in correlate_series(series, images[1 : stop + 1], before, stored.__getitem__, workers):
            assert outcome.fields not in held_by(series)
            found.append(outcome)
            stored += [] if outcome.fields is None else [outcome.fields]
    require_equal(alone, found)


@pytest.mark.parametrize("large", [False, True])
def test_thread_correlates_only_small_images_ahead(images, alone, large, monkeypatch):
    submitted = []

    class Counting(ThreadWorker):
        def submit(self, fn, /, *args, **kwargs):
            submitted.append(fn)
            return super().submit(fn, *args, **kwargs)

    monkeypatch.setattr("dic.pipeline.ahead.is_large", lambda shape: large)
    with Counting() as thread:
        require_equal(alone, outcomes(images, thread))
    assert bool(submitted) != large


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


class Elsewhere(Eager):
    """As `Eager`, but the task believes that it runs in another process than the command."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        assert isinstance(fn, ImageTask)
        return super().submit(replace(fn, image=replace(fn.image, made_in=("elsewhere", 0))))


class Unsteady:
    """An image that cannot be read the first time, or never; `found` is the digest that a worker finds."""

    def __init__(self, image: np.ndarray | None, found: str = "") -> None:
        self._image, self._found, self._readings = image, found, 0

    def __call__(self) -> np.ndarray:
        self._readings += 1
        if self._readings == 1 or self._image is None:
            raise ImageError("img.png", "read image", "an image", "no such file", "put it back")
        return self._image

    def digest(self) -> str:
        return self._found


def failures(images, image, workers):
    """Return the reasons for failures in a series of three images, of which the second one is `image`."""
    given = [images[0], SeriesImage(images[1], "1"), image, SeriesImage(images[2], "3")]
    return [found.failure for found in outcomes(given, workers, "never")]


def test_image_that_the_worker_could_not_read_is_correlated_by_the_program(images):
    assert failures(images, Unsteady(images[2]), Eager()) == [None] * 3


@pytest.mark.parametrize(("known", "found"), [("0" * 64, UNREADABLE), (UNREADABLE, "0" * 64)])
def test_image_that_the_program_cannot_read_fails_alone_whatever_the_worker_finds(images, known, found):
    image = SeriesImage(Unsteady(None, found), "2", digest=known)
    first, failure, last = failures(images, image, Elsewhere())
    assert (first, last) == (None, None)
    assert "no such file; put it back" in failure


class Doubtful:
    """An image whose reader gives a warning each time."""

    def __init__(self, image: np.ndarray) -> None:
        self._image = image

    def __call__(self) -> np.ndarray:
        warn_of_image("img.png", "a doubtful image")
        return self._image


def test_image_that_becomes_a_reference_has_its_warning_once(images):
    pictures = [images[0], *(Doubtful(image) for image in images[1:3])]
    with pytest.warns(ImageWarning, match="a doubtful image") as given:
        found = outcomes(pictures, None, "always")
    assert found[1].field.updates == 1
    assert len(given) == 2


def test_image_that_is_correlated_twice_has_its_warning_once(images):
    # The second picture shows something else, so the attempt from the last image's field follows.
    pictures = [images[0], images[1], Doubtful(images[3]), images[2]]
    workers = Eager()
    with pytest.warns(ImageWarning, match="a doubtful image") as given:
        outcomes(pictures, workers, "never")
    assert workers.done > len(pictures) - 1
    assert len(given) == 1


@pytest.mark.parametrize("found", [UNREADABLE, "1" * 64])
def test_worker_with_other_files_ends_the_series(images, found):
    steady = Unsteady(images[2], found)
    with pytest.raises(ImageError):
        steady()
    with pytest.raises(WorkerError, match="give all workers the same files"):
        failures(images, SeriesImage(steady, "2", digest="0" * 64), Elsewhere())


def test_worker_reads_a_file_again_for_its_digest_only_if_the_file_has_changed(tmp_path):
    path = tmp_path / "img.png"
    path.write_bytes(b"one")
    _, identity = FileDigests().identified(path)
    # A wrong digest shows whether the file is read.
    here, elsewhere = ((node, 0) for node in (platform.node(), "elsewhere"))
    image = SeriesImage(path, "1", digest="0" * 64, identity=identity, made_in=here)
    assert image.read() == path
    with pytest.raises(WorkerError, match="another one"):
        replace(image, made_in=elsewhere).read()
    path.write_bytes(b"another")
    with pytest.raises(WorkerError, match="another one"):
        image.read()


def test_image_whose_file_has_changed_since_its_digest_is_refused(tmp_path):
    path = tmp_path / "img.png"
    path.write_bytes(b"one")
    digest, identity = FileDigests().identified(path)
    image = SeriesImage(path, "1", digest=digest, identity=identity)
    assert image.read() == path
    path.write_bytes(b"another")
    with pytest.raises(ImageError, match="got another one; write each image to a file of its own"):
        image.read()


def test_reference_that_cannot_be_read_is_told_as_a_file_that_is_unread(images):
    reference = Reference(Unsteady(None), lambda: None, SETTINGS, clip=False)
    answer = ImageTask.of(Attempt(reference, None, None), SeriesImage(images[1], "1"))()
    assert answer.unread
    assert isinstance(answer.error, ImageError)


def test_job_names_the_rule_of_first_guesses(images):
    job = series_job(Series(images[0], None, SETTINGS, threads=1), "0" * 64, "auto")
    assert str(GUESS_DISTANCE) in job["first guesses"]


class Counted:
    """An image that can be pickled, and counts how often it is read in this process."""

    readings: ClassVar[list[int]] = []

    def __init__(self, seed: int) -> None:
        self._seed = seed

    def __call__(self) -> np.ndarray:
        self.readings.append(self._seed)
        return np.random.default_rng(self._seed).uniform(0.0, 255.0, (60, 60))


def whole() -> np.ndarray:
    """Return the region of a whole image of `Counted`."""
    return np.ones((60, 60), bool)


@pytest.mark.parametrize("together", [1, 3])
def test_worker_prepares_the_reference_of_each_series_once_and_forgets_others(together):
    # The seeds of the two cases differ, because references of the first case may still be kept.
    Counted.readings.clear()
    seeds = [100 * together + k for k in range(2 * together + 1)]
    sent = [Reference(Counted(seed), whole, SETTINGS, clip=False) for seed in seeds[:together]]
    deformed = SeriesImage(Counted(7), "1")
    messages = [pickle.dumps(ImageTask.of(Attempt(one, None, None), deformed, together)) for one in sent]
    for message in messages * 3:
        pickle.loads(message)()
    assert [seed for seed in Counted.readings if seed != 7] == seeds[:together]
    # New references take the places of the old ones.
    later = [Reference(Counted(seed), whole, SETTINGS, clip=False) for seed in seeds[together:]]
    for one in later:
        pickle.loads(pickle.dumps(ImageTask.of(Attempt(one, None, None), deformed, together)))()
    pickle.loads(messages[0])()
    assert Counted.readings.count(seeds[0]) == 2
