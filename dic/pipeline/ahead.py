"""Correlates several images of a series at the same time, on threads, processes or other computers.

The first attempt to correlate an image mostly depends only on images that are finished. So the next images
can be correlated ahead of their turn, at the same time. Two decisions are made in the order of the images:
whether an attempt is good, and whether the reference changes. If a decision makes an attempt useless, this
attempt is withdrawn and another attempt is made. So the results do not depend on the number of workers.
"""

from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Future
from dataclasses import dataclass
from itertools import islice

from dic.correlation.field import Field
from dic.correlation.series import Series
from dic.correlation.series_state import Attempt
from dic.errors import MeasurementError, OutputError, WorkerError, warn_of_image
from dic.image.stored import is_large
from dic.pipeline.image_task import ImageAnswer, ImageTask
from dic.pipeline.series_image import SeriesImage
from dic.results.finished import FinishedImage
from dic.workers.workers import ThreadWorker, Workers


def outcomes(
    series: Series,
    images: Iterable[tuple[int, SeriesImage]],
    workers: Workers | None = None,
    together: int = 1,
) -> Iterator[tuple[int, SeriesImage, FinishedImage]]:
    """Correlate the images of a series; yield each with its number and its outcome, in their order.

    `images`: the images with their numbers. `workers`: the workers that correlate images ahead of their turn.
    By default, each image is correlated in this thread when the caller asks for it. With a `ThreadWorker`
    this is also done for large images. `together`: number of series that are correlated at the same time by
    the same workers.

    Raises `WorkerError` if the workers cannot correlate for a reason other than the image. Raises
    `OutputError` if the fields of an earlier image, which becomes a reference, cannot be read again.
    """
    # The fields of a large image, and those of the next one, would be in memory at the same time.
    alone = isinstance(workers, ThreadWorker) and is_large(series.shape)
    if workers is None or series.at_once == 1 or alone:
        for number, image in images:
            yield number, image, _outcome(series, image)
        return
    line, remaining = _Line(series, workers, together), iter(images)
    # One image is being evaluated. Others wait, so that no worker is idle while an evaluation takes long or
    # several workers finish together. The fields of large images need much memory.
    spare = 2 if workers.count == 1 or is_large(series.shape) else 2 + workers.count
    at_once = min(series.at_once, workers.count + spare)
    try:
        while True:
            for number, image in islice(remaining, at_once - len(line.waiting)):
                line.add(number, image)
            if not line.waiting:
                return
            yield line.next()
    finally:
        line.withdraw()


@dataclass(frozen=True)
class _Begun:
    """An attempt to correlate an image, running or finished; `number` is the image's number in `outcomes`."""

    number: int
    image: SeriesImage
    attempt: Attempt
    answer: Future[ImageAnswer]


class _Line:
    """The next images, each with the attempt that will probably be needed when it is the image's turn."""

    def __init__(self, series: Series, workers: Workers, together: int = 1) -> None:
        self._series, self._workers, self._together = series, workers, together
        self.waiting: deque[_Begun] = deque()
        """The attempts in the order of the images; it is the turn of the first image."""
        self._warned: set[tuple[str, str]] = set()

    def add(self, number: int, image: SeriesImage) -> None:
        """Begin the expected attempt to correlate a further image."""
        self.waiting.append(self._begun(number, image, self._expected(image, len(self.waiting))))

    def field(self, attempt: Attempt) -> Field:
        """Return the field from an attempt to correlate the first image, or raise the attempt's error."""
        first = self.waiting[0]
        if not attempt.equals(first.attempt):
            # Other attempts would be done before this one, so withdraw those that have not begun.
            self.withdraw()
            self.waiting[0] = first = self._begun(first.number, first.image, attempt)
        try:
            answer = first.answer.result()
        except WorkerError:
            raise
        except MeasurementError as error:
            # The worker could not begin, because it has no run file.
            raise _elsewhere(error) from error
        if answer.unread:
            return self._read_here(attempt, first.image, answer.error)
        # An image that is correlated twice is read twice, but has each warning once.
        for path, note in answer.warnings:
            if (path, note) not in self._warned:
                self._warned.add((path, note))
                warn_of_image(path, note)
        if answer.error is not None:
            raise answer.error
        assert answer.field is not None
        return self._series.completed(attempt, answer.field)

    def _read_here(self, attempt: Attempt, image: SeriesImage, error: MeasurementError | None) -> Field:
        """Return the field of an image that a worker could not read, although its files are not others.

        Raises `WorkerError` if the worker has other files than this program. Raises `MeasurementError` if
        this program cannot read the files either, or the image cannot be correlated. Only this image then
        fails.
        """
        grey = image.grey()
        _ = attempt.reference.prepared
        if isinstance(error, WorkerError):
            raise error
        return attempt.correlate(grey)

    def next(self) -> tuple[int, SeriesImage, FinishedImage]:
        """Remove the first image, and return its number, the image and its outcome."""
        first = self.waiting[0]
        outcome = _outcome(self._series, first.image, self)
        self._go_on()
        return first.number, first.image, outcome

    def _go_on(self) -> None:
        """Remove the first image; begin new attempts for images whose attempt is withdrawn or useless."""
        self.waiting.popleft()
        self._warned.clear()
        for ahead, begun in enumerate(self.waiting):
            attempt = self._expected(begun.image, ahead)
            if begun.answer.cancelled() or not attempt.equals(begun.attempt):
                begun.answer.cancel()
                self.waiting[ahead] = self._begun(begun.number, begun.image, attempt)

    def withdraw(self) -> None:
        """Withdraw all attempts that have not begun."""
        for begun in self.waiting:
            begun.answer.cancel()

    def _expected(self, image: SeriesImage, ahead: int) -> Attempt:
        return self._series.expected_attempt(ahead, image.hint)

    def _begun(self, number: int, image: SeriesImage, attempt: Attempt) -> _Begun:
        task = ImageTask.of(attempt, image, self._together)
        return _Begun(number, image, attempt, self._workers.submit(task))


def _elsewhere(error: MeasurementError) -> WorkerError:
    """Return the error for a worker that cannot read a file although this program could read it."""
    remedy = "give all workers the same files under the same paths"
    return WorkerError(f"a worker: {error.source}", error.step, error.expected, error.got, remedy)


def _outcome(series: Series, image: SeriesImage, line: _Line | None = None) -> FinishedImage:
    try:
        if line is None:
            fields = series.correlate_image(image.read, image.hint, image.state)
        else:
            fields = series.follow(line.field, image.read, image.hint)
    except (OutputError, WorkerError):
        # The image is not the reason.
        raise
    except MeasurementError as error:
        return FinishedImage(image.label, image.digest, failure=str(error))
    return FinishedImage(image.label, image.digest, fields)
