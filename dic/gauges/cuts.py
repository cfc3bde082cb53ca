"""Line cuts: displacement and strain along a line, from affine fits around many places at once."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dic.gauges.declared import Gauge
from dic.gauges.field import GaugeField
from dic.gauges.fits import GRADIENT, LEAST_POINTS, LEAST_SHARE, MOVED, require_points
from dic.gauges.planes import flat_sets, lie_on_one_line, sums_at, sums_at_places
from dic.gauges.points import GridPlaces
from dic.gauges.reading import Profile
from dic.gauges.sums import correlations
from dic.strain.displacement import Displacement, Noise
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
        return self.prepared(field.displacement).read(field)

    def prepared(self, displacement: Displacement, *, often: bool = False) -> "PreparedCut":
        """Return the cut with those of its points that have a displacement.

        It can be read in all fields of the same reference that have the same points and the same positions.
        `often`: as for other gauges; a cut is prepared in the same way in both cases.
        """
        valid = self.member & displacement.valid[self.rows, self.columns]
        counts, declared = valid.sum(axis=1), self.member.sum(axis=1)
        good = counts >= np.maximum(LEAST_POINTS, LEAST_SHARE * declared)
        good &= ~flat_sets(displacement.position[self.rows, self.columns], valid) & self.place.any(axis=1)
        size = max(1, _IN_MEMORY // self.rows.shape[1] ** 2)
        numbers = np.flatnonzero(good)
        some = [numbers[first : first + size] for first in range(0, len(numbers), size)]
        # The sums of a few places are kept, those of many would take too much memory.
        kept = tuple(_Places.of(self, each, valid, displacement) for each in some) if len(some) == 1 else None
        return PreparedCut(self, valid, some, kept)


@dataclass(frozen=True)
class PreparedCut:
    """The places of a cut, as far as the displacements of its points do not change them."""

    placed: PlacedCut
    valid: Mask
    """Shape (places, m). True for points with a displacement."""
    some: Sequence[Indices]
    """The numbers of the places that have a value, in parts that are computed one after the other."""
    kept: "tuple[_Places, ...] | None"
    """The sums of each part, if they are kept."""

    def read(self, field: GaugeField) -> Profile:
        """Return displacement and strain at each place of the cut, in one displacement field."""
        count = len(self.valid)
        values = {name: np.full(count, np.nan) for each in _NAMES for name in (each, f"{each}_std")}
        parts = self.kept or (_Places.of(self.placed, k, self.valid, field.displacement) for k in self.some)
        for some, part in zip(self.some, parts, strict=True):
            for name, found in part.values(field).items():
                values[name][some] = found
        return Profile(
            field.displacement.unit,
            np.linspace(0.0, self.placed.length, count),
            self.placed.unit,
            values,
            self.valid.sum(axis=1),
            self.placed.member.sum(axis=1),
            "" if self.some else "no place has enough points with a displacement",
        )


@dataclass(frozen=True)
class _Places:
    """Some places of a cut, with the sums over their points."""

    rows: Indices
    columns: Indices
    valid: Mask
    """Shape (places, m). The points around each place, and those of them with a displacement."""
    sums: Float
    """Shape (places, 3, m). Weights of the displacements in displacement and slopes at each place."""
    known: Float | None
    """Shape (places, m, m). Correlations between the errors of the points around each place."""

    @classmethod
    def of(cls, cut: PlacedCut, some: Indices, valid: Mask, displacement: Displacement) -> "_Places":
        """Return the places of a cut with the numbers `some`."""
        rows, columns, valid = cut.rows[some], cut.columns[some], valid[some]
        whole = displacement.position[rows, columns]
        within = np.where(cut.member[some][..., None], whole, 0.0)
        places = np.einsum("pm,pmi->pi", cut.place[some], within)
        sums = sums_at_places(np.where(valid[..., None], whole, 0.0), valid, places)
        noise = displacement.noise
        known = None if noise is None else correlations(rows, columns, noise)
        return cls(rows, columns, valid, sums, known)

    def values(self, field: GaugeField) -> dict[str, Float]:
        """Return displacement, strain and standard deviations at the places."""
        displacement, at, sums = field.displacement, (self.rows, self.columns), self.sums
        vector = np.where(self.valid[..., None], displacement.vector[at], 0.0)
        fitted = sums @ vector
        moved, gradient = fitted[:, 0].T, np.swapaxes(fitted[:, 1:], 1, 2)
        covariance = np.full((len(sums), 6, 6), np.nan)
        if displacement.noise is not None and self.known is not None:
            covariance = self._covariances(displacement.noise, self.known)
        of_gradient = covariance[:, GRADIENT][:, :, GRADIENT]
        strain, std = strain_of(gradient, of_gradient, field.measure)
        common = np.diag(field.common_noise + field.shared)[:, None]
        values = np.concatenate([moved, strain[:3]])
        variances = np.diagonal(covariance, axis1=1, axis2=2).T[MOVED]
        stds = np.sqrt(np.concatenate([variances, std[:3] ** 2 + common]))
        named = zip(_NAMES, values, stds, strict=True)
        return {name: each for label, a, b in named for name, each in ((label, a), (f"{label}_std", b))}

    def _covariances(self, noise: Noise, known: Float) -> Float:
        """Return the covariance of a place's displacement and gradient (six sums), shape (places, 6, 6)."""
        count, most = self.rows.shape
        weights = self._weights
        used = (self.sums != 0.0).any(axis=1)[:, :, None, None]
        factors = np.where(used, noise.factors[self.rows, self.columns], 0.0)
        parts = np.swapaxes(weights, 2, 3) @ factors
        shared = (known @ parts.reshape(count, most, 12)).reshape(count, most, 6, 2)
        covariance = np.einsum("pmqa,pmra->pqr", parts, shared)
        if noise.bias is not None:
            bias = np.where(used, noise.bias[self.rows, self.columns], 0.0)
            error = np.einsum("pmia,pmiq->pqa", bias, weights)
            covariance += error @ np.swapaxes(error, 1, 2)
        return np.asarray(covariance)

    @cached_property
    def _weights(self) -> Float:
        """Weights of the displacements in the six sums, shape (places, m, 2, 6)."""
        count, most = self.rows.shape
        return np.asarray(np.einsum("ik,pjm->pmikj", np.eye(2), self.sums).reshape(count, most, 2, 6))
