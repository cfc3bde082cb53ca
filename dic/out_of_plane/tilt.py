"""Separate strain from motion out of the plane in the displacement field that one camera measures.

A tilt with the slopes a, b causes an apparent displacement whose linear part looks like strain. The quadratic
part of this displacement, (a x² + b x y, a x y + b y²)/Cz, shows the tilt, because uniform strain has no
quadratic part. Bending, a gradient of the strain and a curvature of the specimen have quadratic or cubic
parts too. So the displacement field is reduced to a polynomial of third degree, and models of all these
causes are fitted to its 20 coefficients. The models are averaged by their evidence
(`dic.out_of_plane.evidence`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from dic.out_of_plane.causes import main_direction
from dic.out_of_plane.evidence import probabilities
from dic.out_of_plane.expectations import Expectations
from dic.out_of_plane.linearised import Linearised, ModelOutcome
from dic.out_of_plane.plane import Plane
from dic.out_of_plane.polynomial import Polynomial
from dic.out_of_plane.shift import Shift
from dic.typing import Float

_STEPS = 8
_CLOSE = 1e-7
"""The iteration for the specimen's plane ends when both slopes change by less than this."""

_ROUGH_PX = 0.002
"""Assumed smooth errors of real lenses and patterns, px, for fields that the usual errors do not explain."""

_STRANGE = 40.0
"""If the misfit is larger, the field has larger smooth errors than usual. The expected misfit is 14."""


@dataclass(frozen=True)
class TiltFit:
    """The motion of a specimen in tension, as far as one camera can measure it."""

    plane: Plane
    """Plane of the specimen's surface in the deformed image, relative to the surface in the reference."""
    plane_std: Float
    """Shape (3,). Standard deviations of the two slopes and of the shift, mm; NaN for the shift without a
    known hinge.
    """
    curvatures: Float
    """Shape (3,). Curvatures of the surface since the reference: along X, mixed, along Y; 1/mm."""
    gradient: Float
    """Shape (2, 2). Mean displacement gradient of the specimen."""
    parts: dict[str, Float]
    """Each of shape (4, 4). Covariances of the gradient's elements xx, xy, yx, yy by their cause: "images"
    and the names in `PARTS`.
    """
    mounting: Float
    """Shape (4, 3). Errors of the gradient's elements by the mounting; see `ModelOutcome.mounting`."""
    curved: float
    graded: float
    """Probability that the specimen bent out of its plane, and that its strain has a gradient."""
    misfit: float
    """Misfit of the best model; about 14 if the model is right."""
    residual_mm: Float
    """Shape (n, 2). The part of the displacements that a polynomial of third degree does not fit."""

    @property
    def slopes(self) -> Float:
        """The slopes of `plane`, shape (2,)."""
        return np.array([self.plane.slope_x, self.plane.slope_y])

    @property
    def covariance(self) -> Float:
        """Covariance of the gradient's elements, shape (4, 4)."""
        return np.asarray(np.sum(list(self.parts.values()), axis=0))


def fit_tilt(polynomial: Polynomial, poisson_ratio: float, shift: Shift) -> TiltFit:
    """Find the motion out of the plane and the strain that together explain a displacement field.

    `polynomial`: the displacement field of at least a few dozen points. `poisson_ratio`: Poisson's ratio of
    the specimen. `shift`: knowledge about the specimen's shift towards the camera.
    """
    fit = _fit(polynomial, poisson_ratio, shift)
    if fit.misfit > _STRANGE:
        fit = _fit(replace(polynomial, smooth_px=_ROUGH_PX), poisson_ratio, shift)
    return fit


def _fit(polynomial: Polynomial, poisson_ratio: float, shift: Shift) -> TiltFit:
    expected = Expectations.of(shift.std_mm, _half_width_mm(polynomial))
    outcomes: list[ModelOutcome] = []
    # The equations are linearised about a plane. Different kinds of models find different planes, so each
    # kind is solved about its own plane.
    for curved, graded in product((False, True), repeat=2):
        start = _mean_plane(outcomes, shift) if outcomes else Plane()
        kind = expected.only(curved=curved, graded=graded)
        for along in _directions(outcomes) if graded else [np.array([1.0, 0.0])]:
            found = _converged(start, kind, (polynomial, poisson_ratio, along), shift)
            outcomes += [o for o in found if not graded or o.stretched_along(along)]
    return _averaged(outcomes, shift, polynomial.residual_mm(_mean_plane(outcomes, shift)))


def _half_width_mm(polynomial: Polynomial) -> float:
    before_mm = polynomial.points.before_mm
    return float(np.abs(before_mm - before_mm.mean(axis=0)).max())


