"""Estimate the tilts of the specimen and of the stage's axis from a rotation that one camera records.

A rotation about the grid's normal keeps the height of every point. So the calibrated motion between two steps
is exactly affine, and a tilt of the specimen looks the same as strain. However, a rigid specimen has no
strain. So four slopes are solved for the whole run, such that no step has strain: two slopes of the specimen
in the reference and two slopes of the stage's axis. The errors of the calibration are solved together with
the slopes, because a grid whose scales along X and Y differ also gives a rotating specimen false strain.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from dic.calibration.calibration import Calibration
from dic.correlation.settings import CorrelationSettings
from dic.files.lazy import Spool
from dic.out_of_plane.alignment import Alignment
from dic.out_of_plane.correction import by_centre
from dic.out_of_plane.map_errors import MapErrors
from dic.out_of_plane.smooth_motion import SmoothMotion
from dic.out_of_plane.specimen_bow import Bow
from dic.out_of_plane.uncertainty import Points
from dic.strain.fit import gradient_weights, slopes_of
from dic.typing import Float

PRIOR_SLOPE = np.tan(np.radians(1.0))
"""Prior standard deviation of the four slopes, which corresponds to 1°.

The prior matters only if the images do not determine the slopes, for example with a camera that looks
straight at the grid.
"""

_SYSTEMATIC = 0.3e-6
"""Standard deviation of strain errors without a model, such as interpolation errors of the spline."""

_UNKNOWN_HEIGHT = 0.1
"""Error of the camera's height, as a share of it, that counts as hardly known."""
_HELD = 1e12
"""Weight of an expectation that is not to change."""

_STEPS = 20
_SMALL = 1e-6
_CLOSE = 1e-8
_SETTLED = 3e-3
"""Changes of the slopes, and of the calibration's errors in standard deviations, that end the iteration."""


