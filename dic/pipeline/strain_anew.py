"""Compute strain again from the displacement fields of a result file, without any image or correlation."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path

from dic.calibration.calibration import Calibration
from dic.calibration.plate import behind
from dic.errors import RunFileError
from dic.files.lazy import Computed
from dic.out_of_plane.correct import Motion
from dic.out_of_plane.diagnosis import Sensitivity
from dic.pipeline.camera_result import CameraResult
from dic.pipeline.images import measured, measurement_of
from dic.pipeline.run_corrections import CorrectionSettings
from dic.pipeline.run_result import RunResult
from dic.pipeline.run_result_file import load_written
from dic.pipeline.run_set_up import RunSetUp, plate_of_job, strain_of_job
from dic.pipeline.series_corrections import corrected_rotation
from dic.pipeline.series_result import MeasuredImage, MeasuredSeries
from dic.pipeline.series_result_file import SeriesResult
from dic.pipeline.series_set_up import SeriesSetUp
from dic.results.job import Job, as_text
from dic.results.provenance import Provenance
from dic.results.unfinished import alone, result_place
from dic.strain.measurement import Measurement
from dic.strain.strain import StrainSettings
from dic.typing import PathLike


def job_of_fields(result: SeriesResult | RunResult) -> Job:
    """Return the job of a result whose fields have all data that the computation of strain needs.

    Raises
    ------
    RunFileError
        If the file is of an earlier version. Earlier versions did not store which pixels the subsets used.
    """
    cameras = result.cameras if isinstance(result, RunResult) else []
    known = [camera.fields for camera in cameras] if cameras else [getattr(result, "fields", None)]
    job = None if result.provenance is None else result.provenance.job
    if job is not None and all(fields is None or fields.grid is not None for fields in known):
        return job
    raise RunFileError(
        result.source,
        "take its displacement fields",
        "fields with the pixels of their subsets",
        "a result file of an earlier version, without them",
        "correlate the images again",
    )


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
    fields = result.correlated
    images: Sequence[MeasuredImage] = Computed(
        len(fields), lambda k: measured(fields[k], used.calibration, used.strain, used.motion)
    )
    alignment = used.motion.alignment
    if used.calibration is not None and used.motion.kind == "rigid":
        images, alignment = corrected_rotation(images, used.calibration, used.motion)
    sensitivity = None if used.calibration is None else Sensitivity.of(used.calibration)
    return MeasuredSeries(result.series.reference, images, alignment, sensitivity)


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
    if correcting is None:
        correcting = result.correcting
    else:
        kinds = {step.kind for camera in result.cameras for step in camera.steps}
        correcting.require_use(result.source, [camera.camera for camera in result.cameras], kinds)
    set_up = RunSetUp(result.source, result.info, result.settings, strain, correcting, plate_mm)
    with result_place(output) as place, alone(None if output is None else place):
        return strain_with(result, set_up, place, on_image, [Path(path) for path in inputs])


def strain_with(
    result: RunResult,
    set_up: RunSetUp,
    output: Path,
    on_image: Callable[[], None] = lambda: None,
    inputs: Sequence[Path] = (),
) -> RunResult:
    """Compute the strains of a run with another set-up, and write them to `output`; see `strain_of_run`."""
    job = Job(job_of_fields(result).fields, as_text(set_up.as_dict()))
    origin = origin_anew(result, [Path(result.file), *inputs], job)
    set_up.write(
        output,
        [_camera_anew(each, set_up.strain, set_up.plate_mm, on_image) for each in result.cameras],
        origin,
    )
    return load_written(output)


def _camera_anew(
    camera: CameraResult, strain: StrainSettings, plate_mm: float, on_image: Callable[[], None]
) -> CameraResult:
    """Return the results of a camera; its measurements are computed from its fields when they are used."""
    calibration, moved_mm = camera.calibration, plate_mm - camera.calibration.plate_mm
    if moved_mm:
        calibration = behind(calibration, moved_mm)
    fields, seen = camera.fields, set[int]()
    if fields is None:
        return replace(camera, calibration=calibration)
    found = fields.images([each for each in camera.outcomes if each.failure is None])

    def measurement(k: int) -> Measurement:
        if k not in seen:
            seen.add(k)
            on_image()
        return measurement_of(found[k], calibration, strain)

    return replace(camera, calibration=calibration, measurements=Computed(len(found), measurement))
