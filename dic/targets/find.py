"""The function `find_target`, which finds a calibration target of any kind in an image."""

from dataclasses import replace

import numpy as np

from dic.errors import CalibrationError
from dic.image.given import grey_image, name_of
from dic.targets.axes import XAxis
from dic.targets.kinds import LineGridTarget, Target, require_target
from dic.targets.kinds.target import Hints, SeenTarget
from dic.targets.not_seen import TargetNotSeen
from dic.targets.points import GridPoints
from dic.targets.region import Region, cropped
from dic.targets.seen import target_seen
from dic.typing import ImageLike


def find_target(
    image: ImageLike,
    spec: Target | None = None,
    source: str = "",
    *,
    x_axis: XAxis = None,
    origin_px: tuple[float, float] | None = None,
    region_px: Region | None = None,
) -> GridPoints:
    """Find the points of a calibration target.

    Parameters
    ----------
    image : ndarray, shape (height, width), or path
        The image as an array of grey levels, or the path of an image file.
    spec : Target, optional
        Kind and size of the target. Default: the line grid of Helm and Deaner's paper, with 21 × 21 lines.
    source : str
        Name of the image, used in error messages. Default: the path of the image.
    x_axis : str or float, optional
        Direction of the target's X axis in the image, as for `dic.targets.line_grid.find.find_grid`. If
        markers or colours of the target determine the axes, this argument is ignored.
    origin_px : tuple of float, optional
        Approximate position of the middle intersection of a line grid in the image. Give this position if an
        outer line is hidden and the grid has no mark.
    region_px : tuple of float, optional
        Left, top, width and height of the part of the image to be searched. Give it if the image shows two
        targets. Default: the whole image.

    Returns
    -------
    GridPoints
        The points of the target. The attribute `orientation` of the result is ``"assumed"`` if neither the
        target nor `x_axis` determines the axes.

    Raises
    ------
    CalibrationError
        If too few points of the target are found. The smallest accepted share is 90 % of the points of a line
        grid or a dot target, and 50 % of the corners of a ChArUco board. For a plate with three hollow dots
        it is 50 % of the dots in the image. All corners of a checkerboard must be in view. If the image shows
        another target, the message names this target.
    """
    spec = LineGridTarget() if spec is None else spec
    source = source or name_of(image, "target image")
    require_target(spec, source, "give dic.targets.LineGridTarget((21, 21), pitch_mm=0.5)")
    grey = grey_image(image, source)
    if region_px is not None:
        part, (left, top) = cropped(grey, region_px, source)
        if origin_px is not None:
            origin_px = (origin_px[0] - left, origin_px[1] - top)
        found = find_target(part, spec, source, x_axis=x_axis, origin_px=origin_px)
        return replace(found, uv_px=found.uv_px + np.array([left, top]))
    if origin_px is not None and not spec.takes_origin:
        raise CalibrationError(
            source,
            "find target",
            "--origin-px only with a line grid",
            f"--origin-px with {type(spec).__name__}",
            "leave out --origin-px",
        )
    try:
        return spec.find(grey, source, Hints(x_axis, origin_px))
    except TargetNotSeen as refusal:
        raise _naming_what_is_seen(refusal, target_seen(grey), spec) from None


def _naming_what_is_seen(refusal: TargetNotSeen, seen: SeenTarget | None, spec: Target) -> CalibrationError:
    """Return the error of a finder; if the image shows another target, the error names this target."""
    got, remedy = refusal.got, refusal.remedy
    if seen is not None and not spec.is_shown_as(seen):
        got = f"{got}, but {seen}"
        remedy = f"for that target give {seen.options}, otherwise {remedy}"
    return CalibrationError(refusal.source, refusal.step, refusal.expected, got, remedy)
