"""The reference image of a run's camera, as an image to draw on."""

from dataclasses import dataclass
from pathlib import Path

from dic.calibration.calibration import Calibration
from dic.calibration.plate import behind
from dic.errors import RunFileError
from dic.pipeline.run_cameras import calibrate_camera
from dic.runfile.joined import open_run
from dic.runfile.reader import RunFile
from dic.typing import Grey, PathLike


@dataclass(frozen=True)
class RunReference:
    """The reference image of a run's camera.

    Attributes
    ----------
    camera : str
    name : str
        Name of the image: the run file and the camera.
    image : ndarray of float32, shape (height, width)
    calibration : Calibration
        The calibration of the camera, from the run's grid image.
    """

    camera: str
    name: str
    image: Grey
    calibration: Calibration


def run_reference(path: PathLike, camera: str | None = None) -> RunReference:
    """Return the reference image of a run's camera.

    Parameters
    ----------
    path : path
        The run file.
    camera : str, optional
        Name of the camera. It may be left out if the run has one camera.

    Raises
    ------
    MeasurementError
        If the file cannot be read, the run has no such camera or no reference image, or the grid is not
        found.
    """
    with open_run(path) as run:
        chosen = _camera(run, camera)
        image = run.image(chosen, run.step_of_kind("reference"))
        name = f"{Path(path).name}, {chosen}"
        lines, plate_mm = calibrate_camera(run, chosen), run.mounting.plate_mm
        return RunReference(chosen, name, image, behind(lines, plate_mm) if plate_mm else lines)


def _camera(run: RunFile, camera: str | None) -> str:
    if camera in run.cameras:
        return camera
    if camera is None and len(run.cameras) == 1:
        return run.cameras[0]
    expected, got = " or ".join(run.cameras), "none" if camera is None else camera
    remedy = f"give --camera {run.cameras[0]}"
    raise RunFileError(str(run.path), "choose a camera", expected, got, remedy)
