"""Correlates the images of a series one by one; images that are finished already are skipped."""

import hashlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import count, islice, starmap
from typing import Any

import numpy as np

from dic.correlation.series import Series
from dic.correlation.series_state import GUESS_DISTANCE, SeriesFields
from dic.image.given import name_of
from dic.pipeline.ahead import outcomes
from dic.pipeline.series_image import SeriesImage
from dic.results.finished import FinishedImage
from dic.results.provenance import versions
from dic.typing import ImageLike
from dic.workers.workers import Workers

FIRST_GUESSES = {"first guesses": f"rule 2, {GUESS_DISTANCE} images before"}
"""The rule by which first guesses are chosen, as a part of every job. A new rule gets a new number.

Fields by different rules differ in their last bits, so an interrupted measurement must not mix them.
"""


def correlate_series(
    series: Series,
    images: Iterable[ImageLike | SeriesImage],
    before: Sequence[FinishedImage] = (),
    kept: Callable[[int], SeriesFields] | None = None,
    workers: Workers | None = None,
    together: int = 1,
) -> Iterator[FinishedImage]:
    """Yield the correlated images of a series; each is correlated when the caller asks for it.

    No image and no field stays in memory, except for the data that `Series` needs.

    `before`: the outcomes of the first images of the series, which are not correlated again. `kept`: function
    that returns the fields of an image that was yielded, by its index among the images with fields. With this
    function, the fields of the last image need not stay in memory. `workers`: threads or processes that
    correlate images before the caller asks for them. The results have the same bits. `together`: number of
    series that are correlated at the same time by the same workers.
    """
    remaining = enumerate(_named(images), 1)
    rows = count()

    def finished(_: int, image: SeriesImage, found: FinishedImage) -> FinishedImage:
        if kept is not None and found.fields is not None:
            series.keep_last_elsewhere(partial(kept, next(rows)))
        time = found.time if found.time.source else image.time
        return replace(found, label=image.label, content=image.content, time=time)

    def accepted(number: int, image: SeriesImage) -> FinishedImage:
        found = before[number - 1]
        series.accept(image.read, found.fields)
        return finished(number, image, found)

    # Loops over the images would keep the fields of one until the next is correlated.
    yield from starmap(accepted, islice(remaining, len(before)))
    yield from starmap(finished, outcomes(series, remaining, workers, together))


def _named(images: Iterable[ImageLike | SeriesImage]) -> Iterator[SeriesImage]:
    for number, image in enumerate(images, 1):
        if isinstance(image, SeriesImage):
            yield image
        else:
            yield SeriesImage(image, name_of(image, f"image {number}"))


def series_job(series: Series, reference: str, incremental: str) -> dict[str, Any]:
    """Return everything except the images that determines the fields of a series, for a result file.

    `reference`: SHA-256 of the reference's file, and its page; see `of_page`. `incremental`: the rule for new
    references.
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
