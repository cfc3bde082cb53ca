"""The inverse compositional Gauss-Newton method (IC-GN) for one point.

The method minimises the zero-mean normalised sum of squared differences (ZNSSD). The sources are:

- IC-GN: S. Baker, I. Matthews, "Equivalence and efficiency of image alignment algorithms", IEEE Conference on
  Computer Vision and Pattern Recognition (2001) 1090-1097.
- ZNSSD: B. Pan, K. Li, W. Tong, "Fast, robust and accurate digital image correlation calculation without
  redundant computations", Experimental Mechanics 53 (2013) 1277-1289.
- Quadratic shape functions: Y. Gao et al., "High-efficiency and high-accuracy digital image correlation for
  three-dimensional measurement", Optics and Lasers in Engineering 65 (2015) 73-80.

docs/kernel.md derives every formula here, with the symbols of the papers.
"""

import math

import numpy as np

from dic.correlation.kernel import cholesky, sums as m
from dic.correlation.kernel.jit import inlined, inner
from dic.correlation.kernel.layout import Deformed, Flat, KernelReference
from dic.correlation.kernel.method import NOT_LAID, ROOM_PX, Method, Subset
from dic.correlation.kernel.moments import moments_with_image
from dic.correlation.kernel.prepared import prepare, recall, rounding_share
from dic.correlation.kernel.records import FX_FX, MEAN, NORM2
from dic.correlation.kernel.uncertainty import write_std
from dic.correlation.kernel.warps import (
    FACTOR,
    POWER_X,
    POWER_Y,
    SIDE,
    compose_inverse,
    compose_inverse_quadratic,
    in_view,
    is_laid,
    is_smooth,
    monomial,
    step_length_px,
)
from dic.correlation.kernel.workspace import Workspace
from dic.correlation.status import Status
from dic.typing import Float

CONVERGED, NO_TEXTURE = int(Status.CONVERGED), int(Status.NO_TEXTURE)
OUT_OF_VIEW, NOT_CONVERGED = int(Status.OUT_OF_VIEW), int(Status.NOT_CONVERGED)
LOW_CORRELATION = int(Status.LOW_CORRELATION)

_FAR_PX = 0.5
"""Limit for a quadratic step: a longer step is replaced by an affine step, or shortened to this length."""

_STILL_PX = 0.1
"""Limit for an affine step: a shorter step brings a quadratic warp hardly nearer to its optimum."""

_LONGER, _BACK = 1.25, 0.1
"""Largest factor by which a step is lengthened, and the part of it by which it may then be too long.

Residuals that are no noise, such as those of a change of light, lengthen steps too much.
"""


@inner
def correlate_point(
    image: KernelReference,
    deformed: Deformed,
    method: Method,
    subset: Subset,
    p: Float,
    std: Float,
    record: Flat,
    known: bool,
    work: Workspace,
) -> tuple[int, float, int]:
    """Improve the warp `p` of one point in place; return its status, ZNCC and number of iterations.

    The status is `NOT_LAID` if the rows around the first guess are not laid; the point can then be tried
    again with more rows. The standard deviations of the first six warp parameters are written into `std`.
    If `known` is False, the data of the reference's subset are computed and written into `record`. If `known`
    is True, `record` already holds these data from an earlier image.
    """
    if not known:
        prepare(image, method.shape, subset, work, record)
    recall(record, work)
    if not record[NORM2] > 0.0:
        return NO_TEXTURE, np.nan, 0
    r, zncc, length, power, longer = subset.radius, np.nan, 0.0, 0.0, True
    for iteration in range(1, method.max_iterations + 1):
        if not in_view(deformed, subset, p):
            return OUT_OF_VIEW, np.nan, iteration
        if not is_laid(deformed, subset, p, ROOM_PX if iteration == 1 else 0):
            return (NOT_LAID if iteration == 1 else NOT_CONVERGED), np.nan, iteration
        for i in range(len(p)):
            work.q[i] = p[i]
        moments_with_image(
            image, deformed, method.taps, method.shape, subset, work.q, is_smooth(p, r), work.rows, work.S
        )
        has_contrast, zncc = _compare(record, subset, work)
        if not has_contrast:
            return LOW_CORRELATION, np.nan, iteration
        # The right-hand side points back along the last step if this step was too long.
        longer &= not (power > 0.0 and _along_step(work) < -_BACK * power)
        last = length
        length, power = _step(method, subset, record, p, zncc, longer, work)
        if not length < 2.0 * r:
            return NOT_CONVERGED, zncc, iteration
        rate = length / last
        # Near the solution each step is a nearly constant fraction (the rate) of the step before. So the rate
        # predicts the sum of all later steps.
        if length < method.tolerance_px or (
            rate < 0.5 and length * rate / (1.0 - rate) < method.tolerance_px
        ):
            write_std(record, work.H, method, subset, p, zncc, work.d, std)
            return (CONVERGED if zncc >= method.min_zncc else LOW_CORRELATION), zncc, iteration
    return NOT_CONVERGED, zncc, method.max_iterations


