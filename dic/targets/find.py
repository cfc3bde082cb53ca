"""Calibration targets of several kinds, found through one function: `find_target(image, spec)`."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dic.errors import CalibrationError
from dic.targets.axes import XAxis
from dic.targets.points import GridPoints


@dataclass(frozen=True)
class LineGridTarget:
    """Lines at equal distances in two directions, perhaps with a mark (`dic.targets.line_grid.mark`).

    Attributes
    ----------
    lines : tuple of int
        Number of lines along X and along Y.
    pitch_mm : float
        Distance of neighbouring lines.
    """

    lines: tuple[int, int] = (21, 21)
    pitch_mm: float = 0.5


@dataclass(frozen=True)
class CheckerboardTarget:
    """Dark and bright squares; its points are the corners at which four squares meet.

    Attributes
    ----------
    squares : tuple of int
        Number of squares along X and along Y, whole ones, those at the rim included. If one is even and the
        other odd, the board's colours fix the axes: the square at its lower left is dark.
    pitch_mm : float
        Side of a square.
    """

    squares: tuple[int, int]
    pitch_mm: float


@dataclass(frozen=True)
class CharucoTarget:
    """A checkerboard with ArUco markers in its bright squares, as OpenCV draws it, its top edge towards +Y.

    Attributes
    ----------
    squares : tuple of int
        Number of squares along X and along Y.
    pitch_mm, marker_mm : float
        Sides of a square and of a marker.
    dictionary : str
        Name of OpenCV's dictionary, such as ``"DICT_5X5_100"``.
    """

    squares: tuple[int, int]
    pitch_mm: float
    marker_mm: float
    dictionary: str = "DICT_5X5_100"


@dataclass(frozen=True)
class DotTarget:
    """Round dots at the points of a square lattice, darker than the ground or brighter.

    Attributes
    ----------
    dots : tuple of int
        Number of dots along X and along Y.
    pitch_mm : float
        Distance of neighbouring dots' centres.
    """

    dots: tuple[int, int]
    pitch_mm: float


Target = LineGridTarget | CheckerboardTarget | CharucoTarget | DotTarget


def find_target(
    image: NDArray[np.float32],
    spec: Target,
    source: str = "target image",
    *,
    x_axis: XAxis = None,
    origin_px: tuple[float, float] | None = None,
) -> GridPoints:
    """Find the points of a calibration target.

    Parameters
    ----------
    image : ndarray, shape (height, width)
        Grey levels.
    spec : Target
        What the image shows.
    source : str
        The image's file, for messages.
    x_axis : str or float, optional
        Which way X points in the image, as for `dic.targets.line_grid.find.find_grid`. A ChArUco board says
        so itself.
    origin_px : tuple of float, optional
        About where a line grid's middle intersection is in the image, if an outer line is hidden.

    Returns
    -------
    GridPoints
        Where a target does not fix its axes and `x_axis` is not given, `orientation` is ``"assumed"``.

    Raises
    ------
    CalibrationError
        If the image does not show the target, or too little of it: 90 % of the points of lines and dots, all
        corners of a checkerboard, half of those of a ChArUco board.
    """
    grey = np.asarray(image, np.float32)
    _require_possible(spec, source)
    if origin_px is not None and not isinstance(spec, LineGridTarget):
        raise CalibrationError(
            source,
            "find target",
            "the place of the middle for a line grid only",
            "another target",
            "leave out --origin-px",
        )
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
    from dic.targets.dots import find_dots

    return find_dots(grey, spec.dots, spec.pitch_mm, source, x_axis)


def _require_possible(spec: Target, source: str) -> None:
    """Refuse targets that cannot be; what a line grid may be `find_grid` says itself."""
    if isinstance(spec, LineGridTarget):
        return
    count = spec.dots if isinstance(spec, DotTarget) else spec.squares
    marker_fits = not isinstance(spec, CharucoTarget) or 0 < spec.marker_mm < spec.pitch_mm
    if min(count) < 5 or not 0 < spec.pitch_mm < float("inf") or not marker_fits:
        raise CalibrationError(
            source,
            "find target",
            "at least 5 squares or dots each way, a positive pitch, and markers smaller than it",
            str(spec),
            "correct the target's description",
        )
