"""Extensometers: the change of the distance between two patches, for one line or averaged over many."""

from dataclasses import dataclass

import numpy as np

from dic.errors import GaugeError
from dic.gauges.declared import LEAST_LINES, Extensometer, TransverseExtensometer
from dic.gauges.field import GaugeField
from dic.gauges.planes import lie_on_one_line, sums_at
from dic.gauges.points import GridPlaces
from dic.gauges.reading import Reading
from dic.gauges.strains import along, engineering
from dic.gauges.sums import covariance_at_points
from dic.typing import Float, Indices, Mask

_LEAST_SHARE = 0.5
"""Smallest share of a patch's points that must have a displacement."""


@dataclass(frozen=True)
class PlacedLines:
    """An extensometer, and the points of the measured grid in its patches.

    Attributes
    ----------
    gauge : Extensometer or TransverseExtensometer
    rows, columns : ndarray of int, shape (n,)
        Places of all points of the patches in the grid of points.
    patches : ndarray of bool, shape (2, lines, n)
        True for the points in the patch at the start and at the end of each line.
    """

    gauge: Extensometer | TransverseExtensometer
    rows: Indices
    columns: Indices
    patches: Mask

    @classmethod
    def of(cls, gauge: Extensometer | TransverseExtensometer, places: GridPlaces) -> "PlacedLines":
        """Find the points of each patch.

        Raises
        ------
        GaugeError
            If a patch has no point.
        """
        start, end = gauge.upwards(gauge.start), gauge.upwards(gauge.end)
        direction = (end - start) / np.linalg.norm(end - start)
        across = np.array([-direction[1], direction[0]])
        offsets = np.zeros(1)
        if isinstance(gauge, TransverseExtensometer):
            offsets = np.linspace(-0.5 * gauge.spread, 0.5 * gauge.spread, gauge.lines)
        found = [
            [places.in_square(at + offset * across, direction, gauge.patch) for offset in offsets]
            for at in (start, end)
        ]
        whole = sum(all(points.size for points in both) for both in zip(*found, strict=True))
        if whole < (LEAST_LINES if len(offsets) > 1 else 1):
            ends = [name for side, name in zip(found, ("start", "end"), strict=True) if not side[0].size]
            raise _without_points(gauge, whole, ends, places)
        every = np.unique(np.concatenate([points for side in found for points in side]))
        patches = np.array([[np.isin(every, points) for points in side] for side in found])
        return cls(gauge, places.rows[every], places.columns[every], patches)

    def read(self, field: GaugeField) -> Reading:
        """Return the reading in one field.

        The strain is the change of the distance between the middles of the two patches over this distance.
        A rigid motion does not change it. With many lines the strains are averaged.
        """
        displacement = field.displacement
        at = self.rows, self.columns
        valid = displacement.valid[at]
        declared = len(self.rows)
        counts = (self.patches & valid).sum(axis=2)
        good = (counts >= np.maximum(1.0, _LEAST_SHARE * self.patches.sum(axis=2))).all(axis=0)
        single = not isinstance(self.gauge, TransverseExtensometer)
        lines = None if single else int(good.sum())
        if int(good.sum()) < (1 if single else LEAST_LINES):
            return Reading(
                displacement.unit,
                points=int(valid.sum()),
                declared=declared,
                lines=lines,
                reason=self._reason(counts, good),
            )
        mean = np.subtract(*(self._sums(patches[good], valid, field) for patches in self.patches[::-1]))
        position = np.where(valid[:, None], displacement.position[at], 0.0)
        vector = np.where(valid[:, None], displacement.vector[at], 0.0)
        before = mean @ position
        after = before + mean @ vector
        lengths, longer = np.linalg.norm(before, axis=1), np.linalg.norm(after, axis=1)
        # The derivative of a length by the displacement of its end is its direction.
        ends = after / longer[:, None] / len(lengths)
        weights = np.stack([mean.T @ (ends / lengths[:, None]), mean.T @ ends], axis=-1)
        strain, extension = float(np.mean(longer / lengths - 1.0)), float(np.mean(longer - lengths))
        images = np.full(2, np.nan)
        if displacement.noise is not None:
            points = (weights != 0.0).any(axis=(1, 2))
            covariance = covariance_at_points(
                self.rows[points], self.columns[points], weights[points], displacement.noise
            )
            images = np.diag(covariance)
        direction = before.mean(axis=0) / np.linalg.norm(before.mean(axis=0))
        common, shared = (
            along(part, direction) * engineering(1.0 + strain, field.measure) ** 2
            for part in (field.common_noise, field.shared)
        )
        length = float(lengths.mean())
        return Reading(
            displacement.unit,
            strain=strain,
            strain_std=float(np.sqrt(images[0] + common + shared)),
            strain_std_images=float(np.sqrt(images[0] + common)),
            extension=extension,
            extension_std=float(np.sqrt(images[1] + (common + shared) * length**2)),
            length=length,
            points=int(valid.sum()),
            declared=declared,
            lines=lines,
        )

    def _sums(self, patches: Mask, valid: Mask, field: GaugeField) -> Float:
        """Return the weights, shape (lines, n), that give the displacement in the middle of each patch.

        Where points are lost, a plane through the others gives the displacement at the mean place of all
        points. If the others lie on one line, their mean is used.
        """
        used = patches & valid
        sums = used / used.sum(axis=1, keepdims=True)
        position = field.displacement.position[self.rows, self.columns]
        for line in np.flatnonzero((used != patches).any(axis=1)):
            own, whole = used[line], position[patches[line]]
            if np.isfinite(whole).all() and not lie_on_one_line(position[own]):
                sums[line, own] = sums_at(position[own], whole.mean(axis=0))[0]
        return np.asarray(sums)

    def _reason(self, counts: Indices, good: Mask) -> str:
        if len(good) > 1:
            return f"only {int(good.sum())} lines have displacements at both ends, {LEAST_LINES} are needed"
        (start,), (end,) = counts
        (first,), (last,) = self.patches.sum(axis=2)
        return (
            f"too few points have a displacement: {start} of {first} at the start, {end} of {last} at the end"
        )


def _without_points(
    gauge: Extensometer | TransverseExtensometer, whole: int, ends: list[str], places: GridPlaces
) -> GaugeError:
    expected = "measured points in both patches"
    got = f"none at the {' and the '.join(ends)}"
    if isinstance(gauge, TransverseExtensometer):
        expected = f"at least {LEAST_LINES} lines with measured points at both ends"
        got = f"{whole} of {gauge.lines}"
    return GaugeError(
        f"gauge {gauge.name!r}",
        "find its points",
        expected,
        f"{got}; the measured points cover {places.extent(gauge.unit)}",
        f"move the gauge onto the measured points, or enlarge its patch; neighbouring points are"
        f" {places.spacing:.3g} {gauge.unit} apart",
    )
