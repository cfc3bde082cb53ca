"""Extensometers: the change of the distance between two patches, for one line or averaged over many."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dic.gauges.declared import LEAST_LINES, Gauge
from dic.gauges.field import GaugeField
from dic.gauges.fits import without_points
from dic.gauges.planes import flat_sets, lie_on_one_line, sums_at, sums_at_places
from dic.gauges.points import GridPlaces
from dic.gauges.reading import Reading, SharedPart
from dic.gauges.strains import along_weights
from dic.gauges.sums import covariance_at_points, kept_correlations
from dic.strain.displacement import Displacement
from dic.strain.measures import MEASURES
from dic.typing import Float, Indices, Mask

_LEAST_SHARE = 0.5
"""Smallest share of a patch's points that must have a displacement."""


@dataclass(frozen=True)
class PlacedLines:
    """An extensometer, and the points of the measured grid in its patches."""

    rows: Indices
    columns: Indices
    """Shape (n,). Row and column indices of all points of the patches in the grid of points."""
    members: Indices
    """Shape (2, lines, m). Indices of the points in the patch at the start and at the end of each line."""
    patches: Mask
    """Shape (2, lines, m). False where a patch has fewer than m points."""
    place: Float
    """Shape (2, lines, m). Weights of the points. The weighted sum of the points' positions is the middle of
    the patch, in any unit.
    """

    @classmethod
    def of(cls, gauge: Gauge, patch: float, offsets: Float, places: GridPlaces) -> "PlacedLines":
        """Find the points of each patch, with the side length `patch`, of lines beside the gauge's own line.

        Raises `GaugeError` if a patch has no point.
        """
        start, end = gauge.declared_places()
        direction = (end - start) / np.linalg.norm(end - start)
        across = np.array([-direction[1], direction[0]])
        middles = np.array([[at + offset * across for offset in offsets] for at in (start, end)])
        found = [[places.in_patch(at, direction, patch) for at in side] for side in middles]
        whole = sum(all(points.size for points in both) for both in zip(*found, strict=True))
        if whole < (LEAST_LINES if len(offsets) > 1 else 1):
            ends = [name for side, name in zip(found, ("start", "end"), strict=True) if not side[0].size]
            expected, got = "measured points in both patches", f"none at the {' and the '.join(ends)}"
            if len(offsets) > 1:
                expected = f"at least {LEAST_LINES} lines with measured points at both ends"
                got = f"{whole} of {len(offsets)}"
            raise without_points(gauge, expected, got, places, "enlarge its patch")
        every = np.unique(np.concatenate([points for side in found for points in side]))
        shape = (2, len(offsets), max(len(points) for side in found for points in side))
        members, patches, place = np.zeros(shape, np.int64), np.zeros(shape, np.bool_), np.zeros(shape)
        for side, line in np.ndindex(shape[:2]):
            points, own = found[side][line], slice(0, len(found[side][line]))
            members[side, line, own], patches[side, line, own] = np.searchsorted(every, points), True
            place[side, line, own] = 1.0 / max(1, len(points))
            if not lie_on_one_line(places.position[points]):
                place[side, line, own] = sums_at(places.position[points], middles[side, line])[0]
        return cls(places.rows[every], places.columns[every], members, patches, place)

    def points(self) -> tuple[Indices, Indices]:
        """Return the row and column indices of the points."""
        return self.rows, self.columns

    def read(self, field: GaugeField) -> Reading:
        """Return the extensometer's reading in one displacement field.

        The strain is the change of the distance between the middles of the two patches, divided by this
        distance. So a rigid motion does not change the strain. The strains of several lines are averaged.
        """
        return self.prepared(field.displacement).read(field)

    def prepared(self, displacement: Displacement, *, often: bool = False) -> "PreparedLines":
        """Return the extensometer with those of its points that have a displacement.

        It can be read in all fields of the same reference that have the same points and the same positions.
        `often`: True if it will be read many times.
        """
        valid = displacement.valid[self.rows, self.columns]
        counts = (self.patches & valid[self.members]).sum(axis=2)
        good = (counts >= np.maximum(1.0, _LEAST_SHARE * self.patches.sum(axis=2))).all(axis=0)
        read = Reading(
            displacement.unit,
            points=int(valid.sum()),
            declared=len(valid),
            lines=None if len(good) == 1 else int(good.sum()),
        )
        if int(good.sum()) < (1 if len(good) == 1 else LEAST_LINES):
            read = replace(read, reason=self._reason(counts, good))
            return PreparedLines(read, self.rows[:0], self.columns[:0], np.zeros((0, 0)), np.zeros((0, 2)))
        position = displacement.position[self.rows, self.columns]
        mean = self._sums(1, good, valid, position) - self._sums(0, good, valid, position)
        before = mean @ np.where(valid[:, None], position, 0.0)
        used = (mean != 0.0).any(axis=0)
        rows, columns = self.rows[used], self.columns[used]
        known = kept_correlations(rows, columns, displacement.noise, often=often)
        return PreparedLines(read, rows, columns, mean[:, used], before, known)

    def _sums(self, side: int, good: Mask, valid: Mask, position: Float) -> Float:
        """Return the weights of all points, shape (lines, n), in the displacement at each patch's middle.

        This displacement is the value of a plane fitted to the displacements of the patch's points. If the
        points lie on one line, the displacement is the mean over the points.
        """
        members, patches = self.members[side, good], self.patches[side, good]
        position = position[members]
        used = patches & valid[members]
        known = np.where(used[..., None], position, 0.0)
        sums = used / used.sum(axis=1, keepdims=True)
        middles = np.einsum("lm,lmi->li", self.place[side, good], np.where(patches[..., None], position, 0.0))
        full = ~flat_sets(known, used)
        sums[full] = sums_at_places(known[full], used[full], middles[full])[:, 0]
        weights = np.zeros((len(sums), len(self.rows)))
        np.add.at(weights, (np.arange(len(sums))[:, None], members), np.where(used, sums, 0.0))
        return weights

    def _reason(self, counts: Indices, good: Mask) -> str:
        if len(good) > 1:
            return f"only {int(good.sum())} lines have displacements at both ends, {LEAST_LINES} are needed"
        (start,), (end,) = counts
        (first,), (last,) = self.patches.sum(axis=2)
        return (
            f"too few points have a displacement: {start} of {first} at the start, {end} of {last} at the end"
        )


