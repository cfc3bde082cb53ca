"""The directions of X and Y on a target: from a mark on it, from an option, or from the image."""

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
    """The lattice axes that X and Y follow, and their directions.

    Attributes
    ----------
    swap : bool
        True if X follows the lattice's second axis.
    flip : tuple of bool
        For X and for Y: True if it points against the lattice axis that it follows.
    orientation : str
        Source of this choice: ``"mark"``, ``"option"`` or ``"assumed"``.
    warnings : tuple of str
        Sentences for the user.
    """

    swap: bool
    flip: tuple[bool, bool]
    orientation: str
    warnings: tuple[str, ...] = ()

    @property
    def lattice_axes(self) -> tuple[int, int]:
        """Numbers, 0 or 1, of the lattice axes that X and Y follow."""
        return (1, 0) if self.swap else (0, 1)

    def columns_and_rows(self, index: Indices, spans: tuple[range, range]) -> Indices:
        """Return columns and rows (n, 2), from 0, of lattice indices (n, 2) within `spans`."""
        result = np.empty_like(index)
        for which, axis in enumerate(self.lattice_axes):
            span = spans[axis]
            offset = index[:, axis] - span[0]
            result[:, which] = len(span) - 1 - offset if self.flip[which] else offset
        return result


def axes_towards(quarter: tuple[int, int], vectors: Float, orientation: str) -> Axes:
    """Return the axes whose sum X + Y points into the given quarter of the lattice.

    Two pairs of axes do so. The returned pair is right-handed with Y up: in the image, whose y points down,
    the cross product of X and Y is negative.

    Parameters
    ----------
    quarter : tuple of int
        Signs, ±1, along the two lattice vectors.
    vectors : ndarray, shape (2, 2)
        The two lattice vectors, px.
    orientation : str
        For `Axes.orientation`.
    """
    first, second = quarter[0] * vectors[0], quarter[1] * vectors[1]
    swap = bool(first[0] * second[1] - first[1] * second[0] > 0)
    flip = (quarter[0] < 0, quarter[1] < 0)
    return Axes(swap, flip[::-1] if swap else flip, orientation)


def axes_in_image(
    vectors: Float, x_axis: XAxis, source: str, possible: Callable[[Axes], bool] | None = None
) -> Axes:
    """Return the axes whose X is the lattice direction closest to `x_axis`.

    Parameters
    ----------
    vectors : ndarray, shape (2, 2)
        The two lattice vectors at the middle of the target, px.
    x_axis : str or float, optional
        ``"right"``, ``"up"``, ``"left"``, ``"down"``, or an angle in degrees, anticlockwise from the image's
        right. Default: the image's right.
    source : str
        Name of the image file, used in error messages.
    possible : callable, optional
        Tells whether an asymmetric target allows the given axes; it must allow at least one choice.

    Raises
    ------
    CalibrationError
        If `x_axis` is not a direction, or is within 5° of the middle between two lattice directions.
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
