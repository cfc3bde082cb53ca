"""The joint solution of two cameras: both calibrations are adjusted until the measured strains are equal."""

from dataclasses import dataclass

import numpy as np

from dic.calibration.one_grid import shared_factors
from dic.out_of_plane.correction import by_centre
from dic.out_of_plane.parallax import Bulge, Heights, Pairs, Seen
from dic.out_of_plane.uncertainty import block_diagonal, weighted_sums
from dic.strain.fit import gradient_weights
from dic.typing import Float

_SYSTEMATIC = 2e-6
"""Standard deviation of unmodelled errors in the difference of the strains from both cameras."""

_STEPS = 3


@dataclass(frozen=True)
class JointSystem:
    """The measurements of both cameras in one step of a test: eleven estimates, and their errors.

    The eleven estimates are the four elements of the displacement gradient for the first camera, the four
    elements for the second camera, and the slope x, slope y and shift of the specimen's plane. The surface
    may also be curved. The curvatures are computed from the heights, and the false strain that they cause is
    subtracted. The gradients are means over the points that both cameras see.

    For a camera that looks straight at the grid, the calibration hardly determines the distance to the grid.
    With a wrong distance, the two cameras measure different strains at the same points. So both calibrations
    are adjusted within their uncertainty until the strains are equal. The adjustment changes the map to the
    grid's plane and the camera's centre.
    """

    pairs: Pairs
    """Points that both cameras see."""
    centres_mm: tuple[Float, Float]
    """Each of shape (3,). The adjusted centres of both cameras."""

    @classmethod
    def of(cls, pairs: Pairs) -> "JointSystem":
        """Return the system before the adjustment, with the camera centres from the calibrations."""
        return cls(pairs, (pairs.first.centre_mm, pairs.second.centre_mm))

    def estimates(self, centres_mm: tuple[Float, Float], seen: Seen | None = None) -> Float:
        """Return the eleven estimates, shape (11,), for the given camera centres.

        `seen`: places that stand for the pairs. Default: those of all pairs.
        """
        seen = seen or self.pairs.seen
        heights = Heights.of(seen, centres_mm)
        plane, bulge = heights.plane(), Bulge.of(heights)
        gradients = [
            seen.gradient(plane.within(after_mm, centre_mm) - seen.start_mm)
            for after_mm, centre_mm in zip((seen.first_mm, seen.second_mm), centres_mm, strict=True)
        ]
        curvatures = bulge.weights @ heights.z_mm
        flat = np.ravel(gradients) - _by_curvatures(bulge, seen, centres_mm) @ curvatures
        return np.array([*flat, plane.slope_x, plane.slope_y, plane.shift_mm])

    def weights(self) -> tuple[Float, Float]:
        """Return the weight of each measured displacement in the eleven estimates, for each camera.

        The docstring of the class names the estimates. Both arrays have the shape (points, 2, 11).
        """
        seen = self.pairs.seen
        heights = Heights.of(seen, self.centres_mm)
        plane, bulge = heights.plane(), Bulge.of(heights)
        weights = gradient_weights(seen.start_mm)
        of_places = [
            weighted_sums(weights, plane.derivatives(after_mm, centre_mm))
            for after_mm, centre_mm in zip((seen.first_mm, seen.second_mm), self.centres_mm, strict=True)
        ]
        through_plane = heights.plane_weights() @ np.vstack([*of_places, np.eye(3)]).T
        along = heights.parallax / (heights.parallax**2).sum(axis=1, keepdims=True)
        through_bulge = (_by_curvatures(bulge, seen, self.centres_mm) @ bulge.weights).T
        through_plane[:, :, :8] -= along[:, :, None] * through_bulge[:, None, :]
        to_first = np.zeros((len(self.pairs.first.before_mm), 2, 11))
        to_first[self.pairs.chosen] = through_plane
        to_first[self.pairs.chosen, :, :4] += weights
        on_pairs = -through_plane
        on_pairs[:, :, 4:8] += weights
        to_second = self.pairs.partner.T @ on_pairs.reshape(len(weights), 22)
        return to_first, to_second.reshape(-1, 2, 11)

    def by_centres(self) -> Float:
        """Return the changes (11, 6) of the eleven estimates per mm of change of both camera centres."""
        first, second = self.centres_mm
        smooth = self.pairs.smooth
        return np.hstack(
            [
                by_centre(lambda centre: self.estimates((centre, second), smooth), first),
                by_centre(lambda centre: self.estimates((first, centre), smooth), second),
            ]
        )

    def noise_and_calibrations(
        self, weights: tuple[Float, Float] | None = None
    ) -> tuple[Float, Float, Float]:
        """Return the errors of the eleven estimates for exact camera centres, and the errors of the centres.

        `weights`: weights of the displacements of each camera, shape (points, 2, p), for p other estimates.

        Returns
        -------
        noise : ndarray, shape (p, p)
            The part of the estimates' covariance that image noise and interpolation cause.
        of_maps, of_centres : ndarray, shapes (p, q) and (6, q)
            Effect of q independent calibration errors with variance 1. The matrix `of_maps` gives the effect
            on the estimates through the maps from px to mm. The matrix `of_centres` gives the effect on the
            camera centres.
        """
        both = self.weights() if weights is None else weights
        noise, of_maps, of_centres = np.zeros((both[0].shape[2],) * 2), [], []
        for points, of_points in zip((self.pairs.first, self.pairs.second), both, strict=True):
            noise += points.noise_covariance(of_points) + points.smooth_covariance(of_points)
            noise += points.still_covariance(of_points)
            of_map, of_centre = points.calibration_factors(of_points)
            of_maps.append(of_map)
            of_centres.append(of_centre)
        shared = self._shared
        own = [slice(of_map.shape[1] - shared) for of_map in of_maps]
        maps = [of_map[:, some] for of_map, some in zip(of_maps, own, strict=True)]
        centres = [of_centre[:, some] for of_centre, some in zip(of_centres, own, strict=True)]
        if not shared:
            return noise, np.hstack(maps), block_diagonal(centres)
        of_grid = of_maps[0][:, -shared:] + of_maps[1][:, -shared:]
        centres_by_grid = np.vstack([of_centre[:, -shared:] for of_centre in of_centres])
        return noise, np.hstack([*maps, of_grid]), np.hstack([block_diagonal(centres), centres_by_grid])

    @property
    def _shared(self) -> int:
        """Number of errors of the grid, which both calibrations share."""
        first = self.pairs.first.calibration.pinhole
        return 0 if first is None else shared_factors(first)

    def solve(self) -> "JointSolution":
        """Adjust the calibrations until both cameras measure the same strain.

        The adjustment is the smallest one that explains the difference between the two strains. The size of
        the adjustment is measured in standard deviations of the calibrations.
        """
        noise, of_maps, of_centres = self.noise_and_calibrations()
        apart = np.hstack([np.eye(4), -np.eye(4), np.zeros((4, 3))])
        certain = np.linalg.inv(apart @ noise @ apart.T + _SYSTEMATIC**2 * np.eye(4))
        current, estimates, shift = self, self.estimates(self.centres_mm), np.zeros(of_maps.shape[1])
        for _ in range(_STEPS):
            by_shift = of_maps + current.by_centres() @ of_centres
            slopes = apart @ by_shift
            left = np.linalg.inv(slopes.T @ certain @ slopes + np.eye(len(shift)))
            shift = left @ slopes.T @ certain @ (slopes @ shift - apart @ estimates)
            first, second = (np.concatenate(self.centres_mm) + of_centres @ shift).reshape(2, 3)
            current = JointSystem(self.pairs, (first, second))
            estimates = current.estimates(current.centres_mm) + of_maps @ shift
        # Errors change the estimates directly, and also through the adjustment. The adjustment removes only a
        # part of the calibration errors.
        gain = by_shift @ left @ slopes.T @ certain
        direct, still_open = np.eye(11) - gain @ apart, by_shift @ left
        total = direct @ noise @ direct.T + still_open @ still_open.T + _SYSTEMATIC**2 * gain @ gain.T
        return JointSolution(current, estimates, np.asarray(total), float(np.linalg.norm(shift)))


def _by_curvatures(bulge: Bulge, seen: Seen, centres_mm: tuple[Float, Float]) -> Float:
    """Return the false gradients of both cameras for unit curvatures of the surface, shape (8, 3).

    A height above the plane displaces a point along the camera's ray.
    """
    rays = np.hstack(seen.rises(centres_mm))
    by_term = seen.gradient(bulge.fitted[:, :, None] * rays[:, None, :])
    return np.asarray(by_term.reshape(3, 8).T)


@dataclass(frozen=True)
class JointSolution:
    """The solution for both cameras together, with adjusted calibrations."""

    system: JointSystem
    """Both cameras with adjusted centres."""
    estimates: Float
    """Shape (11,). The eleven estimates of `JointSystem`."""
    covariance: Float
    """Shape (11, 11). Covariance of the estimates."""
    shift_needed: float
    """Size of the adjustment, in standard deviations of the calibrations."""
