"""Corrections of a series of images for motion out of the grid's plane, where the motion is known."""

from collections.abc import Sequence
from dataclasses import replace

from dic.calibration.calibration import Calibration
from dic.errors import CorrelationError, require_kind
from dic.out_of_plane.alignment import Alignment
from dic.out_of_plane.correct import Motion, correct
from dic.pipeline.series_result import MeasuredImage


def require_calibration(motion: Motion | None, calibration: Calibration | None) -> None:
    """Refuse a motion whose correction needs a calibration if there is no calibration.

    Raises
    ------
    CorrelationError
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


def corrected(image: MeasuredImage, calibration: Calibration | None, motion: Motion | None) -> MeasuredImage:
    """Return an image with its correction; not for a rotation, whose correction needs all images."""
    if image.measurement is None or calibration is None or motion is None or motion.kind == "rigid":
        return image
    return replace(image, correction=correct([image.measurement], calibration, motion).images[0])


def corrected_rotation(
    images: Sequence[MeasuredImage], calibration: Calibration, motion: Motion
) -> tuple[list[MeasuredImage], Alignment | None]:
    """Correct all images of a rotation together.

    Returns
    -------
    list of MeasuredImage
        The same images with their corrections.
    Alignment or None
        Alignment of specimen and stage: the solved one if there is one, else the given one.
    """
    measurements = [image.measurement for image in images if image.measurement is not None]
    found = correct(measurements, calibration, motion)
    corrections = iter(found.images)
    return [
        image if image.measurement is None else replace(image, correction=next(corrections))
        for image in images
    ], found.alignment or motion.alignment
