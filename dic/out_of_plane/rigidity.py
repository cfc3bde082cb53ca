"""Correct the strains of a rotated specimen with the alignment of the rotation stage.

The alignment is either given, or solved from the steps of the rotation.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from dic.calibration.calibration import Calibration
from dic.files.lazy import Computed
from dic.out_of_plane.alignment import Alignment
from dic.out_of_plane.correction import Correction, points_of
from dic.out_of_plane.plane import moved_out_of_plane
from dic.out_of_plane.reasons import not_rigid_reason
from dic.out_of_plane.rotation import (
    StepErrors,
    Steps,
    by_gradient,
    gradient_errors,
    solve_rigid,
    systematic_strain,
)
from dic.out_of_plane.uncertainty import Points, block_diagonal
from dic.strain.measurement import Measurement
from dic.strain.strain import strain_of_gradient
from dic.typing import Float

_FEWEST_POINTS = 30
_FEWEST_STEPS = 2
_LEAST_TURN_DEG = 5.0
_SMALL = 1e-6
_ROUNDS = 3
"""Rounds in which the angles and the bow are measured in the plane that was found."""
_RIGID = 5.0
"""The specimen counts as rigid if the remaining strain (rms) is at most this many standard deviations."""


@dataclass(frozen=True)
class RotationCorrection:
    """The corrections of all images of a rotation, in order, and the stage's alignment, or None."""

    corrections: Sequence[Correction]
    alignment: Alignment | None = None


def correct_rotation(
    measurements: Sequence[Measurement], calibration: Calibration, alignment: Alignment | None = None
) -> RotationCorrection:
    """Correct the images of a rotated specimen for the specimen's wobble and for the tilt of the grid.

    If the images cannot be corrected, the result keeps the calibrated strains and gives the reason.

    `measurements`: calibrated measurements with the same reference. `calibration`: calibration of the camera.
    `alignment`: alignment from an earlier rotation on the same fixture. If an alignment is given, the rotated
    specimen need not be free of strain.
    """
    method = "rigidity" if alignment is None else "alignment"

    def refused(reason: str) -> RotationCorrection:
        return RotationCorrection(
            Computed(len(measurements), lambda k: Correction.refused(method, measurements[k], reason))
        )

    if calibration.pinhole is None:
        return refused("the calibration knows no camera centre")
    usable: list[int] = []
    steps = Steps.of(
        _usable_points(measurements, calibration, usable), _systematic(measurements, calibration)
    )
    if steps is None:
        return refused(f"no image has {_FEWEST_POINTS} points")
    centre_mm = calibration.pinhole.centre_mm
    if alignment is not None:
        solved: _Solved | None = _Solved.known(steps, centre_mm, alignment)
    else:
        objection = _objection(steps)
        if objection is not None:
            return refused(objection)
        solved = _Solved.from_steps(steps, centre_mm)
        objection = _not_rigid(solved, steps, centre_mm)
        if objection is not None:
            return refused(objection)
    if solved is None:
        return refused("unsolved")
    found, places = solved, {k: place for place, k in enumerate(usable)}

    def correction(k: int) -> Correction:
        if k not in places:
            return Correction.refused(method, measurements[k], f"fewer than {_FEWEST_POINTS} points")
        return found.correction(places[k], measurements[k], calibration)

    return RotationCorrection(Computed(len(measurements), correction), found.alignment)


def _usable_points(
    measurements: Sequence[Measurement], calibration: Calibration, usable: list[int]
) -> Iterator[Points]:
    """Yield the points of each measurement that has enough points, and append its index to `usable`."""
    for k, measurement in enumerate(measurements):
        mean = measurement.calibrated_mean
        if mean is not None and mean.points >= _FEWEST_POINTS and np.isfinite(mean.exx):
            usable.append(k)
            yield points_of(measurement, calibration)


def _systematic(measurements: Sequence[Measurement], calibration: Calibration) -> float:
    return max((systematic_strain(m.settings, calibration) for m in measurements[:1]), default=0.0)


def _objection(steps: Steps) -> str | None:
    if len(steps.motions) < _FEWEST_STEPS:
        return f"at least {_FEWEST_STEPS} images of a rotation are needed"
    if np.abs(steps.angles_deg).max() < _LEAST_TURN_DEG:
        return f"the specimen turned by less than {_LEAST_TURN_DEG:g}°, too little to measure its tilt"
    return None


def _not_rigid(solved: "_Solved | None", steps: Steps, centre_mm: Float) -> str | None:
    if solved is None:
        nothing = np.zeros(4 + steps.of_maps.shape[2])
        micro = 1e6 * np.abs(steps.strains(nothing, centre_mm)).max()
        return (
            f"no alignment explains strain of up to {micro:.0f} µε: the camera looks too straight on to "
            "measure tilts, the specimen was strained, or the calibration belongs to another camera"
        )
    left = solved.strain_left()
    if left > _RIGID:
        calibrated, remaining = (
            steps.strains(slopes, centre_mm).reshape(-1, 3)
            for slopes in (0 * solved.unknowns, solved.unknowns)
        )
        return not_rigid_reason(left, calibrated, remaining, steps.angles_deg, centre_mm)
    return None


