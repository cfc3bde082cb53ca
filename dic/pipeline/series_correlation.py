"""The correlation of the image files of a series, which keeps finished images beside the result file."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from dic.correlation.series import Series
from dic.files.lazy import Computed
from dic.image.times import SeriesTimes
from dic.pipeline.correlated import correlate_series, series_job
from dic.pipeline.reuse import fields_on_file, require_replaceable
from dic.pipeline.series_image import FileDigests, SeriesImage, of_page
from dic.pipeline.series_result_file import SeriesResult, load_series_result
from dic.pipeline.series_set_up import SeriesSetUp
from dic.pipeline.series_sources import SeriesSources
from dic.pipeline.strain_anew import job_of_fields
from dic.results.job import Outcome, as_text
from dic.results.place import ResultPlace
from dic.results.unfinished import FinishedImage, Unfinished, result_place, unfinished
from dic.typing import Float
from dic.workers.workers import Workers


@dataclass
class SeriesCorrelation:
    """The correlation of the image files of a series.

    Attributes
    ----------
    series : Series
    sources : SeriesSources
    incremental : str
        The rule for new references.
    hint : ndarray, shape (3, 3), or None
        The expected motion of every image.
    workers : Workers or None
        Workers that correlate images ahead of their turn; None to correlate each image when it is needed.
    digests : FileDigests
        Digests of the files of images that are known already.
    kept : Unfinished or None
        The folder of finished images; not None only inside the `with` block of `keeping`.
    known : SeriesResult or None
        After `look_up`: a result file that contains the fields of all images.
    begun : SeriesResult or None
        After `look_up`: a result file with the fields of the first images, if images were appended to the
        series later.
    """

    series: Series
    sources: SeriesSources
    incremental: str
    hint: Float | None = None
    workers: Workers | None = None
    kept: Unfinished | None = None
    known: SeriesResult | None = None
    begun: SeriesResult | None = None
    digests: FileDigests = field(default_factory=FileDigests)

    def __post_init__(self) -> None:
        self._times = SeriesTimes(self.sources.reference)

    @property
    def job(self) -> dict[str, Any]:
        """Everything except the images that determines the displacement fields, as values for JSON."""
        reference = self.sources.reference
        known = of_page(self.digests.of(reference), reference)
        return series_job(self.series, known, self.incremental)

    def look_up(self, place: ResultPlace, set_up: SeriesSetUp) -> SeriesResult | None:
        """Search for a file with the displacement fields; return its result if it also has the strains.

        If a result file has the same settings but only the first images, it may be replaced, because the new
        result contains it.

        Raises
        ------
        OutputError
            If the file contains results of another measurement, which must not be replaced.
        RunFileError
            If the user named a file whose fields are of another measurement.
        """
        images, strains = self.sources.images, as_text(set_up.as_dict())
        found = fields_on_file(
            place, load_series_result, self.job, lambda: {"": self._contents()}, begun=True
        )
        if found is not None and len(found.outcomes) < len(images):
            self.begun = found
            if Path(found.source) != place.path or job_of_fields(found).strains != strains:
                require_replaceable(place)
            return None
        self.known = found
        if self.known is None or Path(self.known.source) != place.path:
            require_replaceable(place)
            return None
        names = [each.label for each in self.known.outcomes] == [str(path) for path in images]
        if names and job_of_fields(self.known).strains == strains:
            return self.known
        require_replaceable(place)
        return None

    @contextmanager
    def keeping(self, place: ResultPlace | None, written: Iterable[Path | None]) -> Iterator[None]:
        """Keep every finished image in a folder beside the result file until the `with` block ends.

        Parameters
        ----------
        place : ResultPlace or None
            The result file. Without one, the images are in a temporary folder.
        written : iterable of Path or None
            All files that the measurement writes.
        """
        others = [path for path in written if path is not None]
        with (
            result_place(None if place is None else place.path) as result,
            unfinished(result, self.job, others) as self.kept,
        ):
            yield

    def images(self) -> Iterator[FinishedImage]:
        """Yield the finished images one by one; each is correlated, or read, when the caller asks for it."""
        if self.known is not None:
            return map(self.again, range(len(self.sources.images)))
        # Digests are needed only to find images in the folder of finished images, and by workers.
        kept, before = self.kept, range(self.used_again)
        digested = kept is not None or self.workers is not None
        given = (self._image(path, digested=digested) for path in self.sources.images)
        finished = None if kept is None else kept.series(0)
        return correlate_series(
            self.series, given, finished, Computed(len(before), self._before), self.workers
        )

    def again(self, number: int) -> FinishedImage:
        """Return an image that was correlated before; `number` is its index in the series."""
        if self.known is not None:
            # Take the times from the result file, because copying an image file changes its time.
            return replace(self.known.correlated[number], label=str(self.sources.images[number]))
        if number < self.used_again:
            return self._before(number)
        if self.kept is None:
            raise ValueError("no finished image is kept")
        return self.kept.series(0).read(number + 1, self.series.shared)

    @property
    def used_again(self) -> int:
        """Number of images at the beginning whose fields are taken from an earlier result file.

        A result file does not contain the fields relative to a later reference. So the first image with a new
        reference and all images after it are correlated again.
        """
        if self.begun is None:
            return 0
        rows = iter(self.begun.fields.updates)
        updates = [0 if each.failure is not None else next(rows, 1) for each in self.begun.outcomes]
        return next((k for k, number in enumerate(updates) if number), len(updates))

    @property
    def begun_text(self) -> str:
        """A sentence that says which fields of the first images are used again; "" if there are none."""
        if self.begun is None:
            return ""
        count, held, used = len(self.sources.images), len(self.begun.outcomes), self.used_again
        which = "their fields" if used == held else f"the fields of {used}, up to the first new reference,"
        return (
            f"{self.begun.source}: holds the first {held} of {count} images; {which} are used again, and"
            f" {count - used} are correlated"
        )

    def _before(self, number: int) -> FinishedImage:
        if self.begun is None:
            raise ValueError("there is no result of earlier images")
        path = self.sources.images[number]
        return replace(self.begun.correlated[number], label=str(path), time=self._times.of(path))

    def stay(self) -> None:
        """Keep the folder of finished images when the `with` block of `keeping` ends."""
        if self.kept is not None:
            self.kept.stays = True

    def _image(self, path: Path, *, digested: bool) -> SeriesImage:
        digest, identity = self.digests.identified(path) if digested else ("", ())
        return SeriesImage(path, str(path), self.hint, digest, self._times.of(path), identity)

    def _contents(self) -> list[Outcome]:
        images = (self._image(path, digested=True) for path in self.sources.images)
        return [Outcome(image.label, image.content) for image in images]
