"""The cameras of a run: the calibration of each from its grid image, and its images one by one."""

import math
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from dic.calibration.area import calibrated_area
from dic.calibration.calibration import Calibration
from dic.calibration.grid_making import GridAccuracy
from dic.calibration.one_grid import of_one_grid
from dic.calibration.plate import behind
from dic.correlation.series import Series
from dic.correlation.settings import CorrelationSettings
from dic.errors import CorrelationError, warn_of_image
from dic.image.threads import processors
from dic.pipeline.camera import CameraImages, Kept
from dic.pipeline.correlated import correlate_series
from dic.pipeline.grid_images import calibrated, target_of_run
from dic.pipeline.run_image import RunImage
from dic.pipeline.series_image import UNREADABLE, SeriesImage
from dic.results.finished import FinishedImage
from dic.results.job import ImageOutcome, content_of
from dic.runfile.at_exposure import ExposedSteps, steps_at_exposure
from dic.runfile.reader import RunFile, RunStep
from dic.specimen.find import SpecimenNotFound
from dic.typing import Float, ImageLike, Mask
from dic.workers.workers import Workers


@dataclass(frozen=True)
class RunCameras:
    """The cameras of a run, and how their images are correlated."""

    run: RunFile
    regions: Mapping[str, Mask]
    """The region to measure of each camera that has one, by the camera's name."""
    settings: CorrelationSettings
    incremental: str
    plate_mm: float
    """Distance of the specimen's surface behind the grid's lines."""
    accuracy: GridAccuracy = field(default_factory=GridAccuracy)
    """How accurately the grid was made."""
    grid_run: RunFile | None = None
    """The run with the images of the grid; by default the run itself."""
    workers: Workers | None = None
    """Workers that correlate the images of all cameras. By default each camera has a thread of its own."""

    @cached_property
    def exposed(self) -> dict[str, ExposedSteps]:
        """The steps as each camera saw them, with the readings at the middle of its exposures."""
        return steps_at_exposure(self.run)

    def calibrated(self) -> list[CameraImages]:
        """Calibrate all cameras at the same time, and return them with their images."""
        with ThreadPoolExecutor() as pool:
            grid = self.grid_run or self.run
            fitted = pool.map(partial(calibrate_camera, grid, accuracy=self.accuracy), self.run.cameras)
            return list(map(self._calibrated, self.run.cameras, of_one_grid(tuple(fitted))))

    def outcomes(self) -> dict[str, list[ImageOutcome]]:
        """Return the names and the contents of the images of each camera."""
        return {
            camera: [
                ImageOutcome(f"step {step.index}", step_content(self.run, camera, step))
                for step in self.run.series()[1:]
            ]
            for camera in self.run.cameras
        }

    def _calibrated(self, camera: str, lines: Calibration) -> CameraImages:
        run = self.run
        exposed = self.exposed[camera]
        # The fields do not depend on the thickness of the plate, so a new thickness needs no new correlation.
        calibration = behind(lines, self.plate_mm) if self.plate_mm else lines
        correlate = partial(self._correlated, lines)
        reference = run.image(camera, run.series()[0])
        steps, remarks = exposed.steps[1:], exposed.remarks
        return CameraImages(camera, reference, calibration, correlate, steps, remarks=remarks)

    def _correlated(
        self, lines: Calibration, camera: CameraImages, kept: Kept | None
    ) -> Iterator[FinishedImage]:
        """Yield the correlated images of a camera; the memory of the correlation is free after the last."""
        run, name = self.run, camera.camera
        first, *others = run.series()
        taken = RunImage(run, name, first)
        source = SeriesImage(taken, f"step {first.index}", digest=taken.digest()).read
        series = self._series(name, source, calibrated_area(lines, camera.reference.shape))
        camera.specimen = series.specimen
        turn = _Turn(lines, first.angle_deg)
        images = (
            SeriesImage(taken, f"step {taken.step.index}", turn.hint(taken.step), taken.digest())
            for taken in (RunImage(run, name, step) for step in others)
        )
        found = correlate_series(series, images, camera.before, kept, self.workers, len(run.cameras))
        contents = (step_content(run, name, step) for step in others)
        yield from map(lambda image, content: replace(image, content=content), found, contents)

    def _series(self, camera: str, reference: Callable[[], ImageLike], area: Mask) -> Series:
        """Return a camera's series in its region, on the specimen, or on the calibrated area.

        Without a region, the specimen is found by its speckles. The calibrated area is used if no specimen is
        found.
        """
        how: dict[str, Any] = {
            "incremental": self.incremental,
            # The stage tells the angle, but not the place of its axis.
            "hint_decides": False,
            "threads": max(1, processors() // len(self.run.cameras)),
        }
        region = self.regions.get(camera)
        if region is not None:
            _compare_with_calibration(f"{self.run.path}: {camera}", region, area)
            return Series(reference, region, self.settings, within=area, **how)
        try:
            return Series(reference, None, self.settings, within=area, **how)
        except SpecimenNotFound:
            # A run can only be measured in the calibrated area, so use all of this area. Each subset is
            # checked for texture.
            return Series(reference, area, self.settings, **how)


def step_content(run: RunFile, camera: str, step: RunStep) -> str:
    """Return the text that identifies an image of a run, with the angle that gives its first guess."""
    digest = RunImage(run, camera, step).digest()
    turned_deg = step.angle_deg - run.series()[0].angle_deg
    return "" if digest == UNREADABLE else content_of(digest, [turned_deg])


def calibrate_camera(run: RunFile, camera: str, accuracy: GridAccuracy | None = None) -> Calibration:
    """Return the calibration of a run's camera, from the first image of the grid.

    `accuracy`: how accurately the grid was made. Default: as the run file says.
    Raises `MeasurementError` if the run has no image of the grid, or the grid is not found.
    """
    image = run.image(camera, run.step_of_kind("grid"))
    made = accuracy or GridAccuracy(**run.grid_making)
    return calibrated(image, target_of_run(run), f"{run.path}: {camera}", made)


def _compare_with_calibration(source: str, region: Mask, area: Mask) -> None:
    """Warn if a part of a region is not calibrated; raise an error if no part is calibrated."""
    pixels, outside = int(region.sum()), int((region & ~area).sum())
    if pixels and outside == pixels:
        raise CorrelationError(
            source,
            "choose the region",
            "a region in the calibrated area, which the grid covers",
            "one outside of it",
            "draw the region where the grid image shows the grid",
        )
    if outside:
        warn_of_image(
            source,
            f"{percent(outside, pixels)} of the region lies outside the calibrated area and is not measured",
        )


def percent(part: int, whole: int) -> str:
    """Return a share that is neither 0 nor 1 as a percentage; two digits of the smaller side are shown."""
    smaller = 100 * min(part, whole - part) / whole
    return f"{100 * part / whole:.{max(0, 1 - math.floor(math.log10(smaller)))}f} %"


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
