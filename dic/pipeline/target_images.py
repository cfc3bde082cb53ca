"""The calibration of a camera from images of a calibration target."""

from collections.abc import Iterable, Sequence
from typing import Literal

from dic.calibration.calibration import Calibration, Model
from dic.calibration.grid_making import GridAccuracy
from dic.calibration.pinhole.prior import KnownCamera
from dic.calibration.plate import behind
from dic.calibration.turned import in_axes_of_first
from dic.errors import CalibrationError
from dic.image.given import grey_image, name_of, one_by_one
from dic.targets.axes import XAxis
from dic.targets.find import find_target
from dic.targets.kinds import Target
from dic.targets.region import Region
from dic.typing import Grey, ImageLike


def calibrate_images(
    images: ImageLike | Iterable[ImageLike],
    target: Target | None = None,
    *,
    x_axis: XAxis = None,
    origin_px: tuple[float, float] | None = None,
    known: KnownCamera | None = None,
    accuracy: GridAccuracy | None = None,
    model: Model | Literal["recommended"] = "bicubic",
    plate_mm: float = 0.0,
    region_px: Region | None = None,
) -> Calibration:
    """Find a calibration target in images and fit the calibration, the map from pixels to millimetres.

    Parameters
    ----------
    images : ndarray, shape (height, width), or path, or several of them
        Images by one camera. The target in the first image defines the plane of the measurement. More images,
        of the tilted target, improve the pinhole model.
    target : Target, optional
        Kind and size of the target. Default: the line grid of Helm and Deaner's paper, with 21 × 21 lines.
    x_axis : str or float, optional
        Direction of the target's X axis in the first image, as for `find_target`.
    origin_px : tuple of float, optional
        Approximate position, in the first image, of the middle of a line grid, as for `find_target`.
    known : KnownCamera, optional
        Known properties of the camera and the lens, for the pinhole model.
    accuracy : GridAccuracy, optional
        How accurately the target was made. Default: as a laser printer prints it.
    model : str
        The map that the calibration uses: "bicubic" (the map of Helm and Deaner), "pinhole", or
        "recommended".
    plate_mm : float
        Distance of the specimen's surface behind the target's lines, such as the thickness of the plate that
        carries the lines. The calibration then describes the surface.
    region_px : tuple of float, optional
        Left, top, width and height of the part of every image in which the target is searched, as for
        `find_target`.

    Raises
    ------
    MeasurementError
        If an image cannot be read, an image does not show the target, the images differ in size, or
        `plate_mm` is too large.
    """
    given = list(one_by_one(images))
    names = [name_of(image, f"target image {k}") for k, image in enumerate(given, 1)]
    greys = [grey_image(image, name) for image, name in zip(given, names, strict=True)]
    _require_same_size(greys, names)
    first = find_target(greys[0], target, names[0], x_axis=x_axis, origin_px=origin_px, region_px=region_px)
    others = [
        find_target(grey, target, name, region_px=region_px)
        for grey, name in zip(greys[1:], names[1:], strict=True)
    ]
    made, shape = accuracy or GridAccuracy(), greys[0].shape
    grids = in_axes_of_first([first, *others], shape, known, made)
    calibration = Calibration.fit(grids, shape, names[0], known=known, accuracy=made)
    calibration = calibration.using(calibration.recommended if model == "recommended" else model)
    return behind(calibration, plate_mm) if plate_mm else calibration


def _require_same_size(greys: Sequence[Grey], names: Sequence[str]) -> None:
    if not greys:
        raise CalibrationError("images", "calibrate", "at least one image", "none", "name an image")
    height, width = greys[0].shape
    for grey, name in zip(greys, names, strict=True):
        if grey.shape != greys[0].shape:
            raise CalibrationError(
                name,
                "calibrate",
                f"images by one camera, {width} × {height} px as the first",
                f"{grey.shape[1]} × {grey.shape[0]} px",
                "calibrate each camera by itself",
            )
