"""A run file, and the regions to measure in the images of its cameras."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import Any

from dic.errors import CorrelationError, require_kind
from dic.image.given import checked_region
from dic.runfile.reader import RunFile
from dic.typing import Mask, PathLike

Region = Mask | PathLike | Callable[[tuple[int, ...]], Mask | None]


@dataclass(frozen=True)
class RunSource:
    """A run file, and the regions to measure in the images of its cameras.

    Attributes
    ----------
    path : path
        The run file.
    regions : mapping of str to (ndarray of bool, path or callable)
        The region to measure, keyed by the camera's name: a mask, shape (height, width), or the path of a
        mask image or of a region file, or a function that returns the mask for the shape (height, width) of
        the camera's images.
        Only the calibrated part of a region is measured. A camera without a region measures the specimen,
        which is found by its speckles.
    """

    path: PathLike
    regions: Mapping[str, Region] = field(default_factory=dict)

    def __post_init__(self) -> None:
        require_kind("path", self.path, str | Path, "name a run file")

    def masks(self, run: RunFile) -> dict[str, Mask]:
        """Return the regions as masks that have the shape of the cameras' images.

        Raises
        ------
        MeasurementError
            If the run has no camera of that name, or if a region cannot be read or does not fit the images.
        """
        for camera in self.regions:
            if camera not in run.cameras:
                expected, remedy = f"one of {', '.join(run.cameras)}", "name a camera of the run"
                raise CorrelationError(str(run.path), "choose the region", expected, camera, remedy)
        return {camera: _mask(region, run.image_shape(camera)) for camera, region in self.regions.items()}


def region_digests(masks: Mapping[str, Mask]) -> dict[str, Any]:
    """Return a part of a run's job that names the regions of its cameras; empty without regions.

    Results that were measured without regions have no such part, also results of earlier versions.
    """
    digests = {camera: sha256(mask.tobytes()).hexdigest() for camera, mask in masks.items()}
    return {"regions": digests} if digests else {}


def _mask(region: Region, shape: tuple[int, int]) -> Mask:
    return checked_region(region(shape) if callable(region) else region, shape)
