"""Correlates the images of a series one by one; images that are finished already are skipped."""

import hashlib
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain
from typing import Any

import numpy as np

from dic.correlation.series import Series
from dic.correlation.series_state import GUESS_DISTANCE, SeriesFields
from dic.image.given import name_of
from dic.pipeline.ahead import outcomes
from dic.pipeline.series_image import SeriesImage
from dic.results.provenance import versions
from dic.results.unfinished import FinishedImage, FinishedImages
from dic.typing import ImageLike
from dic.workers.workers import Workers

FIRST_GUESSES = {"first guesses": f"rule 2, {GUESS_DISTANCE} images before"}
"""The rule by which first guesses are chosen, as a part of every job. A new rule gets a new number.

Fields by different rules differ in their last bits, so an interrupted measurement must not mix them.
"""


def correlate_series(
    series: Series,
    images: Iterable[ImageLike | SeriesImage],
    finished: FinishedImages | None = None,
    before: Sequence[FinishedImage] = (),
    workers: Workers | None = None,
    together: int = 1,
) -> Generator[FinishedImage, None, None]:
    """Yield the correlated images of a series; each is correlated when the caller asks for it.

    No image and no field stays in memory, except for the data that `Series` needs.

    Parameters
    ----------
    series : Series
    images : iterable of ndarray, path or SeriesImage
    finished : FinishedImages, optional
        The images that were finished before. These images are not correlated again. Every other image is
        added after its correlation. If this argument is given, all images must have digests.
    before : sequence of FinishedImage
        The outcomes of the first images of the series, from a result file. All these images must have been
        correlated with the first reference.
    workers : Workers, optional
        Threads or processes that correlate images before the caller asks for them. The results have the same
        bits.
    together : int
        Number of series that are correlated at the same time by the same workers.
    """
    remaining: Iterator[tuple[int, SeriesImage]] = enumerate(_named(images), 1)
    for number, image in remaining:
        known = _known(series, number, image, finished, before)
        if known is None:
            remaining = chain([(number, image)], remaining)
            break
        series.accept(image.read, known.fields)
        if finished is not None and known.fields is not None and number > len(before):
            series.keep_last_elsewhere(partial(_fields, finished, number, series.shared))
        time = known.time if number <= len(before) else image.time
        yield replace(known, content=image.content, time=time)
    for number, image, outcome in outcomes(series, remaining, workers, together):
        if finished is not None:
            finished.write(number, _key(image), outcome)
            if outcome.fields is not None:
                series.keep_last_elsewhere(partial(_fields, finished, number, series.shared))
        yield replace(outcome, content=image.content, time=image.time)
        # Free the memory of the fields before the next image is correlated.
        del outcome


def _named(images: Iterable[ImageLike | SeriesImage]) -> Iterator[SeriesImage]:
    for number, image in enumerate(images, 1):
        if isinstance(image, SeriesImage):
            yield image
        else:
            yield SeriesImage(image, name_of(image, f"image {number}"))


def _known(
    series: Series,
    number: int,
    image: SeriesImage,
    finished: FinishedImages | None,
    before: Sequence[FinishedImage],
) -> FinishedImage | None:
    """Return an image that was finished before; None if the image must be correlated."""
    if number <= len(before):
        return before[number - 1]
    return None if finished is None else finished.find(number, _key(image), series.shared)


def _fields(finished: FinishedImages, number: int, shared: Mapping[str, Any]) -> SeriesFields:
    """Return the fields of a finished image."""
    fields = finished.read(number, shared).fields
    assert fields is not None, "an image without fields is not kept"
    return fields


def _key(image: SeriesImage) -> str:
    return FinishedImage(image.label, image.digest).key(image.hint)


def series_job(series: Series, reference: str, incremental: str) -> dict[str, Any]:
    """Return everything except the images that determines the fields of a series, for `unfinished`.

    Parameters
    ----------
    series : Series
    reference : str
        SHA-256 of the reference's file, and its page; see `of_page`.
    incremental : str
        The rule for new references.
    """
    region = hashlib.sha256()
    for row in series.region:
        region.update(np.ascontiguousarray(row).data)
    fixed = {
        "reference": reference,
        "region": region.hexdigest(),
        "incremental": incremental,
        "versions": versions(),
    }
    return fixed | FIRST_GUESSES | vars(series.settings)
