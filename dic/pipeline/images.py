"""The measurement of a series of images, given as files, arrays or steps of a run."""

# The types in the help of these functions are then as short as they are written here.
from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from operator import attrgetter
from pathlib import Path

import numpy as np

from dic.calibration.calibration import Calibration
from dic.calibration.file import load_calibration
from dic.correlation.series import Series
from dic.correlation.settings import CorrelationSettings
from dic.errors import CorrelationError, each_warning_once, require_kind
from dic.image.given import grey_image, kept, one_by_one
from dic.image.pages import list_images
from dic.image.times import SeriesTimes
from dic.keywords import takes_settings
from dic.out_of_plane.diagnosis import Sensitivity
from dic.out_of_plane.motion import Motion
from dic.pipeline.camera import CameraImages, Kept
from dic.pipeline.correlated import correlate_series
from dic.pipeline.measured_images import MeasuredImage, MeasuredSeries
from dic.pipeline.measuring import Measuring
from dic.pipeline.series_image import SeriesImage
from dic.pipeline.series_sources import SeriesSources, expanded, only_paths
from dic.pipeline.set_up import SeriesSetUp, require_calibration, require_size
from dic.pipeline.static_images import static_errors
from dic.results.finished import FinishedImage
from dic.strain.settings import StrainSettings
from dic.typing import Grey, ImageLike, Mask, PathLike


@takes_settings(settings=CorrelationSettings, strain=StrainSettings)
def measure_images(
    reference: ImageLike,
    images: ImageLike | SeriesImage | Iterable[ImageLike | SeriesImage] | None = None,
    *,
    calibration: Calibration | PathLike | None = None,
    settings: CorrelationSettings | None = None,
    strain: StrainSettings | None = None,
    region: Mask | PathLike | None = None,
    incremental: str = "auto",
    motion: Motion | str = "free",
    static: ImageLike | Iterable[ImageLike] | None = None,
) -> MeasuredSeries:
    """Measure displacement and strain in images relative to a reference image.

    >>> series = dic.measure_images("reference.tif", "deformed/*.tif", calibration="calibration.h5")
    >>> series.images[0].mean.exx
    >>> series.images[0].strain.exx, series.images[0].strain.x_mm

    If an image cannot be measured, the function continues with the next image, and `failures` of the result
    lists this image. For series that do not fit into memory use `measure_series`.

    Parameters
    ----------
    reference : ndarray, shape (height, width), or path
        If this is a folder, a pattern or a TIFF file of several pages, its first image is the reference.
    images : iterable of ndarray, path or SeriesImage, optional
        The images of the deformed specimen, in order. A single image may be given without a list. If a
        folder, a pattern such as "img*.tif", or a TIFF file of several pages is given, all its images are
        used, in the natural order of their names; see `list_images`. Default: the other images of
        `reference`.
    calibration : Calibration or path, optional
        Calibration of the camera, for results in millimetres. Without a calibration all results are in
        pixels.
    settings : CorrelationSettings, optional
        Settings of the correlation.
    strain : StrainSettings, optional
    region : ndarray of bool, shape (height, width), or path, optional
        Region to measure. Default: the specimen, which is found by its speckles.
    incremental : str
        Rule for taking a new reference image: "auto" (when the correlation drops), "never", or "always" (at
        every image).
    motion : Motion or str
        Assumed motion of the specimen, used to correct calibrated strain: "free" (no correction), "rigid"
        (rotation without strain) or "tension" (uniform stretching with some bending).
    static : iterable of ndarray or path, optional
        Still images of the undeformed specimen before the test. Errors that they show, such as those by haze
        or a warming camera, enter the standard deviations of strain.

    Raises
    ------
    MeasurementError
        If the reference image, the calibration, the region, a still image or a setting cannot be used.
    """
    motion = Motion(motion) if isinstance(motion, str) else motion
    if isinstance(calibration, str | Path):
        calibration = load_calibration(calibration)
    require_calibration(motion, calibration)
    settings = settings or CorrelationSettings()
    reference, several = _sources(reference, images)
    with each_warning_once():
        grey = kept(grey_image(reference, "reference image"), reference)
        series = Series(lambda: grey, region, settings, incremental=incremental)
        if static is not None:
            times = SeriesTimes(reference) if isinstance(reference, str | Path) else None
            still = static_errors(series, expanded(one_by_one(static)), calibration, times)
            motion = replace(motion, still=still)
        timed = _timed(reference, several)
        measuring = _measuring(series, timed, SeriesSetUp(_strain(strain), motion, calibration), grey)
        found = tuple(step.image for step in measuring.steps())
    if calibration is None:
        return MeasuredSeries(grey, found)
    return MeasuredSeries(grey, found, measuring.alignment(""), Sensitivity.of(calibration))


