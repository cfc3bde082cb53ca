"""One camera of a measurement: its reference image, its calibration, and its images one by one."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

from numpy.typing import NDArray

from dic.calibration.calibration import Calibration
from dic.correlation.series_state import SeriesFields
from dic.results.finished import FinishedImage
from dic.runfile.reader import RunStep
from dic.specimen.find import Specimen

Kept = Callable[[int], SeriesFields]
"""Function that returns the fields of an image again, by its index among the images that have fields."""


class CorrectedCamera(Protocol):
    """What the corrections need to know of a camera."""

    @property
    def camera(self) -> str:
        """Name of the camera in a run; "" for the camera of a series of image files."""

    @property
    def calibration(self) -> Calibration | None:
        """Calibration of the camera."""

    @property
    def reference(self) -> NDArray[Any]:
        """Grey levels of the reference image, shape (height, width)."""

    @property
    def remarks(self) -> Sequence[str]:
        """Sentences about readings of a run that are not known at all images."""


@dataclass
class CameraImages:
    """One camera of a measurement, and a function that correlates its images, or reads them again.

    The images may come one by one, such as those of a test that is going on.
    """

    camera: str
    """Name of the camera in a run; "" for the camera of a series of image files."""
    reference: NDArray[Any]
    """Shape (height, width)."""
    calibration: Calibration | None
    correlate: Callable[["CameraImages", Kept | None], Iterator[FinishedImage]]
    """Function that yields the finished images. Its arguments are the images at the beginning that are
    finished already, and a function of the kind `Kept`, or None.
    """
    steps: Sequence[RunStep] = ()
    """The step of each image; empty for a series of image files."""
    before: Sequence[FinishedImage] = ()
    """The images at the beginning that an earlier measurement has finished."""
    known: bool = False
    """True if all images are finished already."""
    remarks: Sequence[str] = ()
    """Sentences about readings of a run that are not known at all images."""
    specimen: Specimen | None = field(default=None, init=False)
    """The specimen in the reference image; not known before the first image is correlated."""

    def images(self, kept: Kept | None) -> Iterator[FinishedImage]:
        """Yield the finished images, one by one."""
        if self.known:
            return iter(self.before)
        return self.correlate(self, kept)
