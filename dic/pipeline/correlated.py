"""Correlates the images of a series one by one; images that are finished already are skipped."""

import hashlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from dic.correlation.series import Series
from dic.errors import MeasurementError
from dic.image.given import name_of
from dic.image.pages import split_page
from dic.image.times import ImageTime
from dic.results.job import content_of
from dic.results.provenance import file_digest, versions
from dic.results.unfinished import FinishedImage, FinishedImages
from dic.typing import Float, ImageLike

UNREADABLE = "unreadable"
"""This text replaces the digest of an image that cannot be read."""


@dataclass(frozen=True)
class SeriesImage:
    """An image of a series, with its name and the expected motion of the specimen in the image.

    Attributes
    ----------
    image : ndarray, shape (height, width), or path, or callable
        A function without arguments returns the image when it is needed.
    label : str
        Name of the image in results.
    hint : ndarray, shape (3, 3), optional
        Expected homography from the reference image to this image, for example from `rigid_motion`.
    digest : str
        SHA-256 of the image's file or frames; "" if it is not known.
    time : ImageTime
        When the image was taken.
    """

    image: ImageLike | Callable[[], ImageLike]
    label: str
    hint: Float | None = None
    digest: str = ""
    time: ImageTime = field(default_factory=ImageTime)

    @property
    def content(self) -> str:
        """Text that identifies the content of the image, and the expected motion; see `content_of`."""
        known = self.digest if self.digest != UNREADABLE else ""
        if known and isinstance(self.image, str | Path):
            known = of_page(known, Path(self.image))
        return content_of(known, () if self.hint is None else self.hint.ravel())

    def read(self) -> ImageLike:
        """Return the image or its path; if the image is given by a function, call the function."""
        return self.image() if callable(self.image) else self.image


def correlate_series(
    series: Series,
    images: Iterable[ImageLike | SeriesImage],
    finished: FinishedImages | None = None,
    before: Sequence[FinishedImage] = (),
) -> Iterator[FinishedImage]:
    """Yield the correlated images of a series; each is correlated when the caller asks for it.

    No image and no field stays in memory, except for the data that `Series` needs.

    Parameters
    ----------
    series : Series
    images : iterable of ndarray, path or SeriesImage
    finished : FinishedImages, optional
        The images that were finished before. These images are not correlated again. Every other image is
        added after its correlation. All images must have digests.
    before : sequence of FinishedImage
        The outcomes of the first images of the series, from a result file. All these images must have been
        correlated with the first reference.
    """
    going_on = finished is not None
    for number, given in enumerate(images, 1):
        image = given
        if not isinstance(image, SeriesImage):
            image = SeriesImage(image, name_of(image, f"image {number}"))
        if number <= len(before):
            known = before[number - 1]
            if known.fields is not None:
                series.accept(image.read, known.fields)
            yield replace(known, content=image.content)
            continue
        key = FinishedImage(image.label, image.digest).key(image.hint)
        if finished is not None and going_on:
            found = finished.find(number, key, series.shared)
            if found is not None:
                if found.fields is not None:
                    series.accept(image.read, found.fields)
                yield replace(found, content=image.content, time=image.time)
                continue
            going_on = False
        outcome = _correlated(series, image)
        if finished is not None:
            finished.write(number, key, outcome)
        yield replace(outcome, content=image.content, time=image.time)


def _correlated(series: Series, image: SeriesImage) -> FinishedImage:
    try:
        fields = series.correlate_fields(image.read(), hint=image.hint)
    except MeasurementError as error:
        return FinishedImage(image.label, image.digest, failure=str(error))
    return FinishedImage(image.label, image.digest, fields)


def of_page(digest: str, image: Path) -> str:
    """Return a text that identifies an image by the digest of its file, and by its page if it has one."""
    page = split_page(image)[1]
    return digest if page is None else f"{digest}#{page}"


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
    region = hashlib.sha256(series.region.tobytes()).hexdigest()
    fixed = {"reference": reference, "region": region, "incremental": incremental, "versions": versions()}
    return fixed | vars(series.settings)


_MOST_BYTES = 2**36
"""Largest file (64 GiB) that is read as a whole to compute a digest, even if it is a stack of images."""


class FileDigests:
    """SHA-256 digests of image files; a file with many images is read only once."""

    def __init__(self) -> None:
        self._known: dict[Path, str] = {}

    def of(self, image: Path) -> str:
        """Return the digest of the file that holds an image; `UNREADABLE` if the file cannot be read."""
        file, page = split_page(image)
        if page is None or file not in self._known:
            try:
                self._known[file] = file_digest(file, _MOST_BYTES)
            except OSError:
                # The reader of the image will report the reason.
                return UNREADABLE
        return self._known[file]