def _sources(
    reference: ImageLike, images: ImageLike | SeriesImage | Iterable[ImageLike | SeriesImage] | None
) -> tuple[ImageLike, Iterable[ImageLike | SeriesImage]]:
    """Return the reference and an iterable of the images; a path may name a folder, a pattern or a stack."""
    if isinstance(images, SeriesImage):
        return reference, [images]
    several = None if images is None else one_by_one(images)
    if isinstance(reference, str | Path):
        if several is None or (isinstance(several, list | tuple) and only_paths(several)):
            found = SeriesSources.of(reference, several, in_order=True)
            return found.reference, found.images
        reference = list_images(reference)[0]
    if several is None:
        remedy = "give images, or the path of a folder or stack as the reference"
        raise CorrelationError("arguments", "images", "images of the deformed specimen", "None", remedy)
    return reference, expanded(several)


def _timed(
    reference: ImageLike, images: Iterable[ImageLike | SeriesImage]
) -> Iterator[ImageLike | SeriesImage]:
    """Yield the images; an image gets the time it was taken if it and the reference are given by paths."""
    times = SeriesTimes(reference) if isinstance(reference, str | Path) else None
    for image in images:
        if times is None or not isinstance(image, str | Path):
            yield image
        else:
            yield SeriesImage(image, str(image), time=times.of(image))


@takes_settings(settings=CorrelationSettings, strain=StrainSettings)
def measure_series(
    series: Series,
    images: Iterable[ImageLike | SeriesImage],
    calibration: Calibration | None = None,
    strain: StrainSettings | None = None,
    motion: Motion | None = None,
) -> Iterator[MeasuredImage]:
    """Return an iterator that measures the images of a series one by one.

    The iterator reads and measures an image when the caller asks for the next result. The iterator keeps no
    earlier image in memory, except for the data that `Series` needs. If the caller stops iterating, the
    remaining images are not measured.

    Parameters
    ----------
    series : Series
        The reference image and the settings of the correlation.
    images : iterable of ndarray, path or SeriesImage
        The images of the deformed specimen; the function reads them one by one.
    calibration : Calibration, optional
    strain : StrainSettings, optional
    motion : Motion, optional
        Assumed motion of the specimen, used to correct the calibrated strain of each image. A rotation is not
        corrected here, because its correction needs all images together: use `corrected_rotation`.

    Raises
    ------
    MeasurementError
        If an argument has the wrong type, the motion needs a calibration that is missing, or the calibration
        belongs to images of another size.
    """
    require_calibration(motion, calibration)
    require_size(calibration, series.shape)
    if motion is not None and motion.kind == "rigid":
        motion = None
    measuring = _measuring(series, images, SeriesSetUp(_strain(strain), motion, calibration))
    # A generator would keep the last step until it has the next one.
    return map(attrgetter("image"), measuring.steps())


def _strain(strain: StrainSettings | None) -> StrainSettings:
    require_kind("strain", strain, StrainSettings | None, "give dic.StrainSettings(window_points=3)")
    return strain or StrainSettings()


def _measuring(
    series: Series,
    images: Iterable[ImageLike | SeriesImage],
    set_up: SeriesSetUp,
    reference: Grey | None = None,
) -> Measuring:
    """Return the measurement of images whose results are kept in no file."""
    require_size(set_up.calibration, series.shape)

    def correlated(camera: CameraImages, kept: Kept | None) -> Iterator[FinishedImage]:
        return correlate_series(series, images, camera.before, kept)

    grey = np.empty(series.shape, np.float32) if reference is None else reference
    return Measuring([CameraImages("", grey, set_up.calibration, correlated)], set_up)
