"""The possible causes of a displacement field in tension, each as the field that one camera measures.

Each cause has one or several fields. A field is the displacement in the specimen's plane that one unit of the
cause gives, to first order. Let C be the camera's centre, and let m be the point at which a ray meets the
grid's plane. If the surface has the height h, the ray meets it at another point, which is displaced by -h (m
- C)/Cz. So the fields of all causes out of the plane have this form.

The causes in the plane are affine motion, bending and a gradient of the strain. Bending along one axis with
the curvature κ has the displacement (-(y² + ν x²)/2, x y) κ. For bending along the other axis, x and y are
exchanged. The gradient of the strain has one given direction. Let s be the coordinate along this direction, t
the coordinate across it, e the strain along it, and g the relative gradient. The gradient then gives the
displacement (s²/2, -ν s t) e g. If the specimen is tapered, it is also sheared, and the shear adds a multiple
of the displacement (t², 0).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import accumulate
from types import MappingProxyType

import numpy as np

from dic.out_of_plane.nodes import Nodes
from dic.out_of_plane.plane import Plane
from dic.out_of_plane.uncertainty import of_both_components, weighted_sums
from dic.typing import Float

_PLASTIC = 0.01
"""Above this strain, the measured lateral contraction is used instead of Poisson's ratio."""

SIZES = {
    "affine": 6,
    "bending": 2,
    "tilt": 2,
    "mounted tilt": 2,
    "gap": 1,
    "shift": 1,
    "curvature": 3,
    "gradient": 1,
    "taper": 1,
}
"""The causes in the order of their fields, and the number of fields of each cause."""

OUT_OF_PLANE = ("tilt", "mounted tilt", "gap", "shift", "curvature")
"""The causes out of the plane, which give false strain."""


@cache
def places() -> Mapping[str, slice]:
    """Return for each cause the slice of its fields among all fields."""
    ends = accumulate(SIZES.values())
    found = {name: slice(end - n, end) for (name, n), end in zip(SIZES.items(), ends, strict=True)}
    return MappingProxyType(found)


@dataclass(frozen=True)
class CameraSight:
    """The positions of a specimen's points as one camera measures them, for p weighted sums over the points.

    The nodes stand for all points, with the weights of p sums of displacements; each has the shape (k, 2, p).
    """

    before: Nodes
    after: Nodes
    """Nodes over the calibrated positions in the reference and in the deformed image, mm."""
    middle_mm: Float
    """Shape (2,). Mean position of the points in the reference."""
    centre_mm: Float
    """Shape (3,). The camera's centre in the grid's axes."""

    @classmethod
    def of(cls, before_mm: Float, after_mm: Float, centre_mm: Float, weights: Float) -> "CameraSight":
        """Return the sight of points with calibrated positions (n, 2), and weights (n, 2, p) or others.

        `weights` of the shape (n, r) are those of each component, as for `of_both_components`.
        """
        before, after = (
            replace(nodes, weights=of_both_components(nodes.weights))
            for nodes in (Nodes.of(position, weights) for position in (before_mm, after_mm))
        )
        return cls(before, after, before_mm.mean(axis=0), centre_mm)

    def moved(self, plane: Plane) -> Float:
        """Return the sums (p,) of the displacements if the deformed specimen lies on `plane`."""
        return weighted_sums(self.after.weights, plane.within(self.after.at, self.centre_mm)) - self._start

    @cached_property
    def _start(self) -> Float:
        return weighted_sums(self.before.weights, self.before.at)

    @cached_property
    def before_by_plane(self) -> Float:
        """Derivatives (k, 2, 3) of the reference positions by slopes and shift of the grid's plane."""
        return Plane().derivatives(self.before.at, self.centre_mm)


