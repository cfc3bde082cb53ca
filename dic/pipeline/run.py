"""The processing of a run file: calibrate every camera and correlate the images of every step."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from threading import Event
from typing import Any

import numpy as np

from dic.calibration.calibration import Calibration
from dic.calibration.plate import behind
from dic.correlation.series import Series
from dic.correlation.settings import CorrelationSettings
from dic.errors import CalibrationError, RunFileError, require_kind
from dic.files.lazy import Computed
from dic.image.threads import processors
from dic.pipeline.camera_result import CameraResult
from dic.pipeline.correlated import UNREADABLE, SeriesImage, correlate_series
from dic.pipeline.images import measurement_of
from dic.pipeline.run_corrections import CorrectionSettings, RunCorrector
from dic.pipeline.run_result import RunResult
from dic.pipeline.run_result_file import RunResultWriter, load_run_result
from dic.results.provenance import Provenance, versions
from dic.results.unfinished import Unfinished, result_place, unfinished
from dic.runfile.digests import joined_digest
from dic.runfile.joined import open_run
from dic.runfile.reader import RunFile, RunStep
from dic.specimen.find import SpecimenNotFound
from dic.strain.measurement import Measurement
from dic.strain.strain import StrainSettings
from dic.targets.find import CharucoTarget, CheckerboardTarget, DotTarget, LineGridTarget, Target, find_target
from dic.typing import Float, Grey, Mask, PathLike


def process_run(
    path: PathLike,
    settings: CorrelationSettings | None = None,
    strain: StrainSettings | None = None,
    *,
    correcting: CorrectionSettings | None = None,
    incremental: str = "auto",
    plate_mm: float | None = None,
    on_image: Callable[[], None] = lambda: None,
    on_count: Callable[[int], None] = lambda _: None,
    output: PathLike | None = None,
) -> RunResult:
    """Calibrate and correlate all cameras of a run in parallel.

    Every image is correlated, written to the disk and forgotten, so a long run need not fit into memory. The
    corrections are computed at the end from what is written. The fields of the result are read from its file
    when they are used.

    Parameters
    ----------
    path : path
        The run file. The run may have been killed before its end.
    settings : CorrelationSettings, optional
        Settings of the correlation.
    strain : StrainSettings, optional
    correcting : CorrectionSettings, optional
    incremental : str
        Rule for taking a new reference image in the series of a camera: "auto" (when the correlation drops),
        "never", or "always" (at every image).
    plate_mm : float, optional
        Distance of the specimen's surface behind the grid's lines. Default: the value in the run file, which
        is 0 if protocol and rig file declare none.
    on_image : callable, optional
        Function that is called after each image.
    on_count : callable, optional
        Function that is called once, before the first image, with the number of images.
    output : path, optional
        The result file, which is replaced when it is complete. Until then the finished images are in a folder
        beside it, with the ending ".unfinished". If the program is stopped or killed, an equal call goes on
        after them. Default: a temporary file.

    Raises
    ------
    MeasurementError
        If the file cannot be read, a calibration grid is not found, or the reference image of a camera cannot
        be used. A step that cannot be correlated raises no error: `CameraResult.failures` lists the step.
    """
    require_kind("path", path, str | Path, "name a run file")
    Series.require_incremental(incremental)
    require_kind("settings", settings, CorrelationSettings | None, "give dic.CorrelationSettings()")
    require_kind("strain", strain, StrainSettings | None, "give dic.StrainSettings(window_points=3)")
    require_kind("correcting", correcting, CorrectionSettings | None, "give dic.CorrectionSettings()")
    settings = settings or CorrelationSettings()
    strain = strain or StrainSettings()
    with open_run(path) as run, result_place(output) as place:
        run.step_of_kind("grid")
        run.step_of_kind("reference")
        correcting = correcting or CorrectionSettings()
        plate_mm = run.mounting.plate_mm if plate_mm is None else plate_mm
        kinds = {step.kind for step in run.series()[1:]}
        correcting.require_use(str(path), list(run.cameras), kinds)
        correcting = correcting.completed(run.mounting)
        on_count(len(run.cameras) * (len(run.series()) - 1))
        with unfinished(place, _job(run, settings, incremental, plate_mm)) as kept:
            work = _Work(run, kept, settings, strain, incremental, plate_mm, on_image)
            cameras = work.correlate_all()
            _write(place, run, settings, correcting, cameras)
        result = load_run_result(place)
    specimens = {camera.camera: camera.specimen for camera in cameras}
    return replace(
        result, cameras=[replace(camera, specimen=specimens[camera.camera]) for camera in result.cameras]
    )


def _job(run: RunFile, settings: CorrelationSettings, incremental: str, plate_mm: float) -> dict[str, Any]:
    """Return all that determines the fields of a run beside the images of its steps."""
    fixed = [run.step_of_kind("grid"), run.step_of_kind("reference")]
    digests = [run.digest(camera, step) for camera in run.cameras for step in fixed]
    return {
        "run": run.info.run_id,
        "images of grid and reference": joined_digest(digests),
        **vars(settings),
        "incremental": incremental,
        "plate_mm": plate_mm,
        "versions": versions(),
    }


def _write(
    path: Path,
    run: RunFile,
    settings: CorrelationSettings,
    correcting: CorrectionSettings,
    cameras: Sequence[CameraResult],
) -> None:
    """Correct the strains of all steps, and write the result file."""
    corrector = RunCorrector(cameras, correcting)
    outlines = []
    origin = Provenance.of([run.path])
    with RunResultWriter(path, cameras, origin, corrector.pair) as writer:
        for step in corrector.steps():
            writer.add(step)
            outlines.append(step.outline)
        corrections = corrector.corrections(outlines)
        writer.finish(str(run.path), run.info, settings, correcting, corrections)


@dataclass(frozen=True)
class _Work:
    """The correlation of all cameras of a run, into the folder of finished images."""

    run: RunFile
    kept: Unfinished
    settings: CorrelationSettings
    strain: StrainSettings
    incremental: str
    plate_mm: float
    on_image: Callable[[], None]
    stopped: Event = field(default_factory=Event)

    def correlate_all(self) -> list[CameraResult]:
        """Correlate the images of all cameras in parallel."""
        # Threads can use all cores, because the compiled correlation releases Python's global lock.
        with ThreadPoolExecutor() as pool:
            tasks = [pool.submit(self.correlate, camera) for camera in self.run.cameras]
            try:
                return [task.result() for task in tasks]
            except BaseException:
                # The pool waits for its threads to finish. Tell them to stop; otherwise the program would
                # process the whole run before it ends after Ctrl-C.
                self.stopped.set()
                raise

    def correlate(self, camera: str) -> CameraResult:
        """Correlate the images of a camera. Its measurements are computed when they are used."""
        run, calibration = self.run, _calibrate(self.run, camera, self.plate_mm)
        first, *others = run.series()
        reference = run.image(camera, first)
        region = _calibrated_region(calibration, reference.shape)
        series = self._series(reference, region)
        finished = self.kept.series(run.cameras.index(camera))
        turn = _Turn(calibration, first.angle_deg)
        images = (
            SeriesImage(partial(run.image, camera, step), f"step {step.index}", hint, digest)
            for step in others
            if not self.stopped.is_set()
            for hint, digest in [(turn.hint(step), _digest(run, camera, step))]
        )
        steps, numbers, failures = [], [], []
        correlated = correlate_series(series, images, finished)
        for number, (step, found) in enumerate(zip(others, correlated, strict=False), 1):
            if found.fields is None:
                failures.append(f"{run.path}: {camera}, {found.label}: {found.failure}")
            else:
                numbers.append(number)
                steps.append(step)
            self.on_image()

        shared = series.shared

        def measurement(k: int) -> Measurement:
            return measurement_of(finished.read(numbers[k], shared), calibration, self.strain)

        measurements = Computed(len(numbers), measurement)
        return CameraResult(camera, calibration, reference, steps, measurements, failures, series.specimen)

    def _series(self, reference: Grey, area: Mask) -> Series:
        """Return the series of a camera, on the specimen in the calibrated area, or on all of this area."""
        how: dict[str, Any] = {
            "incremental": self.incremental,
            "threads": max(1, processors() // len(self.run.cameras)),
        }
        try:
            return Series(reference, None, self.settings, within=area, **how)
        except SpecimenNotFound:
            # A run has no other place than the calibrated area. Each subset there is checked for texture.
            return Series(reference, area, self.settings, **how)


def _digest(run: RunFile, camera: str, step: RunStep) -> str:
    try:
        return run.digest(camera, step)
    except RunFileError:
        # Reading the image raises an error that names the reason.
        return UNREADABLE


def _calibrate(run: RunFile, camera: str, plate_mm: float) -> Calibration:
    image = run.image(camera, run.step_of_kind("grid"))
    source = f"{run.path}: {camera}"
    try:
        grid = find_target(image, _target(run), source)
    except CalibrationError as error:
        raise CalibrationError(source, error.step, error.expected, error.got, error.remedy) from error
    calibration = Calibration.fit(grid, image.shape, source)
    return behind(calibration, plate_mm) if plate_mm else calibration


def _target(run: RunFile) -> Target:
    counts, pitch_mm = run.grid_lines, run.grid_pitch_mm
    match run.grid_target:
        case "lines":
            return LineGridTarget(counts, pitch_mm)
        case "checkerboard":
            return CheckerboardTarget(counts, pitch_mm)
        case "charuco":
            return CharucoTarget(counts, pitch_mm, run.grid_marker_mm, run.grid_dictionary)
        case "dots":
            return DotTarget(counts, pitch_mm)
    raise CalibrationError(
        str(run.path),
        "find target",
        "lines, checkerboard, charuco or dots",
        repr(run.grid_target),
        "process the run with the version of offaxis that recorded it, or a newer one",
    )


def _calibrated_region(calibration: Calibration, shape: tuple[int, ...]) -> Mask:
    """Return a mask of the calibrated area, in which all points of interest must lie."""
    height, width = shape
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    pixels = np.stack([x.ravel(), y.ravel()], axis=1).astype(np.float64)
    return calibration.inside(pixels).reshape(height, width)


class _Turn:
    """Prediction of the specimen's motion in the image from the angle of the rotation stage."""

    def __init__(self, calibration: Calibration, start_deg: float) -> None:
        import cv2

        grid = calibration.grid
        plane, _ = cv2.findHomography(grid.uv_px, grid.xy_mm)
        self._to_mm: Float = np.asarray(plane, np.float64)
        self._start_deg = start_deg

    def hint(self, step: RunStep) -> Float | None:
        """Return the homography of a rotation about the grid's centre; None if the run has no stage angle."""
        turned = np.radians(step.angle_deg - self._start_deg)
        if not np.isfinite(turned):
            return None
        c, s = np.cos(turned), np.sin(turned)
        rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        motion: Float = np.linalg.inv(self._to_mm) @ rotation @ self._to_mm
        return np.asarray(motion / motion[2, 2])