@dataclass(frozen=True)
class Suspicion:
    """Fits of strong causes to a field that no model explains; each cause may have any size."""

    misfit_bent: float
    misfit_graded: float
    """Misfit of a model with a curvature of any size, and of a model with a strain gradient of any size."""
    curvature_per_mm: float
    """Largest curvature out of the plane, if curvature is the cause."""
    gradient_per_mm: float
    """Gradient of the strain as a fraction of the strain, if the gradient is the cause."""


def suspect(polynomial: Polynomial, poisson_ratio: float, shift: Shift) -> Suspicion:
    """Find out whether one strong cause explains a field; the parameters are those of `fit_tilt`."""
    polynomial = replace(polynomial, smooth_px=_ROUGH_PX)
    expected = Expectations.of(shift.std_mm, _half_width_mm(polynomial)).wide()

    def found(kind: Expectations, along: Float) -> list[ModelOutcome]:
        return _converged(Plane(), kind, (polynomial, poisson_ratio, along), shift)

    bent = found(expected.only(curved=True, graded=False), np.array([1.0, 0.0]))
    of_gradient = expected.only(curved=False, graded=True)
    graded = [outcome for along in np.eye(2) for outcome in found(of_gradient, along)]
    best_bent, best_graded = (min(found, key=lambda o: o.misfit) for found in (bent, graded))
    xx, xy, yy = best_bent.curvatures
    largest = float(np.abs(np.linalg.eigvalsh([[xx, xy], [xy, yy]])).max())
    return Suspicion(best_bent.misfit, best_graded.misfit, largest, best_graded.relative_gradient)


def _directions(outcomes: Sequence[ModelOutcome]) -> list[Float]:
    """Return the directions in which the strain may have a gradient.

    Specimens are mostly stretched along an axis of the grid. The direction of the largest strain is another
    candidate. This direction is computed once and does not change while the plane is solved, because it would
    be wrong for a wrong plane. The caller drops a candidate if the strain along it is smaller than the strain
    across it.
    """
    best = max(outcomes, key=lambda outcome: outcome.log_evidence)
    return [*np.eye(2), main_direction(best.gradient.reshape(2, 2))]


def _converged(
    plane: Plane, kind: Expectations, equations: tuple[Polynomial, float, Float], shift: Shift
) -> list[ModelOutcome]:
    """Return the outcomes of one kind of models, linearised about the plane that these models give."""
    for _ in range(_STEPS):
        linear = Linearised.about(plane, *equations, shift.per_slope_mm)
        scaled = kind.scaled(linear.strain)
        models = linear.models(scaled)
        step = linear.mean_step(models)
        if np.abs(step).max() < _CLOSE:
            break
        plane = shift.plane(plane.slope_x + float(step[0]), plane.slope_y + float(step[1]))
    return linear.outcomes(models, scaled)


def _mean_plane(outcomes: Sequence[ModelOutcome], shift: Shift) -> Plane:
    share = probabilities(np.array([o.log_evidence for o in outcomes]))
    slopes = share @ np.array([o.slopes for o in outcomes])
    return shift.plane(float(slopes[0]), float(slopes[1]))


def _averaged(outcomes: Sequence[ModelOutcome], shift: Shift, residual_mm: Float) -> TiltFit:
    """Return the average of all outcomes, weighted by their evidence."""
    share = probabilities(np.array([o.log_evidence for o in outcomes]))
    slopes, slope_std, curvatures, gradient, mounting = (
        np.array([getattr(o, name) for o in outcomes])
        for name in ("slopes", "slope_std", "curvatures", "gradient", "mounting")
    )
    plane, mean = _mean_plane(outcomes, shift), share @ gradient
    parts = {
        name: np.einsum("k,kij->ij", share, np.array([o.parts[name] for o in outcomes]))
        for name in outcomes[0].parts
    }
    parts["model"] = parts["model"] + np.einsum("k,ki,kj->ij", share, gradient - mean, gradient - mean)
    variance = share @ (slope_std**2 + (slopes - share @ slopes) ** 2)
    slope_stds = np.sqrt(variance)
    return TiltFit(
        plane,
        np.array([*slope_stds, shift.plane_std_mm(slope_stds)]),
        share @ curvatures,
        mean.reshape(2, 2),
        parts,
        np.einsum("k,kij->ij", share, mounting),
        float(share @ [o.curved for o in outcomes]),
        float(share @ [o.graded for o in outcomes]),
        min(o.misfit for o in outcomes),
        residual_mm,
    )
