"""The results of a measurement: of all cameras of a run, or of the camera of a series of image files."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from dic.calibration.calibration import Calibration
from dic.correlation.settings import CorrelationSettings
from dic.files.lazy import Computed
from dic.out_of_plane.diagnosis import Sensitivity
from dic.pipeline.correction_settings import CorrectionSettings, kinds_of, motion_of
from dic.pipeline.corrections import Corrector, RunCorrections
from dic.pipeline.measured_images import CameraView, MeasuredImage, MeasuredSeries, require_camera
from dic.results.fields import StoredFields
from dic.results.finished import FinishedImage
from dic.results.job import ImageOutcome
from dic.results.provenance import Provenance
from dic.runfile.reader import RunInfo, RunStep
from dic.specimen.find import Specimen
from dic.strain.measurement import Measurement
from dic.typing import Grey


@dataclass(frozen=True)
class CameraResult:
    """The results of one camera of a run, or of the camera of a series of image files.

    Attributes
    ----------
    camera : str
        Name of the camera; "" for a series of image files.
    calibration : Calibration or None
        None only for a series of image files.
    reference : ndarray of float32, shape (height, width)
        The reference image, with which the images of all other steps are compared.
    steps : list of RunStep
        The steps of the run that could be measured with this camera; empty for a series of image files.
    measurements : sequence of Measurement
        The images that could be measured. If the results come from `process_run` or from a file,
        each measurement is read from the file when it is used.
    failures : list of str
        One sentence per step that could not be measured; the sentence gives the reason.
    specimen : Specimen or None
        The specimen in the calibrated part of the reference image; None for results from a file.
    outcomes : sequence of ImageOutcome
        The outcome of each image except the reference; empty for files of earlier versions.
    fields : StoredFields or None
        The fields of the measurements in a result file; None without a file or without a measurement.
    remarks : sequence of str
        Sentences about readings that are not known at all images.
    """

    camera: str
    calibration: Calibration | None
    reference: Grey
    steps: list[RunStep]
    measurements: Sequence[Measurement]
    failures: list[str]
    specimen: Specimen | None = None
    outcomes: Sequence[ImageOutcome] = ()
    fields: StoredFields | None = None
    remarks: Sequence[str] = ()

    def __repr__(self) -> str:
        return f"CameraResult({self.camera!r}, {len(self.steps)} steps, {len(self.failures)} failed)"

    def require_calibration(self) -> Calibration:
        """Return the calibration, which each camera of a run has.

        Raises
        ------
        ValueError
            If there is none.
        """
        if self.calibration is None:
            raise ValueError(f"{self.camera or 'the camera'} has no calibration")
        return self.calibration

    @property
    def finished_images(self) -> Sequence[FinishedImage]:
        """The correlated images in their order; each is read from the result file when it is used."""
        if self.fields is None:
            return [
                FinishedImage(each.label, failure=each.failure, content=each.content, time=each.time)
                for each in self.outcomes
            ]
        return self.fields.images(self.outcomes)


@dataclass(frozen=True)
class SeriesResult:
    """The results of a series of images, from a result file of `dic correlate`.

    Attributes
    ----------
    source : str
        Path of the result file.
    series : MeasuredSeries
        The images are read from the file when they are used.
    camera : CameraResult
    provenance : Provenance
    finished : bool
        False if the measurement was stopped, so that images are missing.
    """

    source: str
    series: MeasuredSeries
    camera: CameraResult
    provenance: Provenance
    finished: bool = True

    def __repr__(self) -> str:
        return f"SeriesResult of {self.source}, {len(self.series.images)} images"

    @property
    def images(self) -> Sequence[MeasuredImage]:
        """The results of all images in order, as `measure_images` returns them."""
        return self.series.images

    @property
    def result_file(self) -> str:
        """Path of the result file."""
        return self.source

    @property
    def views(self) -> list[CameraView]:
        """The results of the only camera."""
        return [CameraView("", self.series, self.calibration)]

    @property
    def cameras(self) -> list[CameraResult]:
        """The only camera, in a list as that of a run."""
        return [self.camera]

    @property
    def calibration(self) -> Calibration | None:
        """Calibration of the camera; None for results in pixels."""
        return self.camera.calibration

    @property
    def outcomes(self) -> Sequence[ImageOutcome]:
        """The outcome of each image, in the order of the series; empty for files of earlier versions."""
        return self.camera.outcomes

    @property
    def settings(self) -> CorrelationSettings:
        """Settings of the correlation; the defaults if no image could be measured."""
        return CorrelationSettings() if self.camera.fields is None else self.camera.fields.settings

    @property
    def reference_name(self) -> str:
        """Name of the reference image: the first of the input files."""
        return next(iter(self.provenance.inputs), "")


@dataclass(frozen=True)
class RunResult:
    """All measurements and corrections of a run. There is no measurement of the reference step itself.

    Attributes
    ----------
    source : str
        Path of the run file.
    info : RunInfo
    settings : CorrelationSettings
    correcting : CorrectionSettings
    cameras : list of CameraResult
    corrections : RunCorrections
        Corrections of the strains for motion out of the calibration grid's plane.
    provenance : Provenance or None
        Where the results come from; None for files of earlier versions.
    file : str
        Path of the result file; "" if the results were not read from a file.
    note : str
        A sentence that says which result file `process_run` used; "" if it correlated the images.
    known : bool
        True if `process_run` found these results in the result file, and computed nothing.
    finished : bool
        False if the measurement was stopped, so that images are missing.
    """

    source: str
    info: RunInfo
    settings: CorrelationSettings
    correcting: CorrectionSettings
    cameras: list[CameraResult]
    corrections: RunCorrections
    provenance: Provenance | None = None
    file: str = ""
    note: str = ""
    known: bool = False
    finished: bool = True

    def __repr__(self) -> str:
        lines = [f"  {camera}" for camera in self.cameras]
        return "\n".join([f"RunResult of {self.source}, {self.info.title!r}, {self.info.status}", *lines])

    def series(self, camera: str) -> MeasuredSeries:
        """Return a camera's results in the form that `measure_images` returns.

        Each step has its best correction. The best correction is the correction by two cameras together, if
        the step has such a correction; otherwise it is the correction by this camera alone.

        Parameters
        ----------
        camera : str
            Name of the camera in the run.

        Raises
        ------
        RunFileError
            If the run has no such camera.
        """
        (view,) = require_camera(self.views, camera, self.source)
        return view.series

    @property
    def result_file(self) -> str:
        """Path of the result file; that of the run file if there is none."""
        return self.file or self.source

    @property
    def views(self) -> list[CameraView]:
        """The results of all cameras; each step has its best correction."""
        return [
            CameraView(found.camera, self._series(found), found.calibration, found.steps)
            for found in self.cameras
        ]

    def _series(self, found: CameraResult) -> MeasuredSeries:
        camera, steps = found.camera, len(found.steps)

        def image(k: int) -> MeasuredImage:
            if k >= steps:
                return MeasuredImage(camera, failure=found.failures[k - steps])
            measurement = found.measurements[k]
            best = self.corrections.best(camera, found.steps[k].index, k)
            return MeasuredImage(measurement.label, measurement, best)

        images = Computed(steps + len(found.failures), image)
        alignment = self.corrections.cameras[camera].alignment
        return MeasuredSeries(found.reference, images, alignment, sensitivity_of(found.calibration))


def sensitivity_of(calibration: Calibration | None) -> Sensitivity | None:
    """Return the sensitivity of a camera to motion out of the plane; None if it cannot be computed."""
    return None if calibration is None else Sensitivity.of(calibration)


def measured_steps(cameras: Sequence[CameraResult]) -> Iterator[tuple[RunStep, dict[str, int]]]:
    """Yield each step that a camera measured, with the index of its measurement for each camera, in order."""
    steps = {step.index: step for camera in cameras for step in camera.steps}
    places = {c.camera: {step.index: place for place, step in enumerate(c.steps)} for c in cameras}
    for index, step in sorted(steps.items()):
        yield step, {name: own[index] for name, own in places.items() if index in own}


def correct_run(cameras: Sequence[CameraResult], settings: CorrectionSettings) -> RunCorrections:
    """Correct the strains of all measurements of a run for out-of-plane motion."""
    kind = motion_of(kinds_of(step for camera in cameras for step in camera.steps))
    motions = {camera.camera: settings.motion(kind, camera.camera) for camera in cameras}
    corrector = Corrector.of(cameras, motions)
    for camera in cameras:
        corrector.solve(camera.camera, camera.measurements)
    own = {camera.camera: camera.measurements for camera in cameras}
    steps = []
    for number, (step, places) in enumerate(measured_steps(cameras)):
        measured = {name: own[name][place] for name, place in places.items()}
        images = {name: MeasuredImage(each.label, each) for name, each in measured.items()}
        steps.append(corrector.corrected(number, step, images, places))
    return corrector.corrections(steps)
