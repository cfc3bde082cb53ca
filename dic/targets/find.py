"""The kinds of calibration targets, and the function `find_target` that finds any of them in an image."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from dic.errors import CalibrationError, Check, is_number, is_whole, require_all, require_kind
from dic.image.given import grey_image, name_of
from dic.keywords import named_settings
from dic.targets.axes import XAxis
from dic.targets.not_seen import TargetNotSeen
from dic.targets.points import GridPoints
from dic.targets.region import Region, cropped
from dic.typing import Grey, ImageLike

if TYPE_CHECKING:
    from dic.targets.seen import SeenTarget

_FEWEST, _FEWEST_WITH_MARKERS = 5, 3
# Smallest numbers for an asymmetric grid: dots in a row, rows, and all dots.
_FEWEST_SHIFTED = (3, 4, 16)
_PITCHES_MM = (1e-6, 1e6)
"""Smallest and largest possible pitch. The square of a length outside this range could overflow."""


@named_settings
@dataclass(frozen=True)
class LineGridTarget:
    """A grid of equidistant lines in two directions, with or without a mark of its origin and axes.

    The module `dic.targets.line_grid.mark` describes the mark.

    Attributes
    ----------
    lines : tuple of int
        Number of lines along X and along Y.
    pitch_mm : float
        Distance between neighbouring lines.
    """

    lines: tuple[int, int] = (21, 21)
    pitch_mm: float = 0.5


@named_settings
@dataclass(frozen=True)
class CheckerboardTarget:
    """A checkerboard of dark and bright squares. The points are the corners at which four squares meet.

    Attributes
    ----------
    squares : tuple of int
        Number of whole squares along X and along Y, including the squares at the rim. If one number is even
        and the other is odd, the colours determine the axes: the lower left square is dark.
    pitch_mm : float
        Length of the side of a square.
    """

    squares: tuple[int, int]
    pitch_mm: float


@named_settings
@dataclass(frozen=True)
class CharucoTarget:
    """A checkerboard with ArUco markers in its bright squares, as OpenCV draws it.

    The Y axis points to the top edge of the board as drawn.

    Attributes
    ----------
    squares : tuple of int
        Number of squares along X and along Y.
    pitch_mm, marker_mm : float
        Lengths of the side of a square and of the side of a marker.
    dictionary : str
        Name of OpenCV's dictionary of markers, such as ``"DICT_5X5_100"``.
    """

    squares: tuple[int, int]
    pitch_mm: float
    marker_mm: float
    dictionary: str = "DICT_5X5_100"


@named_settings
@dataclass(frozen=True)
class DotTarget:
    """Round dots on a square lattice, darker or brighter than the background.

    If three of the dots are hollow (rings), they mark the origin, a place on the X axis and a place on the Y
    axis. The origin mark is then the origin of X and Y, and the lattice may be larger than the picture.

    Attributes
    ----------
    dots : tuple of int
        Number of dots along X and along Y. For a plate larger than the picture, all dots of the plate count.
    pitch_mm : float
        Distance between the centres of neighbouring dots.
    """

    dots: tuple[int, int]
    pitch_mm: float


@named_settings
@dataclass(frozen=True)
class AsymmetricDotTarget:
    """Round dots in rows; every second row is shifted by half a pitch, as in OpenCV's asymmetric grid of
    circles.

    Four dots in each of four rows, ``dots=(4, 4)``::

        ●   ●   ●   ●          ┐ half a pitch
          ●   ●   ●   ●        ┘
        ●   ●   ●   ●
          ●   ●   ●   ●
        └───┘
        one pitch

    The X axis points along the rows. If the number of rows is odd, the dots determine the direction of X: the
    top row and the bottom row begin at the left. If the number of rows is even, the grid looks the same after
    half a turn.

    Attributes
    ----------
    dots : tuple of int
        Number of dots in each row, and number of rows. OpenCV counts them in the same way and order.
    pitch_mm : float
        Distance between the centres of neighbouring dots of a row. Neighbouring rows are half a pitch apart.
        OpenCV's examples call half a pitch the size of a square.
    """

    dots: tuple[int, int]
    pitch_mm: float


Target = LineGridTarget | CheckerboardTarget | CharucoTarget | DotTarget | AsymmetricDotTarget


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
    require_kind("target", spec, Target, "give dic.LineGridTarget((21, 21), pitch_mm=0.5)")
    source = source or name_of(image, "target image")
    require_possible(spec, source)
    grey = grey_image(image, source)
    if region_px is not None:
        part, (left, top) = cropped(grey, region_px, source)
        if origin_px is not None:
            origin_px = (origin_px[0] - left, origin_px[1] - top)
        found = find_target(part, spec, source, x_axis=x_axis, origin_px=origin_px)
        return replace(found, uv_px=found.uv_px + np.array([left, top]))
    if origin_px is not None and not isinstance(spec, LineGridTarget):
        raise CalibrationError(
            source,
            "find target",
            "--origin-px only with a line grid",
            f"--origin-px with {type(spec).__name__}",
            "leave out --origin-px",
        )
    try:
        return _found_by_kind(grey, spec, source, x_axis, origin_px)
    except TargetNotSeen as refusal:
        from dic.targets.seen import target_seen

        raise _naming_what_is_seen(refusal, target_seen(grey), spec) from None


def _found_by_kind(
    grey: Grey, spec: Target, source: str, x_axis: XAxis, origin_px: tuple[float, float] | None
) -> GridPoints:
    if isinstance(spec, LineGridTarget):
        from dic.targets.line_grid.find import find_grid

        return find_grid(grey, spec.lines, spec.pitch_mm, source, x_axis=x_axis, origin_px=origin_px)
    if isinstance(spec, CheckerboardTarget):
        from dic.targets.checkerboard import find_checkerboard

        return find_checkerboard(grey, spec.squares, spec.pitch_mm, source, x_axis)
    if isinstance(spec, CharucoTarget):
        from dic.targets.charuco import find_charuco

        side = spec.marker_mm / spec.pitch_mm
        return find_charuco(grey, spec.squares, spec.pitch_mm, side, spec.dictionary, source)
    if isinstance(spec, AsymmetricDotTarget):
        from dic.targets.asymmetric_dots import find_asymmetric_dots

        return find_asymmetric_dots(grey, spec.dots, spec.pitch_mm, source, x_axis)
    from dic.targets.dots import find_dots

    return find_dots(grey, spec.dots, spec.pitch_mm, source, x_axis)


def _naming_what_is_seen(refusal: TargetNotSeen, seen: "SeenTarget | None", spec: Target) -> CalibrationError:
    """Return the error of a finder; if the image shows another target, the error names this target."""
    got, remedy = refusal.got, refusal.remedy
    if seen is not None and not _describes(spec, seen):
        got = f"{got}, but {seen}"
        remedy = f"for that target give {seen.options}, otherwise {remedy}"
    return CalibrationError(refusal.source, refusal.step, refusal.expected, got, remedy)


def _describes(spec: Target, seen: "SeenTarget") -> bool:
    """Return True if the target that was seen is of the given kind and size."""
    if isinstance(spec, CharucoTarget):
        family = seen.dictionary.rpartition("_")[0]
        return bool(family) and spec.dictionary.startswith(family) and seen.counts == tuple(spec.squares)
    if isinstance(spec, AsymmetricDotTarget):
        return seen.option == "asymmetric-dots" and seen.counts == tuple(spec.dots)
    if isinstance(spec, CheckerboardTarget):
        option, counts = "squares", spec.squares
    elif isinstance(spec, DotTarget):
        option, counts = "dots", spec.dots
    else:
        option, counts = "lines", spec.lines
    return seen.option == option and not seen.dictionary and sorted(seen.counts) == sorted(counts)


def _require_numbers(spec: Target, source: str) -> None:
    """Raise an error if a length or a count of a target is no number, such as lines=21 for lines=(21, 21)."""
    checks: list[Check] = []
    for name, value in vars(spec).items():
        if name.endswith("_mm"):
            checks.append((is_number(value), name, "a number", repr(value), f"give {name}=0.5"))
        elif name != "dictionary":
            pair = isinstance(value, tuple | list) and len(value) == 2 and all(map(is_whole, value))
            checks.append((pair, name, "two whole numbers, (X, Y)", repr(value), f"give {name}=(21, 21)"))
    require_all(CalibrationError, source, checks)


def require_possible(spec: Target, source: str) -> None:
    """Raise an error if the description of a target is not possible; the message names all mistakes.

    The number of lines of a line grid is checked in the function `find_grid`.
    """
    least_mm, most_mm = _PITCHES_MM
    _require_numbers(spec, source)
    pitch_possible = least_mm <= spec.pitch_mm <= most_mm
    checks: list[Check] = [
        (
            pitch_possible,
            "pitch",
            f"{least_mm:g} to {most_mm:g} mm",
            f"{spec.pitch_mm:g} mm",
            "give --pitch-mm 0.5",
        ),
    ]
    if isinstance(spec, AsymmetricDotTarget):
        checks.append(_enough_shifted_dots(spec.dots))
    elif not isinstance(spec, LineGridTarget):
        name, count = ("dots", spec.dots) if isinstance(spec, DotTarget) else ("squares", spec.squares)
        shifted = isinstance(spec, DotTarget) and _enough_shifted_dots(spec.dots)[0]
        otherwise = f", or --asymmetric-dots {count[0]}x{count[1]} if its rows are shifted" if shifted else ""
        fewest = _FEWEST_WITH_MARKERS if isinstance(spec, CharucoTarget) else _FEWEST
        possible = f"{max(count[0], fewest)}x{max(count[1], fewest)}"
        checks.append(
            (
                min(count) >= fewest,
                f"number of {name}",
                f"at least {fewest} along X and along Y",
                f"{count[0]} × {count[1]}",
                f"give --{name} {possible}{otherwise}",
            )
        )
    if isinstance(spec, CharucoTarget):
        from dic.targets.charuco import is_dictionary, nearest_dictionary

        checks += [
            (
                not pitch_possible or 0 < spec.marker_mm < spec.pitch_mm,
                "side of a marker",
                f"between 0 and the pitch, {spec.pitch_mm:g} mm",
                f"{spec.marker_mm:g} mm",
                f"give --marker-mm {0.7 * spec.pitch_mm:g}",
            ),
            (
                is_dictionary(spec.dictionary),
                "dictionary",
                "a dictionary of OpenCV",
                spec.dictionary,
                f"give --dictionary {nearest_dictionary(spec.dictionary)}",
            ),
        ]
    require_all(CalibrationError, source, checks)


def _enough_shifted_dots(dots: tuple[int, int]) -> Check:
    in_row, rows, every = _FEWEST_SHIFTED
    return (
        dots[0] >= in_row and dots[1] >= rows and dots[0] * dots[1] >= every,
        "number of dots",
        f"at least {in_row} in each row, {rows} rows and {every} dots",
        f"{dots[0]} × {dots[1]}",
        "give --asymmetric-dots 4x11",
    )
