"""Gauges that fit an affine displacement to their points: areas and points."""

from dataclasses import dataclass, replace

import numpy as np

from dic.errors import GaugeError
from dic.gauges.declared import Gauge
from dic.gauges.field import GaugeField
from dic.gauges.planes import lie_on_one_line, sums_at
from dic.gauges.points import GridPlaces
from dic.gauges.reading import Reading, SharedPart
from dic.gauges.strains import along, along_weights, elongation
from dic.gauges.sums import covariance_at_points
from dic.strain.measures import MEASURES
from dic.strain.strain import STRAIN_KEYS, strain_of_gradient, with_shared
from dic.typing import Float, Indices

LEAST_POINTS = 3
_VALUES = (*("u", "u_std", "v", "v_std", *STRAIN_KEYS[:3], "rotation_deg", *STRAIN_KEYS[3:]),)
MOVED, GRADIENT = [0, 3], [1, 2, 4, 5]
"""Indices of the displacement and of the gradient in the six sums that a fit gives."""
LEAST_SHARE = 0.5
"""Smallest share of a gauge's points that must have a displacement."""


@dataclass(frozen=True)
class PlacedFit:
    """The points of a strain-gauge area or around a point, and the place at which their fit is evaluated."""

    rows: Indices
    columns: Indices
    """Shape (n,). Row and column indices of the points in the grid of points."""
    place: Float
    """Shape (n,). Weights of the points. The weighted sum of the points' positions is the place of the
    reading, in any unit.
    """
    direction: Float
    """Shape (2,). Unit vector of the engineering strain."""
    reason: str = ""
    """Why the gauge cannot have a reading in any image; "" if it can."""

    @classmethod
    def of(
        cls, chosen: Indices, places: GridPlaces, at: Float, direction_deg: float, reason: str = ""
    ) -> "PlacedFit":
        """Return the fit to the points with the indices `chosen`, evaluated at the place `at`."""
        angle = np.radians(direction_deg)
        direction = np.array([np.cos(angle), np.sin(angle)])
        position = places.position[chosen]
        reason = reason or _objection(position, 0)
        place = np.zeros(len(chosen)) if reason else sums_at(position, at)[0]
        return cls(places.rows[chosen], places.columns[chosen], place, direction, reason)

    def points(self) -> tuple[Indices, Indices]:
        """Return the row and column indices of the points."""
        return self.rows, self.columns

    def read(self, field: GaugeField) -> Reading:
        """Return the gauge's reading in one displacement field."""
        displacement = field.displacement
        valid = displacement.valid[self.rows, self.columns]
        declared, points = len(self.rows), int(valid.sum())
        rows, columns = self.rows[valid], self.columns[valid]
        position = displacement.position[rows, columns]
        reason = self.reason or _objection(position, declared)
        if reason:
            unknown = dict.fromkeys(_VALUES, np.nan)
            return Reading(displacement.unit, points=points, declared=declared, values=unknown, reason=reason)
        at = self.place @ displacement.position[self.rows, self.columns]
        sums = sums_at(position, at)
        vector = displacement.vector[rows, columns]
        moved, gradient = sums[0] @ vector, (sums[1:] @ vector).T
        covariance = None
        if displacement.noise is not None:
            # Six sums: u and v at the place, and the elements xx, xy, yx, yy of the gradient.
            weights = np.einsum("ik,jn->nikj", np.eye(2), sums)
            covariance = covariance_at_points(
                rows, columns, weights.reshape(points, 2, 6), displacement.noise
            )
        length = float(np.ptp(position @ self.direction))
        return replace(
            self._reading(field, moved, gradient, covariance, points), declared=declared, length=length
        )

    def _reading(
        self,
        field: GaugeField,
        moved: Float,
        gradient: Float,
        covariance: Float | None,
        points: int,
    ) -> Reading:
        of_gradient = None if covariance is None else covariance[np.ix_(GRADIENT, GRADIENT)]
        mean = with_shared(
            strain_of_gradient(gradient, of_gradient, points, field.measure),
            field.common_noise + field.shared,
        )
        strain, by_gradient = elongation(gradient, self.direction)
        size = MEASURES[field.measure].by_engineering(1.0 + strain) ** 2
        images = size * along(field.common_noise, self.direction)
        images += np.nan if of_gradient is None else float(by_gradient @ of_gradient @ by_gradient)
        stds = np.full(2, np.nan) if covariance is None else np.sqrt(np.diag(covariance)[MOVED])
        known = vars(mean)
        values = {
            "u": float(moved[0]),
            "u_std": float(stds[0]),
            "v": float(moved[1]),
            "v_std": float(stds[1]),
        }
        values |= {name: float(known[name]) for name in known if name != "points"}
        return Reading(
            field.displacement.unit,
            strain=strain,
            strain_std=float(np.sqrt(images + size * along(field.shared, self.direction))),
            strain_std_images=float(np.sqrt(images)),
            points=points,
            values=values,
            shared=SharedPart(field.shared, np.sqrt(size) * along_weights(self.direction), field.mounting),
        )


def require_points(gauge: Gauge, found: int, places: GridPlaces, remedy: str) -> None:
    """Raise a `GaugeError` if too few points were measured at a gauge's place to fit a plane."""
    if found < LEAST_POINTS:
        expected = f"at least {LEAST_POINTS} measured points"
        raise without_points(gauge, expected, f"{found} at its place", places, remedy)


def without_points(gauge: Gauge, expected: str, got: str, places: GridPlaces, remedy: str) -> GaugeError:
    """Return the error for a gauge that lies at a place with too few measured points."""
    return GaugeError(
        f"gauge {gauge.name!r}",
        "find its points",
        expected,
        f"{got}; the measured points cover {places.extent(gauge.unit)}",
        f"move the gauge onto the measured points, or {remedy}; neighbouring points are"
        f" {places.spacing:.3g} {gauge.unit} apart",
    )


def _objection(position: Float, declared: int) -> str:
    """Return the reason why points (n, 2) do not determine an affine displacement; "" if they do."""
    if len(position) < max(LEAST_POINTS, LEAST_SHARE * declared):
        return f"too few points have a displacement: {len(position)} of {declared}"
    return "the points lie on one line" if lie_on_one_line(position) else ""
