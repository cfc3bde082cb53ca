"""The plane of a specimen's surface in each frame, by parallax, from the points of two cameras' gauges."""

from dataclasses import dataclass, replace

import numpy as np

from dic.gauges.planes import lie_on_one_line, sums_at
from dic.gauges.sums import correlations, covariance_at_points
from dic.live.corrected import CorrectedField
from dic.live.fields import LiveFields
from dic.live.motion import Bend
from dic.out_of_plane.parallax import Heights, Seen
from dic.typing import Float, Indices

_MOST_PAIRS = 64
"""Number of pairs that is enough for a plane."""

_FEWEST_PAIRS = 6
_REACH = 2.5
"""Points of the second camera count as beside a point of the first within this many of their spacings."""

_MOST = 9
"""Number of points of the second camera that give the displacement at a point of the first."""

_GAIN = 1.0
"""Largest sum of the squared weights of these points; a larger one is an extrapolation."""

_AGREE, _AGREE_PX = 4.0, 0.01
"""Largest rms disagreement of the cameras across the parallax: a multiple of the noise, and px besides."""


@dataclass(frozen=True)
class PlaneFound:
    """The plane that the points of two cameras show in one frame."""

    values: Float
    """Shape (3,). Slopes and shift (mm)."""
    covariance: Float
    """Shape (3, 3). Their errors by the noise of the images."""
    agrees: bool
    """True if both cameras show the same points, apart from noise."""


@dataclass(frozen=True)
class GaugePairs:
    """Material points that the gauges of two cameras share."""

    chosen: Indices
    """Shape (n,). Numbers of the first camera's points."""
    partner: Float
    """Shape (n, points of the second). Weights of the second camera's displacements at the chosen points."""
    known: tuple[Float, Float]
    """Correlations between the errors of the points, for each camera."""

    @classmethod
    def of(
        cls, fields: tuple[LiveFields, LiveFields], corrected: tuple[CorrectedField, CorrectedField]
    ) -> "GaugePairs":
        """Find the points of the first camera that have points of the second around them."""
        from scipy.spatial import cKDTree

        here, there = (each.before_mm for each in corrected)
        tree = cKDTree(there)
        apart = np.asarray(tree.query(there, k=2)[0])[:, 1] if len(there) > 1 else np.full(1, np.nan)
        found = tree.query(here, k=min(_MOST, len(there)))
        distance, near = (np.asarray(each).reshape(len(here), -1) for each in found)
        close = distance <= _REACH * float(np.median(apart))
        chosen, partner = [], []
        for k, point in enumerate(here):
            own = near[k][close[k]]
            if len(own) < 3 or lie_on_one_line(there[own]):
                continue
            weights = sums_at(there[own], point)[0]
            if weights @ weights <= _GAIN:
                row = np.zeros(len(there))
                row[own] = weights
                chosen.append(k)
                partner.append(row)
        stride = max(1, -(-len(chosen) // _MOST_PAIRS))
        noises = [f.calibrated.displacement.noise for f in fields if f.calibrated is not None]
        first, second = (
            correlations(*f.grid_at, noise)
            for f, noise in zip(fields, noises, strict=True)
            if noise is not None
        )
        rows, some = np.array(partner[::stride]).reshape(-1, len(there)), np.array(chosen[::stride], np.int64)
        if lie_on_one_line(here[some]):
            rows, some = rows[:0], some[:0]
        return cls(some, rows, (first, second))

    def plane(
        self,
        fields: tuple[LiveFields, LiveFields],
        corrected: tuple[CorrectedField, CorrectedField],
        bend: Bend,
        mm_per_px: float,
    ) -> PlaneFound | None:
        """Return the plane in the present frame, or None if too few pairs have displacements.

        `bend`: curvature of the surface beside its plane, which is known from whole fields.
        """
        first, second = corrected
        use = fields[0].valid[self.chosen]
        if not fields[1].valid.all():
            use = use & ~(self.partner[:, ~fields[1].valid] != 0.0).any(axis=1)
        if np.count_nonzero(use) < _FEWEST_PAIRS:
            return None
        whole = bool(use.all())
        chosen, partner = (each if whole else each[use] for each in (self.chosen, self.partner))
        start = first.before_mm[chosen]
        if not whole and lie_on_one_line(start):
            return None
        moved = np.where(fields[1].valid[:, None], second.after_mm - second.before_mm, 0.0)
        share = np.full(len(chosen), 1.0 / len(chosen))
        seen = Seen(start, first.after_mm[chosen], start + partner @ moved, share)
        heights = Heights.of(seen, (first.centre_mm, second.centre_mm))
        flat = replace(heights, z_mm=heights.z_mm - bend.heights(heights.position_mm))
        plane = flat.plane()
        weights = heights.plane_weights()
        to_first = np.zeros((len(first.before_mm), 2, 3))
        to_first[chosen] = weights
        to_second = -(partner.T @ weights.reshape(len(chosen), 6)).reshape(-1, 2, 3)
        covariance = np.zeros((3, 3))
        noise_mm2 = 0.0
        for field, own, known in zip(fields, (to_first, to_second), self.known, strict=True):
            noise = None if field.calibrated is None else field.calibrated.displacement.noise
            if noise is None:
                return None
            own = np.where(field.valid[:, None, None], own, 0.0)
            covariance += covariance_at_points(*field.grid_at, own, noise, known)
            noise_mm2 += (
                float(np.square(noise.factors[field.grid_at][field.valid]).sum(axis=(1, 2)).mean()) / 2
            )
        limit_mm = _AGREE * np.sqrt(noise_mm2) + _AGREE_PX * mm_per_px
        agrees = bool(np.sqrt(np.mean(heights.across_mm**2)) <= limit_mm)
        return PlaneFound(np.array([plane.slope_x, plane.slope_y, plane.shift_mm]), covariance, agrees)
