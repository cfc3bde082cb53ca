"""The motion of a rotated specimen in one step, without the noise of its points."""

from dataclasses import dataclass

import numpy as np

from dic.out_of_plane.nodes import Nodes
from dic.typing import Float


@dataclass(frozen=True)
class SmoothMotion:
    """The motion of a step without noise, at a few nodes over its points.

    The derivatives of the mean gradient with respect to slopes are those of the motion itself, up to noise
    times the change of a weight.
    """

    places: tuple[Float, Float]
    """Shapes (k, 2). Calibrated positions of the nodes before and after the motion, mm."""
    share: Float
    """Shape (k,). Weights of the nodes that give the same sums as the points."""

    @classmethod
    def of(cls, before: Float, after: Float) -> "SmoothMotion":
        """Fit a quadratic function to the positions (n, 2) after a motion, and evaluate it at the nodes."""
        nodes = Nodes.of(before, np.ones(len(before)))
        middle = before.mean(axis=0)
        terms, at = (_quadratic(position - middle) for position in (before, nodes.at))
        return cls((nodes.at, at @ np.linalg.lstsq(terms, after, rcond=None)[0]), nodes.share)

    def gradient(self, before: Float, after: Float) -> Float:
        """Return the mean gradient (2, 2) of the displacement between positions (k, 2) of the nodes."""
        centred = before - self.share @ before
        weighted = centred.T * self.share
        return np.asarray(np.linalg.solve(weighted @ centred, weighted @ (after - before)).T)


def _quadratic(position: Float) -> Float:
    x, y = position.T
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)
