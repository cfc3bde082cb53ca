"""Compute strain again from the displacement fields of a result file, without any image or correlation."""

import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from dic.calibration.calibration import Calibration
from dic.calibration.grid_making import GridAccuracy
from dic.calibration.one_grid import of_one_grid
from dic.calibration.plate import behind
from dic.files.lazy import Computed
from dic.out_of_plane.motion import Motion
from dic.pipeline.camera import CameraImages, Kept
from dic.pipeline.correction_settings import CorrectionSettings, kinds_of
from dic.pipeline.corrections import corrected_images
from dic.pipeline.measured import measurement_of
from dic.pipeline.measured_images import MeasuredImage, MeasuredSeries
from dic.pipeline.measuring import Measuring, measuring_into
from dic.pipeline.result import CameraResult, RunResult, SeriesResult, sensitivity_of
from dic.pipeline.result_file import load_written
from dic.pipeline.reuse import job_of_fields
from dic.pipeline.set_up import RunSetUp, SeriesSetUp, plate_of_job, reference_time_of_job, strain_of_job
from dic.results.finished import FinishedImage
from dic.results.job import Job, as_text
from dic.results.place import ResultPlace, alone, result_place
from dic.results.provenance import Provenance
from dic.runfile.reader import RunStep
from dic.strain.settings import StrainSettings
from dic.typing import PathLike


def origin_anew(result: SeriesResult | RunResult, inputs: Iterable[Path | None], job: Job) -> Provenance:
    """Return the provenance of recomputed strain: the inputs of `result`, and the additional `inputs`."""
    origin = Provenance.of(inputs, job)
    earlier = {} if result.provenance is None else dict(result.provenance.inputs)
    return replace(origin, inputs=earlier | dict(origin.inputs))


def strain_of_series(
    result: SeriesResult,
    *,
    strain: StrainSettings | None = None,
    calibration: Calibration | None = None,
    motion: Motion | None = None,
) -> MeasuredSeries:
    """Compute strains and corrections of a series again, from the fields of its result file.

    Parameters
    ----------
    result : SeriesResult
        The result of `load_series_result`.
    strain : StrainSettings, optional
    calibration : Calibration, optional
    motion : Motion, optional
        Assumed motion of the specimen. The default of each argument is the value with which `result` was
        computed.

    Returns
    -------
    MeasuredSeries
        The result of `measure_images` with these settings. Each image is computed when it is used.

    Raises
    ------
    RunFileError
        If the file is of an earlier version, whose fields lack what strain needs.
    MeasurementError
        If the motion needs a calibration that is missing, or the calibration belongs to another image size.
    """
    known = SeriesSetUp.of_job(job_of_fields(result), result.calibration)
    used = SeriesSetUp(strain or known.strain, motion or known.motion, calibration or known.calibration)
    used.require_use(result.series.reference.shape)
    finished = result.camera.finished_images

    def image(k: int) -> MeasuredImage:
        found = finished[k]
        measurement = None if found.fields is None else measurement_of(found, used.calibration, used.strain)
        return MeasuredImage(found.label, measurement, failure=found.failure, time=found.time)

    images, alignment = corrected_images(Computed(len(finished), image), used.calibration, used.motion)
    return MeasuredSeries(result.series.reference, images, alignment, sensitivity_of(used.calibration))