@dataclass(frozen=True)
class Steps:
    """The steps of a rotation, from which the alignment is solved."""

    motions: Spool[tuple[Float, Float]]
    """Shapes (n, 2). Calibrated positions of the points of each step before and after the motion, mm. The
    positions are not kept in memory.
    """
    smooth: list[SmoothMotion]
    """The same motions without noise, for derivatives."""
    noise: Float
    """Shape (steps, 4, 4). Covariance of the mean displacement gradient of each step that image noise causes.
    """
    of_maps: Float
    of_centre: Float
    """Shapes (steps, 4, q) and (3, q). Effect of q independent calibration errors with variance 1: on the
    gradients (`of_maps`), and on the camera's centre in mm (`of_centre`).
    """
    map_errors: MapErrors
    angles_deg: Float
    """Shape (steps,). Rotation of the specimen in each step since the reference image."""
    pivot_mm: Float
    """Shape (2,). X and Y of the centre of rotation."""
    systematic: float = _SYSTEMATIC
    """Standard deviation of the systematic strain errors of each step, which are all errors except noise."""
    bow: Bow | None = None
    """The bow of the specimen over its plane."""

    @classmethod
    def of(cls, points: Iterable[Points], systematic: float = _SYSTEMATIC) -> "Steps | None":
        """Return the steps, with the rotation angles and the pivot estimated from calibrated motions.

        The result is None if there is no step.
        """
        motions, smooth, noise, of_maps = Spool[tuple[Float, Float]](), [], [], []
        for step in points:
            motions.put(len(motions), (step.before_mm, step.after_mm))
            smooth.append(SmoothMotion.of(step.before_mm, step.after_mm))
            weights = gradient_weights(step.before_mm)
            noise.append(step.noise_covariance(weights))
            of_map, of_centre = step.calibration_factors(weights)
            of_maps.append(of_map)
            calibration = step.calibration
        if not noise:
            return None
        errors = np.array(noise), np.array(of_maps), of_centre
        return cls(
            motions, smooth, *errors, MapErrors.of(calibration), *_turns_and_pivot(motions), systematic
        )

    def seen_on(self, unknowns: Float, centre_mm: Float, *, rigid: bool) -> "Steps":
        """Return the same steps, with the angles and the centre of rotation measured in the specimen's plane.

        Of a rigid specimen the bow is measured too.

        `unknowns`: as for `gradients`. Angles from motions in the grid's
        plane have errors because of false strain. These errors would cause strain errors of about 1e-6.
        """
        angles_deg, pivot_mm = _turns_and_pivot(self._motions(unknowns, centre_mm))
        seen = replace(self, angles_deg=angles_deg, pivot_mm=pivot_mm, bow=None)
        return replace(seen, bow=Bow.fitted(seen._motions(unknowns, centre_mm), centre_mm)) if rigid else seen

    def gradients(self, unknowns: Float, centre_mm: Float) -> Float:
        """Return the mean displacement gradients within the specimen's plane, shape (steps, 2, 2).

        `unknowns`, shape (4 + q,): the four slopes, and the sizes of the calibration's errors.
        """
        return np.array([slopes_of(b, a - b) for b, a in self._motions(unknowns, centre_mm)])

    def by_unknowns(self, unknowns: Float, centre_mm: Float) -> Float:
        """Return the derivative (steps, 4, 4 + q) of the mean gradients with respect to the unknowns."""
        steps = zip(self.smooth, self.angles_deg, strict=True)
        derivative = np.array([self._by_unknowns(*step, unknowns, centre_mm) for step in steps])
        derivative[:, :, 4:] += self.of_maps
        return derivative

    def _by_unknowns(
        self, smooth: SmoothMotion, angle_deg: float, unknowns: Float, centre_mm: Float
    ) -> Float:
        def gradient(slopes: Float, centre: Float) -> Float:
            seen = self._seen(smooth.places, angle_deg, np.append(slopes, unknowns[4:]), centre)
            return smooth.gradient(*seen).ravel()

        slopes = unknowns[:4]
        by_slope = [
            (gradient(slopes + step, centre_mm) - gradient(slopes - step, centre_mm)) / (2 * _SMALL)
            for step in _SMALL * np.eye(4)
        ]
        through = by_centre(partial(gradient, slopes), centre_mm) @ self.of_centre
        return np.column_stack([np.stack(by_slope, axis=-1), through])

    def _motions(self, unknowns: Float, centre_mm: Float) -> Iterator[tuple[Float, Float]]:
        """Yield for each step the positions within the specimen's plane before and after the motion."""
        for motion, angle in zip(self.motions, self.angles_deg, strict=True):
            yield self._seen(motion, angle, unknowns, centre_mm)

    def _seen(
        self, motion: tuple[Float, Float], angle_deg: float, unknowns: Float, centre_mm: Float
    ) -> tuple[Float, Float]:
        """Return positions (n, 2) within the specimen's plane, for calibrated ones before and after it."""
        slopes, sources = unknowns[:4], unknowns[4:]
        moved_mm = centre_mm + self.of_centre @ sources
        alignment = Alignment(slopes, np.zeros((4, 4)), self.pivot_mm)
        before, after = (self.map_errors.adjusted(position, sources) for position in motion)
        plane, turned_plane = alignment.before, alignment.after(angle_deg)
        places = plane.within(before, moved_mm), turned_plane.within(after, moved_mm)
        return places if self.bow is None else self.bow.seen_flat(*places, moved_mm)

    def by_bow(self, unknowns: Float, centre_mm: Float) -> Float:
        """Return the effect (steps, 4, k) of k independent errors of the bow, with variance 1."""
        if self.bow is None:
            return np.zeros((len(self.of_maps), 4, 0))
        at, bow = self.gradients(unknowns, centre_mm), self.bow
        values, vectors = np.linalg.eigh(bow.covariance)
        changed = [
            replace(self, bow=replace(bow, curvature_per_mm=bow.curvature_per_mm + change))
            for change in (vectors * np.sqrt(np.maximum(values, 0.0))).T
        ]
        effects = [steps.gradients(unknowns, centre_mm) - at for steps in changed]
        return np.stack(effects, axis=-1).reshape(len(at), 4, -1)

    def strains(self, unknowns: Float, centre_mm: Float) -> Float:
        """Return the mean Green-Lagrange strains xx, yy, xy of all steps in one array, shape (3 steps,)."""
        return _strains(self.gradients(unknowns, centre_mm))


