"""The motion of a specimen's surface away from the camera as the specimen becomes thinner under load.

If the strain of the thickness is e, a surface of a specimen with the thickness t moves by e t relative to the
opposite face, and by e t/2 relative to the middle. In uniaxial tension the measured strain in the plane gives
e. Let e1 and e2 be the logarithmic principal strains in the plane, with e1 along the load, and let ν be
Poisson's ratio. An elastic specimen has e = -ν e1. Plastic flow keeps the volume, so a specimen whose strain
e1 has the elastic part y has e = -(e1 + e2) + (1 - 2 ν) y. This holds for any plastic anisotropy. The yield
point is not known. So both cases are weighed by the probability that a metal yields below the strain e1, and
the difference between the cases enters the standard deviation. Poisson's ratio is known only roughly. If the
measured strains are accurate enough, their ratio improves it.
"""

from math import erfc, exp, expm1, hypot, inf, log, sqrt

import numpy as np

from dic.typing import Float

FACES: dict[str | None, tuple[float, float]] = {
    "middle": (0.5, 0.0),
    "back": (1.0, 0.0),
    "front": (0.0, 0.0),
    None: (0.5, 0.41),
}
"""The part of the change of thickness by which the surface moves, and its standard deviation, for each face
that the grips may hold. If no face is declared, all three are equally probable.
"""

UNKNOWN_MM = 3.6
"""Root mean square thickness of flat specimens, if all from 0.5 to 6 mm are equally probable."""

RATIO_STD = 0.03
"""Standard deviation of Poisson's ratio: metals have 0.28 to 0.36."""

_YIELD, _YIELD_SPREAD = 0.005, 0.55
"""Median yield strain of metals, and the standard deviation of its logarithm."""

_HARDENED = 0.3
"""Standard deviation of the elastic strain after yielding, relative to the yield strain."""

_STEP = 1e-6
_ROUNDS, _CLOSE_MM = 50, 1e-9


def thickness_strain(gradient: Float, poisson_ratio: float, strain_std: float = inf) -> tuple[float, float]:
    """Return the strain of the thickness, and its standard deviation, for a displacement gradient (2, 2).

    `strain_std`: standard deviation of the strains, among them of an equal error of both. If it is small, the
    ratio of the strains improves Poisson's ratio.
    """
    strains = np.log(np.linalg.svd(gradient + np.eye(2), compute_uv=False))
    along, across = sorted(strains.tolist(), key=abs, reverse=True)
    ratio, ratio_std = _elastic_ratio(along, across, poisson_ratio, strain_std)
    elastic, elastic_std = -ratio * along, ratio_std * along
    yielded, part, part_std = elastic_part(abs(along))
    volume = (1.0 - 2.0 * poisson_ratio) * part * (1.0 if along > 0.0 else -1.0)
    plastic = -(along + across) + volume
    plastic_std = hypot((1.0 - 2.0 * poisson_ratio) * part_std, 2.0 * RATIO_STD * part)
    mean = (1.0 - yielded) * elastic + yielded * plastic
    variance = (1.0 - yielded) * elastic_std**2 + yielded * plastic_std**2
    variance += yielded * (1.0 - yielded) * (plastic - elastic) ** 2
    return expm1(mean), exp(mean) * sqrt(variance)


def _elastic_ratio(
    along: float, across: float, poisson_ratio: float, strain_std: float
) -> tuple[float, float]:
    """Return Poisson's ratio and its standard deviation, from the expected ratio and from that of strains."""
    if along == 0.0 or strain_std == inf:
        return poisson_ratio, RATIO_STD
    measured_std = (1.0 + poisson_ratio) * strain_std / abs(along)
    share = RATIO_STD**2 / (RATIO_STD**2 + measured_std**2)
    # Farther away the specimen is not elastic.
    farther = min(max(-across / along - poisson_ratio, -3.0 * RATIO_STD), 3.0 * RATIO_STD)
    return poisson_ratio + share * farther, RATIO_STD * sqrt(1.0 - share)


def elastic_part(strain: float) -> tuple[float, float, float]:
    """Return the probability that a metal has yielded at this strain.

    The further results are the mean and the standard deviation of its elastic strain, if it has yielded.
    """
    d = (log(max(strain, 1e-12)) - log(_YIELD)) / _YIELD_SPREAD
    yielded = _normal(d)
    if yielded < 1e-9:
        return 0.0, 0.0, 0.0
    # The moments of a lognormal distribution that is cut off at the strain.
    first, second = (
        _YIELD**k * exp(0.5 * (k * _YIELD_SPREAD) ** 2) * _normal(d - k * _YIELD_SPREAD) / yielded
        for k in (1, 2)
    )
    return yielded, first, hypot(sqrt(max(second - first**2, 0.0)), _HARDENED * first)


def _normal(d: float) -> float:
    return 0.5 * erfc(-d / sqrt(2.0))


def recession_mm(
    gradient: Float, poisson_ratio: float, thickness_mm: float, face: str | None, strain_std: float = inf
) -> tuple[float, float]:
    """Return the shift of the surface towards the camera by thinning, and its standard deviation, mm.

    `gradient`, shape (2, 2): displacement gradient. `face`: the face that the grips hold, or None.
    `strain_std`: as for `thickness_strain`.
    """
    strain, std = thickness_strain(gradient, poisson_ratio, strain_std)
    share, share_std = FACES[face]
    return share * thickness_mm * strain, thickness_mm * hypot(share * std, share_std * strain)


def receded(
    gradient: Float,
    poisson_ratio: float,
    thickness_mm: float,
    face: str | None,
    height_mm: float,
    strain_std: float = inf,
) -> tuple[Float, float, Float, Float]:
    """Return the gradient of a specimen whose surface moved away from the camera by its own thinning.

    A shift w scales the deformation gradient that the camera measures by 1 - w/height. The shift follows from
    the strain, and the strain from the shift, so both are found together.

    Parameters
    ----------
    gradient : ndarray, shape (2, 2)
        Displacement gradient, if the surface has no shift by thinning.
    poisson_ratio, thickness_mm, face
        As for `recession_mm`.
    height_mm : float
        Height of the camera above the specimen's plane.
    strain_std : float
        As for `thickness_strain`.

    Returns
    -------
    gradient : ndarray, shape (2, 2)
    shift_mm : float
        Shift towards the camera by thinning.
    by_gradient : ndarray, shape (4, 4)
        Derivatives of the new gradient with respect to the given one.
    error : ndarray, shape (4,)
        Error of the new gradient if the shift is wrong by one standard deviation.
    """

    def shift_of(new: Float) -> tuple[float, float]:
        return recession_mm(new, poisson_ratio, thickness_mm, face, strain_std)

    measured = gradient + np.eye(2)
    shift_mm = 0.0
    for _ in range(_ROUNDS):
        new = measured * (1.0 - shift_mm / height_mm) - np.eye(2)
        before_mm, (shift_mm, std_mm) = shift_mm, shift_of(new)
        if abs(shift_mm - before_mm) < _CLOSE_MM:
            break
    steps = [_STEP * unit.reshape(2, 2) for unit in np.eye(4)]
    slope = np.array([(shift_of(new + step)[0] - shift_of(new - step)[0]) / (2 * _STEP) for step in steps])
    scaled = measured.ravel() / height_mm
    # A strain that is too large makes the surface recede too far, which makes the strain larger again.
    gain = np.linalg.inv(np.eye(4) + np.outer(scaled, slope))
    return new, shift_mm, np.asarray(gain * (1.0 - shift_mm / height_mm)), gain @ scaled * std_mm
