"""The images of a tensile test in the report: their measurements, and the image files themselves."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from dic.calibration.calibration import Calibration
from dic.errors import MeasurementError, RunFileError
from dic.image.pages import page_name, split_page
from dic.image.read import read_image
from dic.pipeline.run_result import RunResult
from dic.pipeline.series_result import MeasuredSeries
from dic.pipeline.series_result_file import SeriesResult
from dic.results.provenance import file_digest
from dic.runfile.reader import RunFile, RunStep
from dic.typing import Float, Grey

Results = RunResult | SeriesResult
_TAKEN = ("exif", "video")
"""Sources of image times that contain the camera's own time."""


@dataclass(frozen=True)
class CameraImages:
    """The images of one camera of a test.

    Attributes
    ----------
    camera : str
        Name of the camera; "" for a series of images.
    series : MeasuredSeries
        Measurements and corrections; an image is read from the result file when it is used.
    calibration : Calibration or None
    labels : tuple of str
        Name of each image of the series: its file, or the run's step. The curve of the test uses the same
        names.
    times_s : ndarray, shape (images,)
        When each image was taken; NaN where it is not known. The time of the last change of a file does not
        count.
    """

    camera: str
    series: MeasuredSeries
    calibration: Calibration | None
    labels: tuple[str, ...]
    times_s: Float
    _read: Callable[[int], Grey]

    def place(self, label: str) -> int | None:
        """Return the index of the measured image with this label; None if there is no such image."""
        if label not in self.labels:
            return None
        place = self.labels.index(label)
        return None if self.series.images[place].measurement is None else place

    def deformed(self, place: int) -> Grey:
        """Return the deformed image itself, which is not in the result file.

        Raises
        ------
        MeasurementError
            If the image file is missing, or is not the image that was measured.
        """
        return self._read(place)


def images_of(result: Results) -> list[CameraImages]:
    """Return the images of each camera of a result, the on-axis camera first."""
    if isinstance(result, SeriesResult):
        labels = tuple(image.label for image in result.series.images)
        times = [one.time for one in result.series.images]
        times_s = np.array([time.time_s if time.source in _TAKEN else np.nan for time in times], np.float64)
        read = partial(_read_file, result)
        return [CameraImages("", result.series, result.calibration, labels, times_s, read)]
    found = []
    # As in the tables of values, the on-axis camera comes first.
    for camera in sorted(result.cameras, key=lambda one: one.camera != "on_axis"):
        labels = tuple(f"{step.kind} {step.index}" for step in camera.steps)
        read = partial(_read_step, result, camera.camera, camera.steps)
        series = result.series(camera.camera)
        times_s = np.array([step.time_s for step in camera.steps], np.float64)
        found.append(CameraImages(camera.camera, series, camera.calibration, labels, times_s, read))
    return found


def beside(path: str, result_file: str) -> Path:
    """Return the path of a file that a result names; if it does not exist, in the folder of the result."""
    named = Path(path)
    if named.exists() or named.is_absolute() or not result_file:
        return named
    other = Path(result_file).parent / named
    return other if other.exists() else Path(result_file).parent / named.name


def _read_file(result: SeriesResult, place: int) -> Grey:
    image = result.series.images[place]
    file, page = split_page(image.label)
    path = beside(str(file), result.source)
    try:
        digest = file_digest(path)
    except OSError as error:
        got, remedy = error.strerror or str(error), "put the image back to where it was measured"
        raise RunFileError(image.label, "draw the deformed image", "the image file", got, remedy) from error
    if image.measurement is not None and image.measurement.digest not in ("", digest):
        raise _other(image.label)
    return read_image(path if page is None else page_name(path, page))


def _read_step(result: RunResult, camera: str, steps: Sequence[RunStep], place: int) -> Grey:
    step = steps[place]
    name = f"{camera}, step {step.index}"
    with RunFile(beside(result.source, result.file)) as run:
        recorded = next((one for one in run.steps if one.index == step.index), None)
        if camera not in run.cameras or recorded is None:
            raise _other(name)
        known = result.series(camera).images[place].measurement
        if known is not None and known.digest not in ("", run.digest(camera, recorded)):
            raise _other(name)
        return run.image(camera, recorded)


def _other(name: str) -> MeasurementError:
    expected, remedy = "the image that was measured", "put the measured image back, or measure again"
    return RunFileError(name, "draw the deformed image", expected, "another image", remedy)
