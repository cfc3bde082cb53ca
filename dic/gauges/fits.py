"""Gauges that fit an affine displacement to their points: areas and points."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from dic.errors import GaugeError
from dic.gauges.declared import Gauge
from dic.gauges.field import GaugeField
from dic.gauges.planes import lie_on_one_line, sums_at
from dic.gauges.points import GridPlaces
from dic.gauges.reading import Reading, SharedPart
from dic.gauges.strains import along_weights, elongation
from dic.gauges.sums import PointErrors, covariance_at_points, kept_correlations
from dic.strain.displacement import Displacement, Noise
from dic.strain.measures import MEASURES
from dic.strain.strain import STRAIN_KEYS, strain_of_gradient, with_shared
from dic.typing import Float, Indices

LEAST_POINTS = 3
_VALUES = (*("u", "u_std", "v", "v_std", *STRAIN_KEYS[:3], "rotation_deg", *STRAIN_KEYS[3:]),)
MOVED, GRADIENT = [0, 3], [1, 2, 4, 5]
"""Indices of the displacement and of the gradient in the six sums that a fit gives."""
_OF_GRADIENT = np.ix_(GRADIENT, GRADIENT)
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
        return self.prepared(field.displacement).read(field)

    def prepared(self, displacement: Displacement, *, often: bool = False) -> "PreparedFit":
        """Return the fit to those of the gauge's points that have a displacement.

        It can be read in all fields of the same reference that have the same points and the same positions.
        `often`: True if it will be read many times.
        """
        valid = displacement.valid[self.rows, self.columns]
        rows, columns = self.rows[valid], self.columns[valid]
        position = displacement.position[rows, columns]
        reason = self.reason or _objection(position, len(self.rows))
        if reason:
            return PreparedFit(self, rows, columns, np.zeros((3, len(rows))), reason=reason)
        at = self.place @ displacement.position[self.rows, self.columns]
        length, known = float(np.ptp(position @ self.direction)), None
        known = kept_correlations(rows, columns, displacement.noise, often=often)
        return PreparedFit(self, rows, columns, sums_at(position, at), length, known)


@dataclass(frozen=True)
class PreparedFit:
    """The fit of a gauge to its points with a displacement, as far as the displacements do not change it."""

    placed: PlacedFit
    rows: Indices
    columns: Indices
    """Shape (n,). Row and column indices of the points with a displacement."""
    sums: Float
    """Shape (3, n). Weights of the displacements in the value of the fit at the gauge's place, and in its
    two slopes.
    """
    length: float = np.nan
    known: Float | None = None
    """Shape (n, n). Correlations between the errors of the points, if they are kept."""
    reason: str = ""
    """Why the gauge has no reading; "" if it has one."""

    def read(self, field: GaugeField) -> Reading:
        """Return the gauge's reading in one displacement field."""
        unit, points, declared = field.displacement.unit, len(self.rows), len(self.placed.rows)
        if self.reason:
            unknown = dict.fromkeys(_VALUES, np.nan)
            return Reading(unit, points=points, declared=declared, values=unknown, reason=self.reason)
        displacement, direction = field.displacement, self.placed.direction
        fitted = self.sums @ displacement.vector[self.rows, self.columns]
        gradient = fitted[1:].T
        strain, by_gradient = elongation(gradient, direction)
        covariance, of_images = self._errors(displacement.noise, by_gradient)
        size = MEASURES[field.measure].by_engineering(1.0 + strain) ** 2
        weights = along_weights(direction)
        images, shared = (size * part for part in field.along(weights))
        images += of_images
        return Reading(
            unit,
            strain=strain,
            strain_std=float(np.sqrt(images + shared)),
            strain_std_images=float(np.sqrt(images)),
            length=self.length,
            points=points,
            declared=declared,
            values=_FitValues(fitted[0], gradient, covariance, points, field),
            shared=SharedPart(field.shared, np.sqrt(size) * weights, field.mounting),
        )

    def _errors(self, noise: Noise | None, by_gradient: Float) -> tuple[Callable[[], Float | None], float]:
        """Return a function that returns the covariance (6, 6) of the sums, and the variance of the strain.

        The function computes it when it is called, from the errors as they are now, if that is possible.
        """
        if noise is None:
            return partial(_same, None), np.nan
        if self.known is None:
            covariance = covariance_at_points(self.rows, self.columns, self._weights, noise)
            return partial(_same, covariance), float(by_gradient @ covariance[_OF_GRADIENT] @ by_gradient)
        errors = PointErrors.of(self.rows, self.columns, noise, self.known)
        later = partial(errors.covariance, self._weights)
        return later, errors.variance(self._gradient_weights @ by_gradient)

    @cached_property
    def _gradient_weights(self) -> Float:
        """Weights, shape (n, 2, 4), in the elements of the gradient."""
        return np.ascontiguousarray(self._weights[:, :, GRADIENT])

    @cached_property
    def _weights(self) -> Float:
        """Weights, shape (n, 2, 6), of the displacements in u and v at the gauge's place, and in the elements
        xx, xy, yx, yy of the gradient.
        """
        return np.asarray(np.einsum("ik,jn->nikj", np.eye(2), self.sums).reshape(-1, 2, 6))


def _same(value: Float | None) -> Float | None:
    return value


class _FitValues(Mapping[str, float]):
    """The values of a reading by their names; they are computed when the first of them is used.

    `moved`, shape (2,), and `gradient`, shape (2, 2): displacement and its gradient at the gauge's place.
    `covariance`: function that returns their covariance, shape (6, 6); None if it is not known. `points`:
    number of points.
    """

    def __init__(
        self,
        moved: Float,
        gradient: Float,
        covariance: Callable[[], Float | None],
        points: int,
        field: GaugeField,
    ) -> None:
        self._fit = moved, gradient, covariance, points
        self._shared, self._measure = field.common_noise + field.shared, field.measure

    def __getitem__(self, name: str) -> float:
        return self._known[name]

    def __iter__(self) -> Iterator[str]:
        return iter(_VALUES)

    def __len__(self) -> int:
        return len(_VALUES)

    def __repr__(self) -> str:
        return repr(self._known)

    @cached_property
    def _known(self) -> dict[str, float]:
        moved, gradient, errors, points = self._fit
        covariance = errors()
        of_gradient = None if covariance is None else covariance[_OF_GRADIENT]
        mean = with_shared(strain_of_gradient(gradient, of_gradient, points, self._measure), self._shared)
        stds = np.full(2, np.nan) if covariance is None else np.sqrt(np.diag(covariance)[MOVED])
        values = {
            "u": float(moved[0]),
            "u_std": float(stds[0]),
            "v": float(moved[1]),
            "v_std": float(stds[1]),
        }
        known = vars(mean)
        return values | {name: float(known[name]) for name in known if name != "points"}


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
