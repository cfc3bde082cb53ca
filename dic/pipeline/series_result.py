"""The results of a series of images."""

from dataclasses import dataclass

from dic.errors import CorrelationError
from dic.out_of_plane.alignment import Alignment
from dic.out_of_plane.correction import Correction
from dic.out_of_plane.diagnosis import Sensitivity
from dic.strain.measurement import Measurement
from dic.strain.strain import MeanStrain, StrainField
from dic.typing import Grey


@dataclass(frozen=True)
class MeasuredImage:
    """The result of one image of a series.

    Attributes
    ----------
    label : str
        The image's file, or its given name.
    measurement : Measurement or None
        None if the image could not be measured.
    correction : Correction or None
        Correction of a calibrated measurement for motion out of the grid's plane.
    failure : str or None
        One sentence on why the image could not be measured.
    """

    label: str
    measurement: Measurement | None = None
    correction: Correction | None = None
    failure: str | None = None

    def __repr__(self) -> str:
        found = self.failure if self.measurement is None else f"{self.mean}"
        return f"MeasuredImage({self.label!r}, {found})"

    @property
    def mean(self) -> MeanStrain:
        """Mean strain: corrected if the correction applies, else calibrated, else raw.

        Raises
        ------
        CorrelationError
            If the image could not be measured.
        """
        return self._measured.mean if self._corrected is None else self._corrected.mean

    @property
    def strain(self) -> StrainField:
        """Local strain: corrected if the correction applies, else calibrated, else raw; raises as `mean`."""
        return self._measured.strain if self._corrected is None else self._corrected.strain

    @property
    def _corrected(self) -> Correction | None:
        return None if self.correction is None or self.correction.declined else self.correction

    @property
    def _measured(self) -> Measurement:
        if self.measurement is not None:
            return self.measurement
        raise CorrelationError(
            self.label, "give strain", "an image that could be measured", f"{self.failure}", "mend that first"
        )


@dataclass(frozen=True)
class MeasuredSeries:
    """The images of a series, measured.

    Attributes
    ----------
    reference : ndarray of float32, shape (height, width)
    images : tuple of MeasuredImage
        All images in order, including those that could not be measured.
    alignment : Alignment or None
        Alignment of specimen and stage, if the motion is a rotation that determines the alignment.
    sensitivity : Sensitivity or None
        False strain of the calibrated camera per motion out of the grid's plane.
    """

    reference: Grey
    images: tuple[MeasuredImage, ...]
    alignment: Alignment | None = None
    sensitivity: Sensitivity | None = None

    def __repr__(self) -> str:
        lines = [f"  {image}" for image in self.images]
        return "\n".join([f"MeasuredSeries of {len(lines)} images, {len(self.failures)} failed", *lines])

    @property
    def measurements(self) -> tuple[Measurement, ...]:
        """Measurements of the images that could be measured."""
        return tuple(image.measurement for image in self.images if image.measurement is not None)

    @property
    def failures(self) -> tuple[str, ...]:
        """One sentence for each image that could not be measured."""
        return tuple(image.failure for image in self.images if image.failure is not None)
