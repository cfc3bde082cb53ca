"""The measurement of a series of images, given as files, arrays or steps of a run."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from dic.calibration.calibration import Calibration
from dic.calibration.file import load_calibration
from dic.correlation.series import Series
from dic.correlation.settings import CorrelationSettings
from dic.errors import CalibrationError, MeasurementError, require_kind
from dic.image.given import grey_image, name_of, one_by_one
from dic.out_of_plane.correct import Motion
from dic.out_of_plane.diagnosis import Sensitivity
from dic.pipeline.series_corrections import corrected, corrected_rotation, require_calibration
from dic.pipeline.series_result import MeasuredImage, MeasuredSeries
from dic.strain.measurement import measure
from dic.strain.strain import StrainSettings
from dic.typing import Float, ImageLike, Mask, PathLike


@dataclass(frozen=True)
class SeriesImage:
    """An image of a series, with its name and its expected motion.

    Attributes
    ----------
    image : ndarray, shape (height, width), or path
    label : str
        Name of the image in results.
    hint : ndarray, shape (3, 3), optional
        Expected homography from the reference to this image, for example from `rigid_motion`.
    """

    image: ImageLike
    label: str
    hint: Float | None = None


def measure_images(
    reference: ImageLike,
    images: ImageLike | SeriesImage | Iterable[ImageLike | SeriesImage],
    *,
    calibration: Calibration | PathLike | None = None,
    settings: CorrelationSettings | None = None,
    strain: StrainSettings | None = None,
    region: Mask | PathLike | None = None,
    incremental: str = "auto",
    motion: Motion | str = "free",
) -> MeasuredSeries:
    """Measure displacement and strain of images against their reference.

    An image that cannot be measured is named among the failures; the others are measured. For series that do
    not fit into memory see `measure_series`.

    Parameters
    ----------
    reference : ndarray, shape (height, width), or path
    images : iterable of ndarray, path or SeriesImage
        The images in order; a single image is a series of one.
    calibration : Calibration or path, optional
        Calibration of the camera, for results in millimetres. Without a calibration all results are in
        pixels.
    settings : CorrelationSettings, optional
        Default: affine shape functions, quadratic ones for a rotation.
    strain : StrainSettings, optional
    region : ndarray of bool, shape (height, width), or path, optional
        Region to measure. Default: all parts of the reference with texture.
    incremental : str
        When to take a new reference: "auto" when the correlation drops, "never", or "always".
    motion : Motion or str
        Assumed motion of the specimen, used to correct calibrated strain: "free" (no correction), "rigid" or
        "tension".

    Raises
    ------
    MeasurementError
        If reference, calibration, region or settings cannot be used.
    """
    motion = Motion(motion) if isinstance(motion, str) else motion
    if isinstance(calibration, str | Path):
        calibration = load_calibration(calibration)
    require_calibration(motion, calibration)
    # The deformation of a rotating subset is not affine in an oblique view.
    settings = settings or CorrelationSettings(shape="quadratic" if motion.kind == "rigid" else "affine")
    grey = grey_image(reference, "reference image")
    several = [images] if isinstance(images, SeriesImage) else one_by_one(images)
    series = Series(grey, region, settings, incremental=incremental)
    measured = list(measure_series(series, several, calibration, strain, motion))
    if calibration is None:
        return MeasuredSeries(grey, tuple(measured))
    alignment = motion.alignment
    if motion.kind == "rigid":
        measured, alignment = corrected_rotation(measured, calibration, motion)
    return MeasuredSeries(grey, tuple(measured), alignment, Sensitivity.of(calibration))


def measure_series(
    series: Series,
    images: Iterable[ImageLike | SeriesImage],
    calibration: Calibration | None = None,
    strain: StrainSettings | None = None,
    motion: Motion | None = None,
) -> Iterator[MeasuredImage]:
    """Measure the images of a series lazily, one by one.

    When the caller requests the next image, the previous image is released, except for the data that `Series`
    needs. The series ends when the caller stops iterating.

    Parameters
    ----------
    series : Series
        The reference and the settings of the correlation.
    images : iterable of ndarray, path or SeriesImage
        The images; they are also read one by one.
    calibration : Calibration, optional
    strain : StrainSettings, optional
    motion : Motion, optional
        Assumed motion; calibrated strain is corrected for this motion, image by image. The correction of a
        rotation needs all images together: see `corrected_rotation`.

    Raises
    ------
    MeasurementError
        If the arguments do not go together.
    """
    require_kind("strain", strain, StrainSettings | None, "give dic.StrainSettings(window_points=5)")
    require_calibration(motion, calibration)
    if calibration is not None and calibration.image_shape != series.shape:
        (height, width), (own_height, own_width) = calibration.image_shape, series.shape
        raise CalibrationError(
            "reference image",
            "apply calibration",
            f"{width} × {height} px like the grid image",
            f"{own_width} × {own_height} px",
            "calibrate with an image of the same camera and format",
        )
    return (
        corrected(_measured(series, image, number, calibration, strain), calibration, motion)
        for number, image in enumerate(images, 1)
    )


def _measured(
    series: Series,
    image: ImageLike | SeriesImage,
    number: int,
    calibration: Calibration | None,
    strain: StrainSettings | None,
) -> MeasuredImage:
    if not isinstance(image, SeriesImage):
        image = SeriesImage(image, name_of(image, f"image {number}"))
    try:
        field = series.correlate(image.image, hint=image.hint)
    except MeasurementError as error:
        return MeasuredImage(image.label, failure=str(error))
    return MeasuredImage(image.label, measure(field, calibration, strain, label=image.label))