@inlined
def _compare(record: Flat, subset: Subset, work: Workspace) -> tuple[bool, float]:
    """Compute the right-hand side of the normal equations; return whether there is contrast, and the ZNCC.

    Contrast means that the grey levels g of the deformed image vary within the warped subset.
    """
    S, s, t = work.S, work.s, work.t
    mean, norm2 = record[MEAN], record[NORM2]
    g_mean = S[m.G] / subset.pixels
    g_norm2 = S[m.GG] - S[m.G] * g_mean
    if not g_norm2 > rounding_share(subset.radius) * S[m.GG]:
        return False, np.nan
    gain = math.sqrt(norm2 / g_norm2)
    for i in range(len(s)):
        k = monomial(POWER_X[i], POWER_Y[i]) + 6 * SIDE[i]
        work.b[i] = gain * (FACTOR[i] * S[m.FX_G + k] - g_mean * s[i]) - t[i]
    return True, (S[m.FG] - mean * S[m.G]) * gain / norm2


@inlined
def _step(
    method: Method, subset: Subset, record: Flat, p: Float, zncc: float, longer: bool, work: Workspace
) -> tuple[float, float]:
    """Solve the normal equations, and compose `p` with the inverse of the step.

    Return the step's length, px, and of a short step its product with the right-hand side, otherwise 0.

    A long step of a quadratic warp is replaced by a step of the affine parameters, the first half of the
    parameters. The Cholesky factor for the affine parameters is the leading block of the Cholesky factor for
    all parameters. If the affine parameters are already at their optimum, the long step is shortened instead.
    The reason is that large second derivatives can put the affine optimum farther than `_FAR_PX` from the
    quadratic optimum. With affine steps alone, the iteration would never leave the affine optimum.

    If `longer` is True, a short step is lengthened by what the noise of the reference's derivatives has
    shortened it.
    """
    n, d, r, power = len(work.b), work.d, subset.radius, 0.0
    cholesky.solve(work.H, work.b, n, d)
    length = step_length_px(d, r)
    if length <= _FAR_PX:
        if longer:
            _lengthen(method, subset, record, zncc, work)
            length = step_length_px(d, r)
        power = _along_step(work)
    elif len(method.shape) == 12:
        # The constant 6 instead of n // 2 would give slower machine code.
        cholesky.solve(work.H, work.b, n // 2, d)
        if step_length_px(d, r) < _STILL_PX:
            cholesky.solve(work.H, work.b, n, d)
            for i in range(n):
                d[i] *= _FAR_PX / length
    if len(method.shape) == 12:
        compose_inverse_quadratic(p, d, work.D, work.products)
    else:
        compose_inverse(p, d)
    return length, power


@inlined
def _along_step(work: Workspace) -> float:
    """Return the product of the right-hand side and the step."""
    product = 0.0
    for i in range(len(work.b)):
        product += work.b[i] * work.d[i]
    return product


@inlined
def _lengthen(method: Method, subset: Subset, record: Flat, zncc: float, work: Workspace) -> None:
    """Multiply the step by the ratio of ∑fx² (or ∑fy²) to its value without noise, at most by `_LONGER`.

    The noise follows from the squared residuals that will be left after the step.
    """
    left = 2.0 * record[NORM2] * (1.0 - zncc) - _along_step(work)
    damping = (1.0 + method.noise_gain) ** 2 / 4.0
    variance = max(left, 0.0) / ((subset.pixels - len(work.b) - 2) * (1.0 + damping))
    noise = subset.pixels * variance * method.slope_noise_gain
    for i in range(len(work.b)):
        apparent = record[FX_FX + SIDE[i]]
        work.d[i] *= apparent / max(apparent - noise, apparent / _LONGER)