def systematic_strain(settings: CorrelationSettings, calibration: Calibration) -> float:
    """Return the standard deviation of the systematic strain errors of a rotated specimen.

    Systematic errors are all errors except noise. Perspective makes the displacement within a subset
    non-affine. An affine subset of width s measures the mean displacement. The mean displacement differs from
    the displacement at the subset's centre by s²/24 times the Laplacian of the displacement. So the measured
    strain has an error of s²/24 times third derivatives of the displacement. Perspective changes the scale
    per pixel by the fraction g = sin θ / f, where θ is the off-axis angle and f is the focal length. For a
    rotated plane, the third derivatives are at most 6 g², and 3 g² is typical. Quadratic shape functions do
    not have this systematic error.
    """
    if settings.shape != "affine" or calibration.pinhole is None:
        return _SYSTEMATIC
    g = np.sin(np.radians(calibration.pinhole.off_axis_deg)) / calibration.pinhole.focal_px
    return float(np.hypot(_SYSTEMATIC, settings.subset_px**2 / 8 * g**2))


def _turns_and_pivot(motions: Iterable[tuple[Float, Float]]) -> tuple[Float, Float]:
    """Return the rotation angles (steps,) in degrees, and the centre of rotation (2,)."""
    found = [(slopes_of(b, a - b), b.mean(axis=0), a.mean(axis=0)) for b, a in motions]
    F = np.array([gradient for gradient, _, _ in found]) + np.eye(2)
    angles_deg = np.degrees(np.arctan2(F[:, 1, 0] - F[:, 0, 1], F[:, 0, 0] + F[:, 1, 1]))
    turns = _turns(angles_deg)
    # The pivot x does not move, so x = after + R (x - before).
    sides = [after - R @ before for (_, before, after), R in zip(found, turns, strict=True)]
    pivot = np.linalg.lstsq(np.concatenate(np.eye(2) - turns), np.concatenate(sides), rcond=None)[0]
    return angles_deg, pivot


def _strains(gradients: Float) -> Float:
    F = gradients + np.eye(2)
    E = (np.swapaxes(F, 1, 2) @ F - np.eye(2)) / 2
    return np.stack([E[:, 0, 0], E[:, 1, 1], E[:, 0, 1]], axis=1).ravel()


def by_gradient(gradient: Float) -> Float:
    """Return the derivative (3, 4) of the Green-Lagrange strains xx, yy, xy with respect to the gradient."""
    F = gradient + np.eye(2)
    return np.array(
        [
            [F[0, 0], 0.0, F[1, 0], 0.0],
            [0.0, F[0, 1], 0.0, F[1, 1]],
            [F[0, 1] / 2, F[0, 0] / 2, F[1, 1] / 2, F[1, 0] / 2],
        ]
    )


@dataclass(frozen=True)
class StepErrors:
    """Errors of the values of all steps: an independent part for each step, and a part that all steps share.

    The covariance matrix of all values would grow with the square of the number of steps. The two parts grow
    only in proportion to this number.
    """

    own: Float
    """Shape (steps, m, m). Covariance of the m values of each step, caused by errors that no other step has.
    """
    shared: Float
    """Shape (steps, m, q). Effect of q independent errors of variance 1, which are the same in all steps."""

    def mapped(self, by: Float) -> "StepErrors":
        """Return the errors of linear functions of each step's values; `by` has the shape (steps, k, m)."""
        return StepErrors(by @ self.own @ np.swapaxes(by, 1, 2), by @ self.shared)

    def and_shared(self, shared: Float) -> "StepErrors":
        """Return the errors with further errors (steps, m, q) that are the same in all steps."""
        return StepErrors(self.own, np.concatenate([self.shared, shared], axis=2))

    def solve(self, right: Float) -> Float:
        """Return the inverse of the covariance of all values, times `right` with the shape (m steps, n).

        The inverse follows from the parts by the formula of Sherman, Morrison and Woodbury.
        """
        sides = right.reshape(*self.own.shape[:2], -1)
        alone, of_shared = np.linalg.solve(self.own, sides), np.linalg.solve(self.own, self.shared)
        inner = np.eye(self.shared.shape[2]) + np.einsum("kil,kim->lm", self.shared, of_shared)
        through = np.linalg.solve(inner, np.einsum("kil,kin->ln", self.shared, alone))
        return np.asarray((alone - of_shared @ through).reshape(right.shape))


