"""The classes `MeasuredImage` and `MeasuredSeries`: the results of a series of images."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dic.calibration.calibration import Calibration
from dic.errors import CorrelationError, RunFileError
from dic.image.times import ImageTime
from dic.out_of_plane.alignment import Alignment
from dic.out_of_plane.correction import Correction
from dic.out_of_plane.diagnosis import Sensitivity
from dic.runfile.reader import RunStep
from dic.strain.measurement import Measurement
from dic.strain.strain import MeanStrain, StrainField
from dic.typing import Float, Grey, Indices


@dataclass(frozen=True)
class MeasuredImage:
    """The result of one image of a series.

    Attributes
    ----------
    label : str
        The path of the image file, or the name that the caller gave to the image.
    measurement : Measurement or None
        Displacements and strains of the image; None if the image could not be measured.
    correction : Correction or None
        Correction of the calibrated strain for motion out of the calibration grid's plane.
    failure : str or None
        The reason why the image could not be measured, as one sentence.
    time : ImageTime
        When the image was taken, relative to the reference. Not used for a run, whose steps have their own
        times.
    """

    label: str
    measurement: Measurement | None = None
    correction: Correction | None = None
    failure: str | None = None
    time: ImageTime = field(default_factory=ImageTime)

    def __repr__(self) -> str:
        found = self.failure if self.measurement is None else f"{self.mean}"
        return f"MeasuredImage({self.label!r}, {found})"

    @property
    def mean(self) -> MeanStrain:
        """Mean strain of the image: the corrected strain if it exists, else the calibrated or raw strain.

        Raises
        ------
        CorrelationError
            If the image could not be measured.
        """
        return self._measured.mean if self._corrected is None else self._corrected.mean

    @property
    def strain(self) -> "PlacedStrain":
        """Local strain of the image with the positions of the points.

        The strain is the corrected strain if it exists, else the calibrated or raw strain.

        Raises
        ------
        CorrelationError
            If the image could not be measured.
        """
        measured, corrected = self._measured, self._corrected
        strain, displacement = measured.strain, measured.calibrated
        if corrected is not None:
            strain, displacement = corrected.strain, corrected.displacement
        x_px, y_px = np.meshgrid(measured.field.x_px, measured.field.y_px)
        place_mm = None if displacement is None else np.moveaxis(displacement.position, -1, 0)
        x_mm, y_mm = (None, None) if place_mm is None else place_mm
        return PlacedStrain(**vars(strain), x_px=x_px, y_px=y_px, x_mm=x_mm, y_mm=y_mm)

    def row(self) -> dict[str, Any]:
        """Return the results as a dict for `write_strain_table`; `docs/results.md` explains the values."""
        if self.measurement is None:
            return {"file": self.label, "error": self.failure} | self.time.as_dict()
        corrected = {} if self.correction is None else {"corrected": self.correction.as_dict()}
        times = self.time.as_dict()
        return self.measurement.summary() | times | corrected | {"error": self.measurement.objection}

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


@dataclass(frozen=True, kw_only=True)
class PlacedStrain(StrainField):
    """Local strain with the positions of the points in the reference."""

    x_px: Indices
    y_px: Indices
    """Shape (rows, columns). Positions in the image: x to the right, y downwards."""
    x_mm: Float | None = None
    y_mm: Float | None = None
    """Shape (rows, columns). Positions in the grid's axes: X to the right, Y upwards; NaN where they are not
    known. None without a calibration.
    """

    def __repr__(self) -> str:
        return super().__repr__().replace("StrainField", type(self).__name__, 1)


@dataclass(frozen=True)
class MeasuredSeries:
    """The results of a series of images.

    Attributes
    ----------
    reference : ndarray of float32, shape (height, width)
        The reference image.
    images : sequence of MeasuredImage
        The results of all images in order, including the images that could not be measured. The results of a
        run are read from its result file when they are used.
    alignment : Alignment or None
        Alignment of the specimen on the rotation stage; None if the alignment is not known.
    sensitivity : Sensitivity or None
        False strain that a small motion of the specimen out of the calibration grid's plane causes.
    """

    reference: Grey
    images: Sequence[MeasuredImage]
    alignment: Alignment | None = None
    sensitivity: Sensitivity | None = None

    def __repr__(self) -> str:
        lines = [f"  {image}" for image in self.images]
        return "\n".join([f"MeasuredSeries of {len(lines)} images, {len(self.failures)} failed", *lines])

    @property
    def measurements(self) -> tuple[Measurement, ...]:
        """The measurements of all images that could be measured."""
        return tuple(image.measurement for image in self.images if image.measurement is not None)

    def rows(self) -> list[dict[str, Any]]:
        """Return the results of all images for `write_strain_table`."""
        return [image.row() for image in self.images]

    @property
    def failures(self) -> tuple[str, ...]:
        """One sentence for each image that could not be measured."""
        return tuple(image.failure for image in self.images if image.failure is not None)

    @property
    def result_file(self) -> str:
        """Path of the result file: "", because there is none."""
        return ""

    @property
    def views(self) -> "list[CameraView]":
        """The only camera, as in a result file."""
        return [CameraView("", self)]


@dataclass(frozen=True)
class CameraView:
    """The results of one camera: what tables, pictures and gauges need to know of it."""

    camera: str
    """Name of the camera; "" for a series of image files."""
    series: MeasuredSeries
    calibration: Calibration | None = None
    steps: Sequence[RunStep] = ()
    """The steps of the images that could be measured, which are the first ones; empty for a series of image
    files.
    """

    def known(self, place: int) -> dict[str, Any]:
        """Return what is known of an image: camera, step and readings, or the time of its file."""
        if not self.camera:
            return self.series.images[place].time.as_dict()
        if place >= len(self.steps):
            return {"camera": self.camera}
        step = self.steps[place]
        return step.known() | {"camera": self.camera, "step": f"{step.kind} {step.index}"}


def require_camera(views: Sequence[CameraView], camera: str | None, source: str) -> list[CameraView]:
    """Return the view of the named camera, or all views without a name.

    Raises `RunFileError` if there is no such camera.
    """
    names = [view.camera for view in views]
    if camera is None or camera in names:
        return [view for view in views if camera in (None, view.camera)]
    if names == [""]:
        expected, got, remedy = "results of a run", "those of a series", "leave the camera out"
        raise RunFileError(source, "choose a camera", expected, got, remedy)
    raise RunFileError(source, "choose a camera", " or ".join(names), str(camera), f"give {names[0]}")


def only_camera(views: Sequence[CameraView], camera: str | None, source: str) -> CameraView:
    """Return the view of the named camera, or the only view.

    Raises `RunFileError` if there is no such camera, or if there are several and no name.
    """
    chosen = require_camera(views, camera, source)
    if len(chosen) != 1:
        names = [view.camera for view in chosen]
        expected, remedy = f"one of {', '.join(names)}", f"give --camera {names[0]}"
        raise RunFileError(source, "choose a camera", expected, "none", remedy)
    return chosen[0]
