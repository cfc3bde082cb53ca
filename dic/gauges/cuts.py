"""Line cuts: displacement and strain along a line, from affine fits around many places at once."""

from dataclasses import dataclass

import numpy as np

from dic.gauges.declared import Gauge
from dic.gauges.field import GaugeField
from dic.gauges.fits import GRADIENT, LEAST_POINTS, LEAST_SHARE, MOVED, require_points
from dic.gauges.planes import flat_sets, lie_on_one_line, sums_at, sums_at_places
from dic.gauges.points import GridPlaces
from dic.gauges.reading import Profile
from dic.gauges.sums import correlations
from dic.strain.displacement import Noise
from dic.strain.tensor import strain_of
from dic.typing import Float, Indices, Mask

_NAMES = ("u", "v", "exx", "eyy", "exy")
_IN_MEMORY = 4_000_000
"""Correlations between errors of points are computed for about this number of pairs of points at a time."""


@dataclass(frozen=True)
class PlacedCut:
    """A line cut, and the measured points around each place of the cut."""

    length: float
    unit: str
    """Length of the cut and its unit."""
    rows: Indices
    columns: Indices
    """Shape (places, m). Row and column indices of the points in the grid of points."""
    member: Mask
    """Shape (places, m). False where a place has fewer than m points."""
    place: Float
    """Shape (places, m). Weights of the points. The weighted sum of the points' positions is the place, in
    any unit.
    """

    @classmethod
    def of(
        cls, gauge: Gauge, count: int, width: float | None, places: GridPlaces, window_points: int
    ) -> "PlacedCut":
        """Find the points around `count` places between the two ends of a gauge.

        The points lie in a square of the given width; without a width, of `window_points` points a side.

        Raises `GaugeError` if no place has three points.
        """
        start, end = gauge.declared_places()
        ways = start + np.linspace(0.0, 1.0, count)[:, None] * (end - start)
        chosen = [places.around(at, width, window_points) for at in ways]
        most = max(map(len, chosen))
        require_points(gauge, most, places, "enlarge its width")
        rows, columns = np.zeros((2, len(ways), most), np.int64)
        member, place = np.zeros(rows.shape, np.bool_), np.zeros(rows.shape)
        for k, (at, points) in enumerate(zip(ways, chosen, strict=True)):
            own = slice(0, len(points))
            rows[k, own], columns[k, own] = places.rows[points], places.columns[points]
            member[k, own] = True
            if not lie_on_one_line(places.position[points]):
                place[k, own] = sums_at(places.position[points], at)[0]
        return cls(float(np.linalg.norm(end - start)), gauge.unit, rows, columns, member, place)

    def points(self) -> tuple[Indices, Indices]:
        """Return the row and column indices of the points of all places."""
        return self.rows[self.member], self.columns[self.member]

    def read(self, field: GaugeField) -> Profile:
        """Return displacement and strain at each place of the cut, in one displacement field."""
        displacement = field.displacement
        valid = self.member & displacement.valid[self.rows, self.columns]
        counts, declared = valid.sum(axis=1), self.member.sum(axis=1)
        values = {name: np.full(len(counts), np.nan) for each in _NAMES for name in (each, f"{each}_std")}
        good = counts >= np.maximum(LEAST_POINTS, LEAST_SHARE * declared)
        good &= ~flat_sets(displacement.position[self.rows, self.columns], valid) & self.place.any(axis=1)
        size = max(1, _IN_MEMORY // self.rows.shape[1] ** 2)
        for first in range(0, int(good.sum()), size):
            some = np.flatnonzero(good)[first : first + size]
            for name, found in self._fitted(field, some, valid[some]).items():
                values[name][some] = found
        return Profile(
            displacement.unit,
            np.linspace(0.0, self.length, len(counts)),
            self.unit,
            values,
            counts,
            declared,
            "" if good.any() else "no place has enough points with a displacement",
        )

    def _fitted(self, field: GaugeField, some: Indices, valid: Mask) -> dict[str, Float]:
        """Return displacement, strain and standard deviations at the places with the indices `some`."""
        displacement, at = field.displacement, (self.rows[some], self.columns[some])
        whole = displacement.position[at]
        places = np.einsum("pm,pmi->pi", self.place[some], np.where(self.member[some][..., None], whole, 0.0))
        sums = sums_at_places(np.where(valid[..., None], whole, 0.0), valid, places)
        vector = np.where(valid[..., None], displacement.vector[at], 0.0)
        moved = np.einsum("pm,pmi->ip", sums[:, 0], vector)
        gradient = np.einsum("pjm,pmi->pij", sums[:, 1:], vector)
        covariance = np.full((len(some), 6, 6), np.nan)
        if displacement.noise is not None:
            covariance = _covariances(displacement.noise, *at, sums)
        of_gradient = covariance[:, GRADIENT][:, :, GRADIENT]
        strain, std = strain_of(gradient, of_gradient, field.measure)
        common = np.diag(field.common_noise + field.shared)[:, None]
        values = np.concatenate([moved, strain[:3]])
        variances = np.diagonal(covariance, axis1=1, axis2=2).T[MOVED]
        stds = np.sqrt(np.concatenate([variances, std[:3] ** 2 + common]))
        named = zip(_NAMES, values, stds, strict=True)
        return {name: each for label, a, b in named for name, each in ((label, a), (f"{label}_std", b))}


def _covariances(noise: Noise, rows: Indices, columns: Indices, sums: Float) -> Float:
    """Return the covariance of a place's displacement and gradient (six sums), shape (places, 6, 6)."""
    count, most = rows.shape
    weights = np.einsum("ik,pjm->pmikj", np.eye(2), sums).reshape(count, most, 2, 6)
    used = (sums != 0.0).any(axis=1)[:, :, None, None]
    parts = np.einsum("pmia,pmiq->pmqa", np.where(used, noise.factors[rows, columns], 0.0), weights)
    shared = correlations(rows, columns, noise) @ parts.reshape(count, most, 12)
    covariance = np.einsum("pmqa,pmra->pqr", parts, shared.reshape(parts.shape))
    if noise.bias is not None:
        bias = np.where(used, noise.bias[rows, columns], 0.0)
        error = np.einsum("pmia,pmiq->pqa", bias, weights)
        covariance += error @ np.swapaxes(error, 1, 2)
    return np.asarray(covariance)
