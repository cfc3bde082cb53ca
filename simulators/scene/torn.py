"""A texture that is torn along a line: a crack through the specimen, or through its paint."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simulators.scene.texture import Texture

Array = NDArray[np.float64]

IN_THE_GAP = 0.02
"""Reflectance of an open crack, which is darker than the darkest dot."""


@dataclass(frozen=True)
class Torn:
    """A texture with a crack along the line Y = `y_mm`, from which both sides have moved by half the opening.

    Attributes
    ----------
    whole : Texture
        The texture before it was torn.
    y_mm, opening_mm : float
    """

    whole: Texture
    y_mm: float
    opening_mm: float

    @property
    def quadrature_order(self) -> int:
        """See `Texture`: the crack's edges are sharp, but the crack is no object of measurement."""
        return self.whole.quadrature_order

    def reflectance(self, points_mm: Array) -> Array:
        """Return the reflectance (n,) at points (n, 2) in mm."""
        side = self.sides(points_mm)
        return np.where(side == 0, IN_THE_GAP, self.whole.reflectance(self.closed(points_mm, side)))

    def sides(self, points_mm: Array) -> NDArray[np.int_]:
        """Return 1 for points above the crack, -1 for points below it, and 0 for points in the gap."""
        off_mm = points_mm[:, 1] - self.y_mm
        return np.where(np.abs(off_mm) < self.opening_mm / 2, 0, np.where(off_mm > 0.0, 1, -1))

    def closed(self, points_mm: Array, sides: NDArray[np.int_]) -> Array:
        """Return where points (n, 2) in mm were before the texture was torn. `sides` is that of `sides`."""
        return points_mm - np.column_stack([np.zeros(len(points_mm)), sides * (self.opening_mm / 2)])
