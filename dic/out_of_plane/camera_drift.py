"""A camera that moved, or whose scale changed, between the reference and an image of a test.

Whatever a specimen does, the positions that two cameras measure differ only along their parallax
(`dic.out_of_plane.parallax`). So a smooth difference across the parallax shows a camera that turned, moved or
became warm. The strain is then not known, because a motion of a camera along the line to the other one looks
like strain.
"""

from dataclasses import dataclass

import numpy as np

from dic.calibration.calibration import Calibration
from dic.calibration.one_grid import pinhole_of
from dic.out_of_plane.correction import by_centre
from dic.out_of_plane.joint_solution import JointSystem
from dic.out_of_plane.moved_camera import CameraMotion
from dic.out_of_plane.nodes import Nodes
from dic.out_of_plane.parallax import Heights
from dic.out_of_plane.uncertainty import sums_of, weighted_sums
from dic.strain.still import orthogonal_polynomials
from dic.typing import Float

_PROBABILITY = 1e-6
"""Probability that errors alone look like a motion or a change of the scale."""

_HEIGHT_STD_MM = 0.01
"""Standard deviation of the surface's height in the reference, at the middle and at the edge of the field."""

_GROWTH = 1e-3
"""Expected size of a change of the scale."""

_UNLIKE = 15.0
"""A change of the scale is named if a motion does not explain the differences better by more than this."""


def drift_reason(system: JointSystem) -> str | None:
    """Return the reason if a camera moved since the reference, and None otherwise."""
    pairs, centres_mm = system.pairs, system.centres_mm
    if not (pairs.first.determine(3) and pairs.second.determine(3)):
        return None
    heights = Heights.of(pairs.seen, centres_mm)
    length = np.linalg.norm(heights.parallax, axis=1, keepdims=True)
    across = heights.parallax[:, ::-1] * [-1.0, 1.0] / length
    basis = orthogonal_polynomials(heights.position_mm)
    weights = across[:, :, None] * basis[:, None, :] / len(basis)
    to_first = np.zeros((len(pairs.first.before_mm), *weights.shape[1:]))
    to_first[pairs.chosen] = weights
    to_second = -(pairs.partner.T @ weights.reshape(len(weights), -1)).reshape(-1, *weights.shape[1:])
    noise, of_maps, of_centres = system.noise_and_calibrations((to_first, to_second))

    nodes = Nodes.of(pairs.seen.start_mm, basis / len(basis))

    def seen(first_mm: Float, second_mm: Float) -> Float:
        return np.asarray(nodes.weights.T @ Heights.of(pairs.smooth, (first_mm, second_mm)).across_mm)

    one, other = centres_mm
    of_centre = np.hstack(
        [by_centre(lambda c: seen(c, other), one), by_centre(lambda c: seen(one, c), other)]
    )
    by_errors = of_maps + of_centre @ of_centres
    # Points of both cameras that are not quite the same move differently if the specimen is strained.
    moved_apart = (heights.parallax @ pairs.first.mean_gradient.T)[:, :, None] * basis[:, None, :3]
    by_pairing = _HEIGHT_STD_MM * weighted_sums(weights, moved_apart)
    covariance = noise + by_errors @ by_errors.T + by_pairing @ by_pairing.T
    to_white = np.linalg.inv(np.linalg.cholesky(covariance))
    camera = pairs.second
    motion = CameraMotion.unknown(camera.calibration, one)

    def moves(px: Float) -> Float:
        return np.concatenate([motion.factors(px)[0], _by_growth(camera.calibration, px)], axis=2)

    by_motion, by_growth = np.split(to_white @ sums_of(moves, camera.px[1], to_second), [-1], axis=1)
    found = to_white @ basis.T @ heights.across_mm / len(basis)
    turn, growth = _Cause.of(by_motion, found), _Cause.of(by_growth, found)
    if growth.is_clear and growth.explained > turn.explained - _UNLIKE:
        return (
            f"the scale of a camera changed by about {1e6 * _GROWTH * abs(growth.sizes[0]):.0f} ppm since "
            "the reference, relative to that of the other: let the cameras warm up, and fasten their lenses"
        )
    if turn.is_clear:
        return f"a camera moved since the reference, {motion.changed(turn.sizes).size_text}: fasten its mount"
    return None


def _by_growth(calibration: Calibration, px: Float) -> Float:
    """Return the motion of image points (n, 2) if the camera magnifies more by `_GROWTH`, (n, 2, 1), mm."""
    grown = _GROWTH * (px - pinhole_of(calibration).principal_px)
    return np.asarray(calibration.jacobian(px) @ grown[:, :, None])


@dataclass(frozen=True)
class _Cause:
    """A cause that may explain whitened data."""

    sizes: Float
    """Sizes, expected to be about 1, with which the cause explains the data best."""
    explained: float
    """Decrease of the sum of squares."""
    is_clear: bool
    """True if it is larger than errors let expect, also than those that the cause leaves unexplained: a
    local neck, which no motion of a camera explains, is none.
    """

    @classmethod
    def of(cls, columns: Float, data: Float) -> "_Cause":
        from scipy.special import chdtri

        count = columns.shape[1]
        normal = columns.T @ columns + np.eye(count)
        sizes = np.asarray(np.linalg.solve(normal, columns.T @ data), np.float64)
        explained = float(data @ columns @ sizes)
        left = (float(data @ data) - explained) / (len(data) - count)
        return cls(sizes, explained, bool(explained > max(left, 1.0) * chdtri(count, _PROBABILITY)))
