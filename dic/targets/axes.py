"""The directions of the X and Y axes on a calibration target.

The directions of X and Y come from a mark on the target, from an option of the user, or from the directions
in the image.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from dic.errors import CalibrationError
from dic.typing import Float, Indices

XAxis = str | float | None

_AMBIGUOUS_DEG = 5.0
_QUARTERS = ((1, 1), (-1, 1), (-1, -1), (1, -1))
_DIRECTIONS_DEG = {"right": 0.0, "up": 90.0, "left": 180.0, "down": 270.0}


@dataclass(frozen=True)
class Axes:
    """The directions of a target's X and Y axes, relative to the two axes of the detected lattice."""

    swap: bool
    """True if X is parallel to the second axis of the lattice, False if X is parallel to the first."""
    flip: tuple[bool, bool]
    """One value for X and one for Y: True if the axis is opposite to the lattice axis to which it is
    parallel.
    """
    orientation: str
    """Source of the directions: ``"mark"``, ``"option"`` or ``"assumed"``."""
    warnings: tuple[str, ...] = ()
    """Warnings for the user, one sentence each."""

    @property
    def lattice_axes(self) -> tuple[int, int]:
        """Numbers, 0 or 1, of the lattice axes to which X and Y are parallel."""
        return (1, 0) if self.swap else (0, 1)

    def columns_and_rows(self, index: Indices, spans: tuple[range, range]) -> Indices:
        """Convert lattice indices (n, 2) to columns and rows of the target (n, 2), counted from 0.

        `spans` are the ranges of the lattice indices of the target.
        """
        result = np.empty_like(index)
        for which, axis in enumerate(self.lattice_axes):
            span = spans[axis]
            offset = index[:, axis] - span[0]
            result[:, which] = len(span) - 1 - offset if self.flip[which] else offset
        return result


def axes_towards(quarter: tuple[int, int], vectors: Float, orientation: str) -> Axes:
    """Return the axes X and Y whose sum X + Y points into the given quarter of the lattice.

    Two pairs of axes fulfil this condition. The function returns the right-handed pair: in the image, whose
    y axis points down, the cross product of X and Y is negative.

    `quarter`: the quarter as two signs, ±1, along the two lattice vectors. `vectors`, shape (2, 2): the two
    lattice vectors in the image, px. A lattice vector leads from one point to its neighbour. `orientation`:
    value of `Axes.orientation` in the result.
    """
    first, second = quarter[0] * vectors[0], quarter[1] * vectors[1]
    swap = bool(first[0] * second[1] - first[1] * second[0] > 0)
    flip = (quarter[0] < 0, quarter[1] < 0)
    return Axes(swap, flip[::-1] if swap else flip, orientation)


def axes_in_image(
    vectors: Float, x_axis: XAxis, source: str, possible: Callable[[Axes], bool] | None = None
) -> Axes:
    """Return the axes X and Y, where X is the direction of the lattice closest to `x_axis`.

    `vectors`, shape (2, 2): the two lattice vectors in the image at the middle of the target, px. `x_axis`:
    wanted direction of X in the image: ``"right"``, ``"up"``, ``"left"``, ``"down"``, or an angle in degrees,
    anticlockwise from the right. Default: ``"right"``. `source`: name of the image file, used in error
    messages. `possible`: function that returns True if the target allows the given axes. For an asymmetric
    target the function returns True for some axes only, but at least for one pair. Default: all axes are
    allowed.

    Raises `CalibrationError` if `x_axis` is not one of these words or a number, or is within 5° of the middle
    between two lattice directions.
    """
    wanted_deg = _direction_deg(x_axis, source)
    orientation = "assumed" if x_axis is None else "option"
    every = [axes_towards(quarter, vectors, orientation) for quarter in _QUARTERS]
    allowed = [axes for axes in every if possible is None or possible(axes)]
    x_px = np.array([(-1 if axes.flip[0] else 1) * vectors[axes.lattice_axes[0]] for axes in allowed])
    angle_deg = np.degrees(np.arctan2(-x_px[:, 1], x_px[:, 0]))
    off_deg = np.abs((angle_deg - wanted_deg + 180.0) % 360.0 - 180.0)
    order = np.argsort(off_deg)
    best = int(order[0])
    if len(order) == 1:
        return replace(allowed[best], orientation="mark")
    second = int(order[1])
    if off_deg[second] - off_deg[best] >= 2 * _AMBIGUOUS_DEG:
        return allowed[best]
    if x_axis is None:
        return replace(allowed[best], warnings=(_halfway(off_deg[best]),))
    raise CalibrationError(
        source,
        "name the axes",
        "an X axis close to one direction of the target",
        f"{x_axis}, {off_deg[best]:.0f}° from one and {off_deg[second]:.0f}° from another",
        f"give the angle of X in the image in degrees, such as --x-axis {angle_deg[best]:.0f}",
    )


def _direction_deg(x_axis: XAxis, source: str) -> float:
    if x_axis is None:
        return 0.0
    if isinstance(x_axis, str):
        if x_axis in _DIRECTIONS_DEG:
            return _DIRECTIONS_DEG[x_axis]
    elif np.isfinite(x_axis):
        return float(x_axis)
    raise CalibrationError(
        source,
        "name the axes",
        f"an X axis of {', '.join(_DIRECTIONS_DEG)} or an angle in degrees",
        str(x_axis),
        "give --x-axis right, or the angle of X in the image, such as --x-axis 30",
    )


def _halfway(angle_deg: float) -> str:
    return (
        f"the grid is turned by about {angle_deg:.0f}° in the image, so X and Y could also be chosen "
        "the other way round; X is the direction closest to the image's right, unless --x-axis is given"
    )