@dataclass(frozen=True)
class _Solved:
    """The alignment of a rotation stage, and the steps of the rotation that are corrected with it."""

    method: str
    steps: Steps
    centre_mm: Float
    alignment: Alignment
    unknowns: Float
    """Shape (4 + q,). The four slopes, and the sizes of the calibration's errors."""
    gradients: Float
    """Shape (steps, 2, 2). Corrected displacement gradients."""
    covariance: Float
    """Shape (steps, 4, 4). Covariance of the elements of each corrected displacement gradient."""

    @classmethod
    def from_steps(cls, steps: Steps, centre_mm: Float) -> "_Solved | None":
        """Solve the alignment from the steps of a rotation; return None if there is no solution."""
        unknowns = np.zeros(4 + steps.of_maps.shape[2])
        to_strain = _to_strain(steps.gradients(unknowns, centre_mm))
        for _ in range(_ROUNDS):
            steps = steps.seen_on(unknowns, centre_mm, rigid=True)
            noise = gradient_errors(steps).and_shared(steps.by_bow(unknowns, centre_mm))
            found = solve_rigid(steps, centre_mm, noise.mapped(to_strain), unknowns)
            if found is None:
                return None
            solution, unknowns = found, found.unknowns
        # The errors of the unknowns come from the measured strains, and from the prior.
        by_step = -np.swapaxes(solution.gain.reshape(len(solution.gain), -1, 3), 0, 1) @ to_strain
        errors = _UnknownErrors(by_step, solution.by_prior)
        covariance, of_all = errors.with_gradients(steps, solution.unknowns, centre_mm, noise)
        alignment = Alignment(solution.unknowns[:4], of_all[:4, :4], steps.pivot_mm)
        gradients = steps.gradients(solution.unknowns, centre_mm)
        return cls("rigidity", steps, centre_mm, alignment, solution.unknowns, gradients, covariance)

    @classmethod
    def known(cls, steps: Steps, centre_mm: Float, alignment: Alignment) -> "_Solved":
        """Apply a given alignment to the steps of a rotation."""
        count = steps.of_maps.shape[2]
        unknowns = np.append(alignment.slopes, np.zeros(count))
        steps = steps.seen_on(unknowns, centre_mm, rigid=False)
        prior = block_diagonal([alignment.covariance, np.eye(count)])
        errors = _UnknownErrors(np.zeros((len(steps.motions), 4 + count, 4)), prior)
        covariance, _ = errors.with_gradients(steps, unknowns, centre_mm, gradient_errors(steps))
        gradients = steps.gradients(unknowns, centre_mm)
        return cls("alignment", steps, centre_mm, alignment, unknowns, gradients, covariance)

    def strain_left(self) -> float:
        """Return the strain that remains after correction, as a root mean square in standard deviations."""
        to_strain = _to_strain(self.gradients)
        std = np.sqrt(np.einsum("kij,kjl,kil->ki", to_strain, self.covariance, to_strain)).ravel()
        strains = self.steps.strains(self.unknowns, self.centre_mm)
        return float(np.sqrt(np.mean((strains / std) ** 2)))

    def correction(self, place: int, measurement: Measurement, calibration: Calibration) -> Correction:
        """Return the correction of the step with the index `place`."""
        points, sources = points_of(measurement, calibration), self.unknowns[4:]
        centre_mm = self.centre_mm + self.steps.of_centre @ sources
        before, after = self.alignment.before, self.alignment.after(self.steps.angles_deg[place])
        settings, n = measurement.strain_settings, len(points.before_mm)
        mean = strain_of_gradient(self.gradients[place], self.covariance[place], n, settings.measure)
        moved = moved_out_of_plane(points.adjusted(sources), centre_mm, before, after)
        if self.steps.bow is not None:
            moved = self.steps.bow.flattened(moved, centre_mm)
        std = self.alignment.after_std(self.steps.angles_deg[place])
        return Correction(self.method, mean, moved, settings, after, np.array([*std, np.nan]))


def _to_strain(gradients: Float) -> Float:
    """Return the derivative (steps, 3, 4) of each step's strains xx, yy, xy with respect to its gradient."""
    return np.array([by_gradient(G) for G in gradients])


@dataclass(frozen=True)
class _UnknownErrors:
    """The effect of errors of the input on the four slopes and on the errors of the calibration."""

    by_step: Float
    """Shape (steps, 4 + q, 4). Derivative of the unknowns with respect to the measured gradient of each step.
    """
    prior: Float
    """Shape (4 + q, 4 + q). Covariance of the unknowns that does not come from errors of the steps."""

    def with_gradients(
        self, steps: Steps, unknowns: Float, centre_mm: Float, noise: StepErrors
    ) -> tuple[Float, Float]:
        """Return the covariance of each corrected gradient (steps, 4, 4), and that of the unknowns.

        The corrected gradient of a step has the error of its measured gradient, and the errors of the
        unknowns, to which all steps contribute.
        """
        own, by_step, by_unknown = noise.own, self.by_step, steps.by_unknowns(unknowns, centre_mm)
        # Independent errors of a step change its gradient directly, and also through the unknowns.
        through = by_step @ own
        total = self.prior + (through @ np.swapaxes(by_step, 1, 2)).sum(axis=0)
        both = by_unknown @ through
        covariance = own + both + np.swapaxes(both, 1, 2)
        covariance += by_unknown @ total @ np.swapaxes(by_unknown, 1, 2)
        # All steps share the noise of the reference image.
        of_unknowns = (by_step @ noise.shared).sum(axis=0)
        whole = noise.shared + by_unknown @ of_unknowns
        return covariance + whole @ np.swapaxes(whole, 1, 2), total + of_unknowns @ of_unknowns.T
