"""The bow of a rotated specimen, from the displacements that it causes beside those of a plane.

A specimen that is 10 µm higher in its middle than at its edges turns with its bow. A camera 30° off-axis sees
the middle displaced by the height times the tangent of 30°, and after half a turn the other way. This bends
the lines of the displacement field by some tenths of a pixel. The mean strains show the bow hardly at all,
but it falsifies them by some ten µε if the field is not symmetric about the axis.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from dic.strain.displacement import Displacement
from dic.strain.fit import slopes_of
from dic.typing import Float

_FEWEST_STEPS = 3


@dataclass(frozen=True)
class Bow:
    """The height of a specimen over its plane: h = (c₁ x² + 2 c₂ x y + c₃ y²)/2, x and y from `about_mm`."""

    curvature_per_mm: Float
    """Shape (3,). The curvatures c₁, c₂ and c₃ in the reference, 1/mm."""
    covariance: Float
    """Shape (3, 3)."""
    about_mm: Float
    """Shape (2,)."""

    @classmethod
    def fitted(cls, motions: Iterable[tuple[Float, Float]], centre_mm: Float) -> "Bow | None":
        """Find the bow from the motions within the specimen's plane; None for fewer than three steps.

        `motions`: positions of the points of each step before and after it, shapes (n, 2). `centre_mm`, shape
        (3,): the camera's centre. The curvatures are those of all steps together. Their covariance follows
        from the differences between the steps, and counts twice because of the common reference.
        """
        normals, sides, about_mm = [], [], None
        for before, after in motions:
            about_mm = before.mean(axis=0) if about_mm is None else about_mm
            design, left = _bends(before, after, about_mm, centre_mm)
            normals.append(design.T @ design)
            sides.append(design.T @ left)
        if len(normals) < _FEWEST_STEPS or about_mm is None:
            return None
        inverse = np.linalg.pinv(np.sum(normals, axis=0))
        curvature = inverse @ np.sum(sides, axis=0)
        misfits = np.array(sides) - np.array(normals) @ curvature
        scatter = misfits.T @ misfits * len(misfits) / (len(misfits) - 1)
        return cls(curvature, 2 * inverse @ scatter @ inverse, about_mm)

    def seen_flat(self, before_mm: Float, after_mm: Float, centre_mm: Float) -> tuple[Float, Float]:
        """Return positions (…, 2) in the specimen's plane before and after a motion without the bow's effect.

        `centre_mm`, shape (3,): the camera's centre.
        """
        share = (_heights(before_mm - self.about_mm) @ self.curvature_per_mm / centre_mm[2])[..., None]
        before, after = (place - share * (place - centre_mm[:2]) for place in (before_mm, after_mm))
        return before, after

    def flattened(self, moved: Displacement, centre_mm: Float) -> Displacement:
        """Return a displacement within the specimen's plane without the effect of the bow."""
        before, after = moved.position, moved.position + moved.vector
        flat_before, flat_after = self.seen_flat(before, after, centre_mm)
        flat = replace(moved, position=flat_before, vector=flat_after - flat_before)
        if moved.gradient is None:
            return flat
        one, mixed, other = self.curvature_per_mm
        place = before - self.about_mm
        slope = place @ np.array([[one, mixed], [mixed, other]]) / centre_mm[2]
        share = (_heights(place) @ self.curvature_per_mm / centre_mm[2])[..., None, None]
        by_before, by_after = (
            (1 - share) * own - (seen - centre_mm[:2])[..., :, None] * slope[..., None, :]
            for own, seen in ((np.eye(2), before), (moved.gradient + np.eye(2), after))
        )
        return replace(flat, gradient=by_after @ np.linalg.inv(by_before) - np.eye(2))


def _heights(place_mm: Float) -> Float:
    x, y = place_mm[..., 0], place_mm[..., 1]
    return np.stack([x * x / 2, x * y, y * y / 2], axis=-1)


def _bends(before: Float, after: Float, about_mm: Float, centre_mm: Float) -> tuple[Float, Float]:
    """Return displacements by unit curvatures (2n, 3), and those that are seen (2n,), without affine parts.

    A point at the height h appears displaced away from the foot of the camera, by h times its distance from
    the foot divided by the camera's height.
    """
    F = slopes_of(before, after - before) + np.eye(2)
    u, _, v = np.linalg.svd(F)
    foot, heights = centre_mm[:2], _heights(before - about_mm) / centre_mm[2]
    change = (after - foot) - (before - foot) @ (u @ v).T
    bends = heights[:, None, :] * change[:, :, None]
    terms = np.linalg.qr(np.column_stack([np.ones(len(before)), before - about_mm]))[0]
    columns = np.concatenate([bends, (after - before)[:, :, None]], axis=2).reshape(len(before), -1)
    columns -= terms @ (terms.T @ columns)
    both = columns.reshape(-1, 4)
    return both[:, :3], both[:, 3]
