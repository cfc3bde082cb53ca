"""Images of one calibration target by all cameras of a rig, and the calibrations from them."""

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

from dic.calibration.calibration import Calibration
from dic.calibration.grid_making import GridAccuracy
from dic.calibration.one_grid import of_one_grid
from dic.errors import CalibrationError
from dic.image.given import grey_image
from dic.runfile.joined import open_run
from dic.runfile.reader import RunFile
from dic.settings import either
from dic.targets.find import find_target
from dic.targets.kinds import TARGETS, Target
from dic.typing import ImageLike, PathLike


@dataclass(frozen=True)
class GridImages:
    """An image of the same calibration target by each camera of a rig.

    Attributes
    ----------
    images : mapping of str to (ndarray, shape (height, width), or path)
        By the names of the cameras.
    target : Target
        Kind and size of the target.
    accuracy : GridAccuracy
        How accurately the target was made.
    source : str
        What the images belong to, for messages.
    """

    images: Mapping[str, ImageLike]
    target: Target
    accuracy: GridAccuracy = field(default_factory=GridAccuracy)
    source: str = "images of the grid"

    def __repr__(self) -> str:
        return f"GridImages({self.source}: {', '.join(self.images)})"

    @classmethod
    def of_run(cls, path: PathLike) -> "GridImages":
        """Read the images of the grid from a run file.

        Raises
        ------
        MeasurementError
            If the file cannot be read or has no images of the grid.
        """
        with open_run(path) as run:
            step = run.step_of_kind("grid")
            images = {camera: run.image(camera, step) for camera in run.cameras}
            made = GridAccuracy(**run.grid_making)
            return cls(images, target_of_run(run), made, str(run.path))

    @classmethod
    def of_target(
        cls,
        images: Mapping[str, ImageLike],
        kind: str,
        counts: tuple[int, int],
        values: Mapping[str, Any],
        making: Mapping[str, Any],
    ) -> "GridImages":
        """Return images of a target that is described as in a run file.

        Parameters
        ----------
        images : mapping of str to image
        kind : str
            "lines" or another kind of `dic.targets.TARGETS`.
        counts : tuple of int
            Numbers of lines, squares or dots along X and Y.
        values : mapping of str to float or str
            The pitch `pitch_mm`, and the further lengths and names of the kind.
        making : mapping of str to float or str
            Settings of `dic.calibration.GridAccuracy`.
        """
        return cls(images, TARGETS[kind].of(counts, values), GridAccuracy(**making))

    def calibrations(self) -> dict[str, Calibration]:
        """Calibrate all cameras, as those of a run file are calibrated; each is that of the grid's lines.

        Raises
        ------
        CalibrationError
            If the target is not found in an image.
        """
        with ThreadPoolExecutor() as pool:
            fitted = pool.map(self._fitted, self.images)
            return dict(zip(self.images, of_one_grid(tuple(fitted)), strict=True))

    def _fitted(self, camera: str) -> Calibration:
        source = f"{self.source}: {camera}"
        return calibrated(grey_image(self.images[camera], source), self.target, source, self.accuracy)


def calibrated(image: ImageLike, target: Target, source: str, accuracy: GridAccuracy) -> Calibration:
    """Return the calibration from an image of the target; raise a CalibrationError if it is not found."""
    grey = grey_image(image, source)
    try:
        grid = find_target(grey, target, source)
    except CalibrationError as error:
        raise CalibrationError(source, error.step, error.expected, error.got, error.remedy) from error
    return Calibration.fit(grid, grey.shape, source, accuracy=accuracy)


def target_of_run(run: RunFile) -> Target:
    """Return the calibration target of a run; raise a CalibrationError if its kind is unknown."""
    if run.grid_target not in TARGETS:
        raise CalibrationError(
            str(run.path),
            "find target",
            either(TARGETS),
            repr(run.grid_target),
            "process the run with the version of offaxis that recorded it, or a newer one",
        )
    return TARGETS[run.grid_target].of(run.grid_lines, run.grid_values)
