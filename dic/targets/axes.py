"""Which way X and Y point on a lattice: by a mark on the target, by an option, or by the image."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dic.errors import CalibrationError

Floats = NDArray[np.float64]
XAxis = str | float | None

_AMBIGUOUS_DEG = 5.0
_QUARTERS = ((1, 1), (-1, 1), (-1, -1), (1, -1))
_DIRECTIONS_DEG = {"right": 0.0, "up": 90.0, "left": 180.0, "down": 270.0}


@dataclass(frozen=True)
class Axes:
    """How a lattice's axes are named.

    Attributes
    ----------
    swap : bool
        Whether X runs along the lattice's second axis.
    flip : tuple of bool
        Whether X and Y run against the lattice axis that they follow.
    orientation : str
        What says so: ``"mark"``, ``"option"`` or ``"assumed"``.
    warnings : tuple of str
    """

    swap: bool
    flip: tuple[bool, bool]
    orientation: str
    warnings: tuple[str, ...] = ()

    @property
    def lattice_axes(self) -> tuple[int, int]:
        """The lattice's axes that X and Y follow."""
        return (1, 0) if self.swap else (0, 1)

    def named(self, index: NDArray[np.int64], spans: tuple[range, range]) -> NDArray[np.int64]:
        """Return column and row (n, 2) of lattice indices (n, 2) within the lattice's extents."""
        result = np.empty_like(index)
        for which, axis in enumerate(self.lattice_axes):
            span = spans[axis]
            offset = index[:, axis] - span[0]
            result[:, which] = len(span) - 1 - offset if self.flip[which] else offset
        return result


def axes_towards(quarter: tuple[int, int], vectors: Floats, orientation: str) -> Axes:
    """Return axes such that X + Y points along `quarter`, (±1, ±1), of lattice vectors (2, 2) in px.

    Of the two ways the one counts that is right-handed with Y up; in the image, whose y points down, the
    cross product of X and Y is then negative.
    """
    first, second = quarter[0] * vectors[0], quarter[1] * vectors[1]
    swap = bool(first[0] * second[1] - first[1] * second[0] > 0)
    flip = (quarter[0] < 0, quarter[1] < 0)
    return Axes(swap, flip[::-1] if swap else flip, orientation)


def axes_in_image(
    vectors: Floats, x_axis: XAxis, source: str, possible: Callable[[Axes], bool] | None = None
) -> Axes:
    """Return axes such that X is the lattice direction closest to what `x_axis` says.

    Parameters
    ----------
    vectors : ndarray, shape (2, 2)
        The lattice's two vectors at the middle of the target, px.
    x_axis : str or float, optional
        ``"right"``, ``"up"``, ``"left"``, ``"down"``, or an angle in degrees, anticlockwise from the image's
        right. Without it X is taken closest to the right.
    source : str
        The image's file, for messages.
    possible : callable, optional
        What the target itself, if it is not symmetric, allows; it must allow one at least.

    Raises
    ------
    CalibrationError
        If `x_axis` is no direction, or lies halfway between two directions of the lattice, within 5°.
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
        "X close to one direction of the target",
        f"x_axis {x_axis}, {off_deg[best]:.0f}° from one and {off_deg[second]:.0f}° from another",
        f"give the angle of X in the image in degrees, such as {angle_deg[best]:.0f}",
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
        f"{', '.join(_DIRECTIONS_DEG)} or an angle in degrees",
        f"x_axis {x_axis}",
        "say which way X points in the image",
    )


def _halfway(angle_deg: float) -> str:
    return (
        f"the grid is turned by about {angle_deg:.0f}° in the image, so that X and Y could be named "
        "the other way round; X was taken along the direction closest to the image's right"
    )