def gradient_errors(steps: Steps) -> StepErrors:
    """Return the errors of the mean displacement gradients of all steps by noise and systematic errors.

    Half of each step's noise variance comes from the reference image. Noise of the reference image shifts the
    material points whose motion all steps measure. So half of the noise variance is common to all steps, and
    this common noise rotates with the specimen. Errors of the calibration are not included.
    """
    turns = np.kron(_turns(steps.angles_deg), np.eye(2))
    own = steps.noise / 2
    reference = (np.swapaxes(turns, 1, 2) @ own @ turns).mean(axis=0)
    values, vectors = np.linalg.eigh(reference)
    shared = turns @ (vectors * np.sqrt(np.maximum(values, 0.0)))
    return StepErrors(own + steps.systematic**2 * np.eye(4), shared)


def _turns(angles_deg: Float) -> Float:
    """Return the rotation matrices of the steps, shape (steps, 2, 2); angles are positive from X to Y."""
    c, s = np.cos(np.radians(angles_deg)), np.sin(np.radians(angles_deg))
    return np.moveaxis(np.array([[c, -s], [s, c]]), -1, 0)


@dataclass(frozen=True)
class RigidSolution:
    """The unknowns for which a rotated specimen has no strain."""

    unknowns: Float
    """Shape (4 + q,). The four slopes of an `Alignment`, then the sizes of the calibration's errors."""
    gain: Float
    """Shape (4 + q, 3 steps). Derivative by errors of the strains, with the opposite sign."""
    by_prior: Float
    """Shape (4 + q, 4 + q). Covariance of the unknowns that comes from their prior alone."""


def solve_rigid(
    steps: Steps, centre_mm: Float, errors: StepErrors, start: Float | None = None
) -> RigidSolution | None:
    """Find the slopes, and the errors of the calibration, for which no strain remains (least squares).

    `centre_mm`, shape (3,): the camera's centre in the grid's axes. `errors`: errors of the mean strains,
    without those of the calibration. `start`: start values of the unknowns. The default is 0.

    The function returns None if the iteration does not converge.
    """
    count = 4 + steps.of_maps.shape[2]
    unknowns = np.zeros(count) if start is None else start
    expected = np.array([*4 * [1 / PRIOR_SLOPE**2], *(count - 4) * [1.0]])
    # The effect of a distance that is hardly known is not linear. Such an error is not solved.
    held = np.append(np.zeros(4, bool), np.abs(steps.of_centre[2]) > _UNKNOWN_HEIGHT * centre_mm[2])
    prior = np.diag(np.where(held, _HELD, expected))
    for _ in range(_STEPS):
        gradients = steps.gradients(unknowns, centre_mm)
        strains = _strains(gradients)
        to_strain = np.array([by_gradient(gradient) for gradient in gradients])
        slopes = (to_strain @ steps.by_unknowns(unknowns, centre_mm)).reshape(len(strains), -1)
        weighted = errors.solve(slopes).T
        covariance = np.linalg.inv(weighted @ slopes + prior)
        gain = covariance @ weighted
        # The prior expects the unknowns near 0. So it must act on them, and not on their change in a step.
        step = gain @ (slopes @ unknowns - strains) - unknowns
        unknowns = unknowns + step
        if np.abs(step[:4]).max() < _CLOSE and np.abs(step[4:]).max(initial=0.0) < _SETTLED:
            of_held = gain @ slopes[:, held] - np.eye(count)[:, held]
            by_prior = covariance @ np.diag(np.where(held, 0.0, expected)) @ covariance
            return RigidSolution(unknowns, gain, by_prior + of_held @ of_held.T)
    return None
