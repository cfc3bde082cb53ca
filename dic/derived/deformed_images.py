"""The deformed images of a result, which are not in the result file: read again from their files."""

from collections.abc import Sequence
from pathlib import Path

from dic.errors import MeasurementError, RunFileError
from dic.files.digest import file_sha256
from dic.image.pages import page_name, split_page
from dic.image.read import read_image
from dic.pipeline.measured_images import CameraView
from dic.pipeline.result import RunResult, SeriesResult
from dic.pipeline.result_file import Loaded
from dic.runfile.joined import open_run
from dic.runfile.reader import RunStep
from dic.typing import Grey


def beside(path: str, result_file: str) -> Path:
    """Return the path of a file that a result names; if it does not exist, in the folder of the result."""
    named = Path(path)
    if named.exists() or named.is_absolute() or not result_file:
        return named
    other = Path(result_file).parent / named
    return other if other.exists() else Path(result_file).parent / named.name


def deformed_image(results: Loaded, view: CameraView, place: int) -> Grey:
    """Return a deformed image of a camera, read again from its file, or from the run file.

    Raises `MeasurementError` if the image is not at its place any more, or is another image than the measured
    one.
    """
    if isinstance(results, RunResult):
        return deformed_of_run(results, view.camera, view.steps, place)
    if isinstance(results, SeriesResult):
        return deformed_of_series(results, place)
    return read_image(view.series.images[place].label)


def deformed_of_series(result: SeriesResult, place: int) -> Grey:
    """Return a deformed image of a series, read again from its file.

    `place`: index of the image in the series.

    Raises `MeasurementError` if the image is not at its place any more, or is another image than the measured
    one.
    """
    image = result.series.images[place]
    file, page = split_page(image.label)
    path = beside(str(file), result.source)
    try:
        digest = file_sha256(path)
    except OSError as error:
        got, remedy = error.strerror or str(error), "put the image back to where it was measured"
        raise RunFileError(image.label, "draw the deformed image", "the image file", got, remedy) from error
    if image.measurement is not None and image.measurement.digest not in ("", digest):
        raise _other(image.label)
    return read_image(path if page is None else page_name(path, page))


def deformed_of_run(result: RunResult, camera: str, steps: Sequence[RunStep], place: int) -> Grey:
    """Return a deformed image of a run, read again from the run file.

    `steps`: the steps of the camera that were measured. `place`: index of the step in `steps`.

    Raises `MeasurementError` if the run file is not at its place any more, or has another image than the
    measured one.
    """
    step = steps[place]
    name = f"{camera}, step {step.index}"
    with open_run(beside(result.source, result.file)) as run:
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
