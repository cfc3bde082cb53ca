"""The images of a tensile test in the report: their measurements, and the image files themselves."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from dic.calibration.calibration import Calibration
from dic.derived.deformed_images import deformed_of_run, deformed_of_series
from dic.pipeline.measured_images import MeasuredImage, MeasuredSeries
from dic.pipeline.result import RunResult, SeriesResult
from dic.typing import Float, Grey

Results = RunResult | SeriesResult
_TAKEN = ("exif", "video")
"""Sources of image times that contain the camera's own time."""


@dataclass(frozen=True)
class ReportedImages:
    """The images of one camera of a test."""

    camera: str
    """Name of the camera; "" for a series of images."""
    series: MeasuredSeries
    """Measurements and corrections; an image is read from the result file when it is used."""
    calibration: Calibration | None
    labels: tuple[str, ...]
    """Name of each image of the series: its file, or the run's step. The curve of the test uses the same
    names.
    """
    times_s: Float
    """Shape (images,). When each image was taken; NaN where it is not known. The time of the last change of a
    file does not count.
    """
    _read: Callable[[int], Grey]

    @property
    def first_measured(self) -> MeasuredImage | None:
        """The first image that could be measured; None if there is none."""
        return next((one for one in self.series.images if one.measurement is not None), None)

    def place(self, label: str) -> int | None:
        """Return the index of the measured image with this label; None if there is no such image."""
        if label not in self.labels:
            return None
        place = self.labels.index(label)
        return None if self.series.images[place].measurement is None else place

    def deformed(self, place: int) -> Grey:
        """Return the deformed image itself, which is not in the result file.

        Raises `MeasurementError` if the image file is missing, or is not the image that was measured.
        """
        return self._read(place)


def images_of(result: Results) -> list[ReportedImages]:
    """Return the images of each camera of a result, the on-axis camera first."""
    if isinstance(result, SeriesResult):
        labels = tuple(image.label for image in result.series.images)
        times = [one.time for one in result.series.images]
        # numpy turns an unknown time, None, into NaN
        times_s = np.array([time.time_s if time.source in _TAKEN else None for time in times], np.float64)
        read = partial(deformed_of_series, result)
        return [ReportedImages("", result.series, result.calibration, labels, times_s, read)]
    found = []
    # As in the tables of values, the on-axis camera comes first.
    for camera in sorted(result.cameras, key=lambda one: one.camera != "on_axis"):
        labels = tuple(f"{step.kind} {step.index}" for step in camera.steps)
        read = partial(deformed_of_run, result, camera.camera, camera.steps)
        series = result.series(camera.camera)
        times_s = np.array([step.time_s for step in camera.steps], np.float64)
        found.append(ReportedImages(camera.camera, series, camera.calibration, labels, times_s, read))
    return found