@dataclass(frozen=True)
class PreparedLines:
    """The lines of an extensometer, as far as the displacements of its points do not change them."""

    without: Reading
    """The reading without values: its counts, and the reason if there is no reading."""
    rows: Indices
    columns: Indices
    """Shape (n,). Row and column indices of the points that are used."""
    mean: Float
    """Shape (lines, n). Weights of the points' displacements in the difference between the displacements at
    the end and at the start of each line.
    """
    before: Float
    """Shape (lines, 2). Vector from the start to the end of each line in the reference."""
    known: Float | None = None
    """Shape (n, n). Correlations between the errors of the points, if they are kept."""

    def read(self, field: GaugeField) -> Reading:
        """Return the extensometer's reading in one displacement field."""
        if self.without.reason:
            return self.without
        displacement, at, mean = field.displacement, (self.rows, self.columns), self.mean
        after = self.before + mean @ displacement.vector[at]
        lengths, longer = self._lengths, np.sqrt((after * after).sum(axis=1))
        images = np.full(2, np.nan)
        if displacement.noise is not None:
            # The derivative of a length with respect to the displacement of its end is the unit vector along
            # the length.
            ends = after / longer[:, None] / len(lengths)
            weights = np.stack([mean.T @ (ends / lengths[:, None]), mean.T @ ends], axis=-1)
            images = np.diag(covariance_at_points(*at, weights, displacement.noise, self.known))
        strain, length = float(np.mean(longer / lengths - 1.0)), float(lengths.mean())
        by_strain = MEASURES[field.measure].by_engineering(1.0 + strain)
        common, shared = (part * by_strain**2 for part in field.along(self._along))
        return replace(
            self.without,
            strain=strain,
            strain_std=float(np.sqrt(images[0] + common + shared)),
            strain_std_images=float(np.sqrt(images[0] + common)),
            extension=float(np.mean(longer - lengths)),
            extension_std=float(np.sqrt(images[1] + (common + shared) * length**2)),
            length=length,
            shared=SharedPart(field.shared, by_strain * self._along, field.mounting),
        )

    @cached_property
    def _lengths(self) -> Float:
        return np.asarray(np.linalg.norm(self.before, axis=1))

    @cached_property
    def _along(self) -> Float:
        """Weights of exx, eyy and exy in the strain along the mean direction of the lines."""
        direction = self.before.mean(axis=0)
        return along_weights(direction / np.linalg.norm(direction))
