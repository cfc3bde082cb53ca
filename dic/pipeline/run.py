"""The processing of a run file: calibrate every camera and correlate the images of every step."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from threading import Event

import numpy as np

from dic.calibration.calibration import Calibration
from dic.calibration.plate import behind
from dic.correlation.series import Series
from dic.correlation.settings import CorrelationSettings
from dic.errors import CalibrationError, RunFileError, require_kind
from dic.image.threads import processors
from dic.out_of_plane.diagnosis import Sensitivity
from dic.pipeline.camera_result import CameraResult
from dic.pipeline.images import SeriesImage, measure_series
from dic.pipeline.run_corrections import (
    CorrectionSettings,
    RunCorrections,
    correct_run,
    stated_camera,
)
from dic.pipeline.series_result import MeasuredImage, MeasuredSeries
from dic.runfile.joined import open_run
from dic.runfile.reader import RunFile, RunInfo, RunStep
from dic.strain.strain import StrainSettings
from dic.targets.find import CharucoTarget, CheckerboardTarget, DotTarget, LineGridTarget, Target, find_target
from dic.typing import Float, Mask, PathLike


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
    """

    source: str
    info: RunInfo
    settings: CorrelationSettings
    correcting: CorrectionSettings
    cameras: list[CameraResult]
    corrections: RunCorrections

    def __repr__(self) -> str:
        lines = [f"  {camera}" for camera in self.cameras]
        return "\n".join([f"RunResult of {self.source}, {self.info.title!r}, {self.info.status}", *lines])

    def series(self, camera: str) -> MeasuredSeries:
        """Return a camera's results in the form that `measure_images` returns.

        Each step has its best correction: the correction by two cameras together if the step has one, else
        the correction by this camera alone.

        Parameters
        ----------
        camera : str
            Name of the camera in the run.

        Raises
        ------
        RunFileError
            If the run has no such camera.
        """
        cameras = {found.camera: found for found in self.cameras}
        if camera not in cameras:
            expected, remedy = " or ".join(cameras), f"give {next(iter(cameras), 'a camera of the run')}"
            raise RunFileError(self.source, "choose a camera", expected, str(camera), remedy)
        found = cameras[camera]
        images = [
            MeasuredImage(measurement.label, measurement, self.corrections.best(camera, step.index, place))
            for place, (step, measurement) in enumerate(zip(found.steps, found.measurements, strict=True))
        ]
        images += [MeasuredImage(camera, failure=sentence) for sentence in found.failures]
        alignment = self.corrections.cameras[camera].alignment
        return MeasuredSeries(found.reference, tuple(images), alignment, Sensitivity.of(found.calibration))


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
) -> RunResult:
    """Calibrate and correlate all cameras of a run in parallel.

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
    with open_run(path) as run:
        run.step_of_kind("grid")
        run.step_of_kind("reference")
        correcting = (correcting or CorrectionSettings()).completed(run.mounting)
        plate_mm = run.mounting.plate_mm if plate_mm is None else plate_mm
        kinds = {step.kind for step in run.series()[1:]}
        correcting.require_use(str(path), list(run.cameras), kinds)
        on_count(len(run.cameras) * (len(run.series()) - 1))
        # Threads can use all cores, because the compiled correlation releases Python's global lock.
        with ThreadPoolExecutor() as pool:
            stopped = Event()
            tasks = [
                pool.submit(
                    _process_camera, run, name, settings, strain, incremental, plate_mm, on_image, stopped
                )
                for name in run.cameras
            ]
            try:
                cameras = [task.result() for task in tasks]
            except BaseException:
                # The pool waits for its threads to finish. Tell them to stop; otherwise the program would
                # process the whole run before it ends after Ctrl-C.
                stopped.set()
                raise
        corrections = correct_run(cameras, correcting)
        cameras = [stated_camera(camera, corrections) for camera in cameras]
        return RunResult(str(path), run.info, settings, correcting, cameras, corrections)


def _process_camera(
    run: RunFile,
    camera: str,
    settings: CorrelationSettings,
    strain: StrainSettings,
    incremental: str,
    plate_mm: float,
    on_image: Callable[[], None],
    stopped: Event,
) -> CameraResult:
    calibration = _calibrate(run, camera, plate_mm)
    first, *others = run.series()
    reference = run.image(camera, first)
    region = _calibrated_region(calibration, reference.shape)
    threads = max(1, processors() // len(run.cameras))
    series = Series(reference, None, settings, incremental=incremental, within=region, threads=threads)
    turn = _Turn(calibration, first.angle_deg)
    images = (
        SeriesImage(run.image(camera, step), f"step {step.index}", turn.hint(step))
        for step in others
        if not stopped.is_set()
    )
    steps, measurements, failures = [], [], []
    for step, found in zip(others, measure_series(series, images, calibration, strain), strict=False):
        if found.measurement is None:
            failures.append(f"{run.path}: {camera}, {found.label}: {found.failure}")
        else:
            measurements.append(found.measurement)
            steps.append(step)
        on_image()
    return CameraResult(camera, calibration, reference, steps, measurements, failures, series.specimen)


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
