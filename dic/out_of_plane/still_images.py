"""Estimate from still images the errors of displacements that the noise of the images does not explain.

Still images show the undeformed specimen before the test, so their displacements from the reference are
errors. Haze, vibration, and a camera that sags or warms up cause smooth displacements, which strain and the
correction of a tilt mistake for those of the specimen. One or two images determine the variance of such
errors only roughly. So the variance is averaged over its posterior distribution, with a prior of one half for
no such errors, and otherwise equal probability of all orders of magnitude. If the errors are clear, this mean
is that of Student's distribution, whose variance is larger than the mean square of the few samples.

With two or more images, a drift in proportion to the time is another possible cause. If it is probable, the
errors of later images grow with the time since the reference.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dic.calibration.calibration import Calibration
from dic.out_of_plane.correction import points_of
from dic.out_of_plane.uncertainty import Points, weighted_sums
from dic.strain.measurement import Measurement
from dic.strain.still import COEFFICIENTS, StillErrors, orthogonal_polynomials
from dic.typing import Float

_GRID = np.append(0.0, np.geomspace(0.05, 1e8, 75))
"""Possible variances of the errors, divided by the variance that the images' noise causes."""

_DRIFTS = 0.8
"""Least probability of a drift with which it is assumed."""

_FURTHER = 0.1
"""Expected size of the drifts of second and third degree, relative to that of strain.

A scale that drifts has such a part for an off-axis camera, and its quadratic part looks like a tilt.
"""


def still_errors(
    stills: Sequence[tuple[Measurement, float]], calibration: Calibration | None, *, in_seconds: bool
) -> StillErrors | None:
    """Return the errors that still images show, or None if no image can be used.

    `stills`: the measurement of each still image, and its time since the reference; NaN if it is not known.
    `calibration`: calibration of the camera. `in_seconds`: as in `StillErrors`.
    """
    if calibration is None:
        return None
    found = [(points_of(still, calibration), elapsed) for still, elapsed in stills]
    usable = [(p, t) for p, t in found if p.displacement.noise is not None and p.determine(3)]
    if not usable:
        return None
    seen = [_coefficients(points) for points, _ in usable]
    times = np.array([elapsed for _, elapsed in usable])
    sizes, noises = (np.array([each[k] for each in seen]) for k in (0, 1))
    parts = [
        _Posterior.of(sizes[:, of_degree].T, noises[:, of_degree].mean(axis=0), times)
        for of_degree in (slice(0, 3), slice(3, 9), slice(9, 17))
    ]
    rest_mm = float(np.sqrt(np.mean([rest**2 for _, _, rest in seen])))
    known: dict[str, Any] = {"in_seconds": in_seconds, "rest_mm": rest_mm}
    if parts[0].drift_probability < _DRIFTS:
        third, second, first = (part.without_drift() for part in parts[::-1])
        # Errors that vary slowly over the field are the larger, the lower the degree is.
        scatter_mm2 = max(first, second, third), max(second, third), third
        return StillErrors(len(usable), scatter_mm2, **known)
    drifts = [parts[0].with_drift()]
    size_mm = _FURTHER * float(np.linalg.norm(drifts[0][1]))
    drifts += [part.with_drift(size_mm) for part in parts[1:]]
    scatter_mm2, *drift = zip(*drifts, strict=True)
    drift_mm, drift_mm2 = (tuple(np.concatenate(each).tolist()) for each in drift)
    return StillErrors(len(usable), scatter_mm2, drift_mm, drift_mm2, **known)


def _coefficients(points: Points) -> tuple[Float, Float, float]:
    """Return the coefficients of `COEFFICIENTS`, and their variances by noise.

    The third value is the root mean square of the displacements, without noise, beyond the third degree.
    """
    basis = orthogonal_polynomials(points.before_mm)
    count = len(basis)
    weights = np.zeros((count, 2, 20))
    weights[:, 0, :10] = weights[:, 1, 10:] = basis / count
    moved = points.after_mm - points.before_mm
    sums = weighted_sums(weights, moved)
    covariance = points.noise_covariance(weights) + points.smooth_covariance(weights, 3)
    residual = moved - (basis @ sums.reshape(2, 10).T)
    noise = points.displacement.noise
    by_noise = 0.0 if noise is None else float((noise.factors[points.use] ** 2).sum(axis=(1, 2)).mean())
    rest = max(float((residual**2).sum(axis=1).mean()) - by_noise, 0.0)
    noises = np.diag(COEFFICIENTS @ covariance @ COEFFICIENTS.T)
    return COEFFICIENTS @ sums, noises, float(np.sqrt(rest))


@dataclass(frozen=True)
class _Posterior:
    """The probabilities of the variances of scatter (rows) and drift (columns) of several coefficients."""

    share: Float
    grid: Float
    along: Float
    """Shape (k,). The part of the coefficients that is proportional to the time, in a unit of the span."""
    scatter: Float
    total: Float
    span: float

    @classmethod
    def of(cls, sizes: Float, noises: Float, times: Float) -> "_Posterior":
        """Return the probabilities for coefficients (k, n), their variances by noise (k,) and times (n,)."""
        count, span = len(times), float(np.linalg.norm(times))
        can_drift = span > 0.0 and len(set(times.tolist())) > 1
        ahead = times / span if can_drift else np.full(count, count**-0.5)
        along = sizes @ ahead
        rest = np.maximum((sizes**2).sum(axis=1) - along**2, 0.0)
        grid = _GRID * noises.mean()
        scatter = noises + grid[:, None, None]
        total = scatter + (grid if can_drift else grid[:1])[None, :, None]
        likely = -0.5 * (np.log(total) + along**2 / total + (count - 1) * np.log(scatter) + rest / scatter)
        likely = likely.sum(axis=2)
        prior = np.append(0.5, np.full(len(_GRID) - 1, 0.5 / (len(_GRID) - 1)))
        share = np.exp(likely - likely.max()) * np.outer(prior, prior)[:, : likely.shape[1]]
        return cls(share / share.sum(), grid, along, scatter, total, span)

    @property
    def drift_probability(self) -> float:
        """Probability of a drift."""
        return float(self.share[:, 1:].sum())

    def without_drift(self) -> float:
        """Return the mean variance of the scatter if there is no drift."""
        return float(self.share[:, 0] @ self.grid / self.share[:, 0].sum())

    def with_drift(self, size_mm: float | None = None) -> tuple[float, Float, Float]:
        """Return the mean variance of the scatter if there is a drift.

        The further results are the drift of each coefficient in a unit of time, and its variance.

        `size_mm`: expected size of the drifts in a unit of time, if it is known.
        """
        share, scatter = self.share.copy(), self.scatter
        share[:, 0] = 0.0
        if size_mm is not None:
            near = 1 + int(np.argmin(np.abs(np.log(self.grid[1:] / (size_mm * self.span) ** 2))))
            share[:, np.arange(len(self.grid)) != near] = 0.0
        share /= share.sum()
        kept = 1.0 - scatter / self.total
        drift = np.einsum("gh,ghk->k", share, kept) * self.along
        known = np.einsum("gh,ghk->k", share, kept * scatter + (kept * self.along - drift) ** 2)
        return float(share.sum(axis=1) @ self.grid), drift / self.span, known / self.span**2