def strain_of_run(
    result: RunResult,
    output: PathLike | None = None,
    *,
    strain: StrainSettings | None = None,
    correcting: CorrectionSettings | None = None,
    plate_mm: float | None = None,
    on_image: Callable[[], None] = lambda: None,
    inputs: Sequence[PathLike] = (),
) -> RunResult:
    """Compute strains and corrections of a run again, from the fields of its result file.

    Parameters
    ----------
    result : RunResult
        The result of `load_run_result`.
    output : path, optional
        The new result file. Default: a temporary file.
    strain : StrainSettings, optional
    correcting : CorrectionSettings, optional
    plate_mm : float, optional
        Distance of the specimen's surface behind the grid's lines. The default of each setting is the value
        with which `result` was computed.
    on_image : callable, optional
        Function that is called after each image; another thread may call it.
    inputs : sequence of path
        Files from which the caller took settings, for the provenance of the new results.

    Raises
    ------
    RunFileError
        If the file is of an earlier version, whose fields lack what strain needs.
    MeasurementError
        If the run cannot use a setting, or the file cannot be written.
    """
    job = job_of_fields(result)
    strain = strain or strain_of_job(job)
    plate_mm = plate_of_job(job) if plate_mm is None else plate_mm
    accuracy = None
    if correcting is None:
        correcting = result.correcting
    else:
        kinds = kinds_of(step for camera in result.cameras for step in camera.steps)
        if correcting.grid != result.correcting.grid:
            accuracy = correcting.grid
        correcting.require_use(result.source, [camera.camera for camera in result.cameras], kinds)
    known = result.settings, strain, correcting, plate_mm, reference_time_of_job(job)
    set_up = RunSetUp(result.source, result.info, *known)
    with result_place(output) as file, alone(None if output is None else file):
        job = Job(job.fields, as_text(set_up.as_dict()))
        origin = origin_anew(result, [Path(result.file), *map(Path, inputs)], job)
        cameras = _cameras(result, plate_mm, accuracy)
        with measuring_into(ResultPlace(file), cameras, set_up, origin, math.inf, on_image=on_image) as work:
            deque(work.steps(), maxlen=0)
        return load_written(file)


@contextmanager
def series_anew(
    result: SeriesResult, set_up: SeriesSetUp, output: Path | None = None, inputs: Iterable[Path | None] = ()
) -> Iterator[Measuring]:
    """Provide the measurement that computes the strains of a series again, from the fields of its result.

    Parameters
    ----------
    result : SeriesResult
    set_up : SeriesSetUp
    output : Path, optional
        The new result file.
    inputs : iterable of (Path or None)
        Files from which the caller took settings, for the provenance of the new results.
    """
    origin = origin_anew(result, inputs, Job(job_of_fields(result).fields, as_text(set_up.as_dict())))
    cameras = [_known(result.camera, set_up.calibration, ())]
    place = None if output is None else ResultPlace(output)
    with (
        alone(output),
        measuring_into(place, cameras, set_up, origin, math.inf, provisional=True) as measuring,
    ):
        yield measuring


def _cameras(result: RunResult, plate_mm: float, accuracy: GridAccuracy | None) -> list[CameraImages]:
    """Return the cameras of a result with another distance of the surface behind the grid's lines.

    `accuracy`: another accuracy of the grid, with which the cameras are fitted again.
    """
    of_cameras = [_steps_of(camera) for camera in result.cameras]
    # A step that a camera could not measure has the readings of another camera. A step that no camera could
    # measure is not in the file, and has no result.
    steps = {k: step for own in reversed(of_cameras) for k, step in own.items()}
    count = max((len(camera.outcomes) for camera in result.cameras), default=0)
    nan = math.nan
    unknown = RunStep(0, "", nan, nan, nan, nan, nan)
    found = []
    calibrations = [camera.calibration for camera in result.cameras]
    if accuracy is not None:
        made = tuple(known.fitted_again(accuracy=accuracy) for known in calibrations if known is not None)
        calibrations = [*of_one_grid(made)]
    for camera, own, calibration in zip(result.cameras, of_cameras, calibrations, strict=True):
        moved_mm = 0.0 if calibration is None else plate_mm - calibration.plate_mm
        if calibration is not None and moved_mm:
            calibration = behind(calibration, moved_mm)
        every = [own.get(k, steps.get(k, unknown)) for k in range(count)]
        found.append(_known(camera, calibration, every))
    return found


def _steps_of(camera: CameraResult) -> dict[int, RunStep]:
    """Return the measured steps of a camera by the index of the image."""
    measured = iter(camera.steps)
    return {k: next(measured) for k, outcome in enumerate(camera.outcomes) if outcome.failure is None}


def _known(camera: CameraResult, calibration: Calibration | None, steps: Sequence[RunStep]) -> CameraImages:
    def none_left(camera: CameraImages, kept: Kept | None) -> Iterator[FinishedImage]:
        return iter(())

    images = camera.finished_images
    return CameraImages(
        camera.camera,
        camera.reference,
        calibration,
        none_left,
        steps,
        images,
        known=True,
        remarks=camera.remarks,
    )
