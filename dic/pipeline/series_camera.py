"""The camera of a series of image files: how its images are correlated, and by what they are known again."""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

from numpy.typing import NDArray

from dic.calibration.calibration import Calibration
from dic.correlation.series import Series
from dic.files.lazy import Computed
from dic.image.times import SeriesTimes
from dic.pipeline.camera import CameraImages, Kept
from dic.pipeline.correlated import correlate_series, series_job
from dic.pipeline.measuring import Measuring, measuring_into
from dic.pipeline.reuse import EarlierMeasurement, look_up
from dic.pipeline.series_image import FileDigests, SeriesImage, of_page
from dic.pipeline.series_sources import SeriesSources
from dic.pipeline.set_up import SeriesSetUp
from dic.results.finished import FinishedImage
from dic.results.job import ImageOutcome, Job
from dic.results.place import ResultPlace, alone, result_place
from dic.results.provenance import Provenance
from dic.typing import Float
from dic.workers.workers import Workers


class BegunSeries(NamedTuple):
    """What an earlier measurement has left, and the measurement that goes on, or None if it is complete."""

    earlier: EarlierMeasurement
    measuring: Measuring | None


@dataclass
class SeriesCamera:
    """The camera of a series of image files.

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
    """

    series: Series
    sources: SeriesSources
    incremental: str
    hint: Float | None = None
    workers: Workers | None = None
    digests: FileDigests = field(default_factory=FileDigests)

    def __post_init__(self) -> None:
        self.times, self.digested = SeriesTimes(self.sources.reference), True

    @property
    def job(self) -> dict[str, Any]:
        """Everything except the images that determines the displacement fields, as values for JSON."""
        reference = self.sources.reference
        known = of_page(self.digests.of(reference), reference)
        return series_job(self.series, known, self.incremental)

    def outcomes(self) -> dict[str, list[ImageOutcome]]:
        """Return the names and the contents of the images, for `look_up`."""
        images = map(self._image, self.sources.images)
        return {"": [ImageOutcome(image.label, image.content) for image in images]}

    @contextmanager
    def begun(
        self,
        reference: NDArray[Any],
        set_up: SeriesSetUp,
        place: ResultPlace | None,
        inputs: Iterable[Path | None] = (),
    ) -> Iterator[BegunSeries]:
        """Search for earlier results of the series, and provide the measurement that goes on after them.

        Parameters
        ----------
        reference : ndarray, shape (height, width)
        set_up : SeriesSetUp
        place : ResultPlace or None
            The result file. Without one, images that are needed again are in a temporary file.
        inputs : iterable of (Path or None)
            The input files except the images, for the provenance.

        Raises
        ------
        OutputError
            If the file contains results of another measurement, which must not be replaced.
        RunFileError
            If the user named a file whose fields are of another measurement.
        """
        with ExitStack() as stack:
            earlier, origin = EarlierMeasurement(), Provenance.of([])
            motion = set_up.motion
            if place is None and motion is not None and motion.kind == "rigid":
                place = ResultPlace(stack.enter_context(result_place(None)))
            self.digested = place is not None or self.workers is not None
            if place is not None:
                stack.enter_context(alone(place.path))
                job = Job.of(self.job, set_up.as_dict())
                earlier = look_up(place, job, self.outcomes)
                origin = Provenance.of([self.sources.files[0], *inputs], job, self.digests.of_file)
            measuring = None
            if earlier.same is None:
                cameras = [self._camera(reference, set_up.calibration, earlier)]
                into = measuring_into(place, cameras, set_up, origin, earlier.images_before, provisional=True)
                measuring = stack.enter_context(into)
            yield BegunSeries(earlier, measuring)

    def _camera(
        self, reference: NDArray[Any], calibration: Calibration | None, earlier: EarlierMeasurement
    ) -> CameraImages:
        finished = earlier.images.get("", ())
        before = Computed(len(finished), lambda k: self._renamed(finished[k], self.sources.images[k]))
        camera = CameraImages("", reference, calibration, self._correlated, (), before, earlier.known)
        camera.specimen = self.series.specimen
        return camera

    def _correlated(self, camera: CameraImages, kept: Kept | None) -> Iterator[FinishedImage]:
        images = map(self._image, self.sources.images)
        before: Sequence[FinishedImage] = camera.before
        return correlate_series(self.series, images, before, kept, self.workers)

    def _renamed(self, image: FinishedImage, path: Path) -> FinishedImage:
        # Keep the times of the result file, because copying an image file changes its time.
        return replace(image, label=str(path), time=image.time if image.time.source else self.times.of(path))

    def _image(self, path: Path) -> SeriesImage:
        digest, identity = self.digests.identified(path) if self.digested else ("", ())
        return SeriesImage(path, str(path), self.hint, digest, self.times.of(path), identity)