def fields(
    sight: CameraSight, plane: Plane, gradient: Float, poisson_ratio: float, along: Float, per_slope_mm: Float
) -> Float:
    """Return the weighted sums of the fields of all causes, shape (p, 19), in the order of `SIZES`.

    Parameters
    ----------
    plane : Plane
        Plane of the deformed specimen. The causes out of the plane are linearised about this plane.
    gradient : ndarray, shape (2, 2)
        Mean displacement gradient.
    poisson_ratio : float
        Poisson's ratio of the specimen.
    along : ndarray, shape (2,)
        Direction of the gradient of the strain, a unit vector.
    per_slope_mm : ndarray, shape (2,)
        Shift towards the camera that a unit of each slope of the tilt causes at the grid's centre.

    Returns
    -------
    ndarray
        The units of the fields are: affine motion mm and 1, bending and curvature 1/mm, tilts 1 (slope), gap
        and shift mm, gradient and taper 1/mm (strain per mm).
    """
    F, after = gradient + np.eye(2), sight.after
    by_after = plane.derivatives(after.at, sight.centre_mm)
    tilt = by_after[:, :, :2] + by_after[:, :, 2:] * per_slope_mm
    on_plane = plane.within(after.at, sight.centre_mm)
    bent = _bent(on_plane - after.share @ on_plane)[:, None, :] * _ray(after.at, sight.centre_mm)[:, :, None]
    of_after = np.concatenate([-tilt, -by_after, -by_after[:, :, 2:], bent], axis=2)
    within = _within(sight.before.at - sight.middle_mm, gradient, poisson_ratio, along)
    of_before = np.concatenate([within, F @ sight.before_by_plane], axis=2)
    # A field is a function of the positions before, of those after the deformation, or a sum of both.
    out = weighted_sums(after.weights, of_after)
    in_plane, mounted = np.split(weighted_sums(sight.before.weights, of_before), [10], axis=1)
    # A tilt or a gap that existed in the reference and did not change displaces the reference positions too.
    # The specimen's strain and rotation then act on this displacement.
    out[:, 2:5] += mounted
    return np.hstack([in_plane[:, :8], out, in_plane[:, 8:]])


def curved(after_mm: Float, centre_mm: Float, plane: Plane, curvatures: Float) -> Float:
    """Return the displacement field (n, 2) that three curvatures (along X, mixed, along Y; 1/mm) cause."""
    on_plane = plane.within(after_mm, centre_mm)
    height = _bent(on_plane - on_plane.mean(axis=0)) @ curvatures
    return np.asarray(height[:, None] * _ray(after_mm, centre_mm))


def _bent(centred_mm: Float) -> Float:
    """Return the heights (n, 3) of surfaces with a curvature of 1/mm along X, mixed, and along Y."""
    X, Y = centred_mm.T
    return np.stack([X * X / 2, X * Y, Y * Y / 2], axis=-1)


def _ray(after_mm: Float, centre_mm: Float) -> Float:
    """Return the shift (n, 2) of calibrated positions by a height of 1 mm, away from the camera's foot."""
    return np.asarray((after_mm - centre_mm[:2]) / centre_mm[2])


def main_direction(gradient: Float) -> Float:
    """Return the direction (2,) of the largest absolute principal strain, for a gradient (2, 2)."""
    strains, directions = np.linalg.eigh(_strain(gradient))
    return np.asarray(directions[:, int(np.argmax(np.abs(strains)))])


def strain_along(gradient: Float, along: Float) -> tuple[float, float]:
    """Return the strains along and across a direction (2,), for a displacement gradient (2, 2)."""
    strain, across = _strain(gradient), np.array([-along[1], along[0]])
    return float(along @ strain @ along), float(across @ strain @ across)


def _strain(gradient: Float) -> Float:
    F = gradient + np.eye(2)
    return np.asarray((F.T @ F - np.eye(2)) / 2)


def _within(centred_mm: Float, gradient: Float, poisson_ratio: float, along: Float) -> Float:
    """Return the fields of motion in the plane, shape (n, 2, 10): affine, bending, gradient and taper."""
    x, y = centred_mm.T
    one, none, nu = np.ones_like(x), np.zeros_like(x), poisson_ratio
    affine = [(t, none) for t in (one, x, y)] + [(none, t) for t in (one, x, y)]
    bending = [(-(y * y + nu * x * x) / 2, x * y), (x * y, -(x * x + nu * y * y) / 2)]
    strain, lateral = strain_along(gradient, along)
    contraction = -lateral / strain if abs(strain) > _PLASTIC else nu
    across = np.array([-along[1], along[0]])
    s, t = centred_mm @ along, centred_mm @ across
    graded = np.outer(along, s * s / 2) - contraction * np.outer(across, s * t)
    taper = np.outer(along, t * t)
    return np.stack([np.array(field).T for field in (*affine, *bending, graded, taper)], axis=2)
