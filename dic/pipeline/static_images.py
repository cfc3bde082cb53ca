"""Errors that still images of the undeformed specimen show, for a series of image files."""

from collections.abc import Iterable
from pathlib import Path

from dic.calibration.calibration import Calibration
from dic.correlation.series import Series
from dic.errors import CorrelationError
from dic.image.times import SeriesTimes
from dic.out_of_plane.still_images import still_errors
from dic.strain.measurement import measure
from dic.strain.still import StillErrors
from dic.typing import ImageLike

_MOST_STRAIN = 2e-3
"""Largest strain in an image that can be taken for one of the undeformed specimen."""

_CLOCKS = ("exif", "video")
"""Sources of times that tell when an image was taken, and not when its file was written."""


def static_errors(
    series: Series,
    images: Iterable[ImageLike],
    calibration: Calibration | None,
    times: SeriesTimes | None = None,
) -> StillErrors:
    """Correlate still images with the reference of a series, and return the errors that they show.

    The state of the series does not change. If the times of all images are known, a drift is related to the
    time. Otherwise the still images are numbered from 1, and the images of the series come after them.

    `times`: the times of images that are given by paths.

    Raises
    ------
    CorrelationError
        If there is no calibration, an image cannot be correlated or shows a deformed specimen, or no image
        has enough points.
    """
    given = list(images)
    if calibration is None:
        raise _refused("a calibration, which relates displacements to the camera", "none", "give one, too")
    measured = [measure(series.correlate_still(image), calibration) for image in given]
    for image, found in zip(given, measured, strict=True):
        mean = found.calibrated_mean
        strain = 0.0 if mean is None else max(abs(mean.exx), abs(mean.eyy))
        if strain > _MOST_STRAIN:
            got = f"{1e6 * strain:.0f} µε in {_name(image)}"
            raise _refused("the undeformed specimen", got, "give images from before the test")
    taken = [times.of(image) for image in given if isinstance(image, str | Path)] if times else []
    in_seconds = bool(taken) and all(time.source in _CLOCKS for time in taken)
    elapsed = [time.time_s or 0.0 for time in taken] if in_seconds else [k + 1.0 for k in range(len(given))]
    errors = still_errors(list(zip(measured, elapsed, strict=True)), calibration, in_seconds=in_seconds)
    if errors is None:
        raise _refused("still images with at least a dozen measured points", "none", "give sharper images")
    return errors


def _refused(expected: str, got: str, remedy: str) -> CorrelationError:
    return CorrelationError("still images", "measure errors", expected, got, remedy)


def _name(image: ImageLike) -> str:
    return str(image) if isinstance(image, str | Path) else "a still image"
