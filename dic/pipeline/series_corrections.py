"""Corrections of a series of images for motion out of the calibration grid's plane."""

from collections.abc import Sequence
from dataclasses import replace

from dic.calibration.calibration import Calibration
from dic.errors import CorrelationError, require_kind
from dic.files.lazy import Computed
from dic.out_of_plane.alignment import Alignment
from dic.out_of_plane.correct import Motion, correct
from dic.out_of_plane.correction import stated
from dic.pipeline.series_result import MeasuredImage
from dic.strain.measurement import Measurement


def require_calibration(motion: Motion | None, calibration: Calibration | None) -> None:
    """Raise an error if the motion is to be corrected but there is no calibration.

    Raises
    ------
    CorrelationError
        If the motion is not "free", or the shift is stated, and there is no calibration, or an argument has
        the wrong type.
    """
    require_kind("motion", motion, Motion | None, 'give dic.Motion("tension")')
    require_kind("calibration", calibration, Calibration | None, "read it with dic.load_calibration(path)")
    if motion is not None and motion.kind != "free" and calibration is None:
        raise CorrelationError(
            "settings",
            "correct for motion out of the plane",
            "a calibration, which knows the camera's place",
            f"--motion {motion.kind} without one",
            "name a calibration file, such as --calibration cal.h5",
        )
    if motion is not None and motion.shift_std_um is not None and calibration is None:
        raise CorrelationError(
            "settings",
            "state the shift towards the camera",
            "a calibration, with which the shift has an effect",
            "--shift-std-um without one",
            "name a calibration file, such as --calibration cal.h5, or leave out --shift-std-um",
        )


def corrected(image: MeasuredImage, calibration: Calibration | None, motion: Motion | None) -> MeasuredImage:
    """Return the image with its correction; the errors of its calibrated strain contain the correction.

    An image of a rotating specimen is returned without a correction, because `corrected_rotation` computes
    the correction from all images. Until then, the errors of the calibrated strain contain the motion that is
    expected of a specimen.
    """
    if image.measurement is None or calibration is None:
        return image
    known = motion is not None and motion.kind != "rigid"
    found = correct([image.measurement], calibration, motion if known and motion else Motion()).images[0]
    measurement = stated(image.measurement, found)
    return replace(image, measurement=measurement, correction=found if known else None)


def corrected_rotation(
    images: Sequence[MeasuredImage], calibration: Calibration, motion: Motion
) -> tuple[Sequence[MeasuredImage], Alignment | None]:
    """Correct all images of a rotation together.

    Memory does not grow with the number of images, if `images` are read when they are used.

    Returns
    -------
    sequence of MeasuredImage
        The given images with their corrections. Each correction is computed when it is used.
    Alignment or None
        Alignment of the specimen on the rotation stage: solved from the images if possible, otherwise the
        alignment in `motion`.
    """
    measured = [k for k, image in enumerate(images) if image.measurement is not None]
    found = correct(Computed(len(measured), lambda k: _measurement(images[measured[k]])), calibration, motion)
    places = {k: place for place, k in enumerate(measured)}

    def solved(k: int) -> MeasuredImage:
        if k not in places:
            return images[k]
        correction = found.images[places[k]]
        measurement = stated(_measurement(images[k]), correction)
        return replace(images[k], measurement=measurement, correction=correction)

    return Computed(len(images), solved), found.alignment or motion.alignment


def _measurement(image: MeasuredImage) -> Measurement:
    if image.measurement is None:
        raise ValueError(f"{image.label} could not be measured")
    return image.measurement
