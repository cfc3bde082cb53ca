"""Heights of material points above the grid's plane, from the positions that two cameras measure.

Both cameras are calibrated on the same grid. Take a point at X, Y = P with the height z above the grid. A
camera with the centre C maps this point to the calibrated position m = P + (m - C) z/Cz. So the calibrated
positions from two cameras differ exactly by

    m₁ - m₂ = z e,    e = (m₁ - C₁)/C₁z - (m₂ - C₂)/C₂z.

The vector e is the parallax per height. The component of m₁ - m₂ along e gives the height z. The component of
m₁ - m₂ perpendicular to e must be zero.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from dic.calibration.calibration import Calibration
from dic.correlation.field import Field
from dic.out_of_plane.nodes import Nodes
from dic.out_of_plane.plane import Plane
from dic.out_of_plane.polynomial import polynomial_terms
from dic.out_of_plane.uncertainty import Points
from dic.typing import Float, Indices

if TYPE_CHECKING:
    from scipy.sparse import csr_array

_RANK = 1e-12
"""Combinations of terms whose normal equations are smaller than this share of the largest are left out."""


@dataclass(frozen=True)
class Pairs:
    """Material points that both cameras see.

    Points of the two cameras whose rays meet the specimen's surface at the same place in the reference images
    are the same material point. If the position of the surface is not known, the surface is assumed to lie in
    the grid's plane. If there is a gap g between the true surface and the assumed plane, the paired points
    are about g tan θ apart, where θ is the angle between the cameras.
    """

    first: Points
    second: Points
    """The points of the two cameras."""
    chosen: Indices
    """Shape (n,). Indices of the first camera's points that the second camera also sees."""
    partner: "csr_array"
    """Shape (n, points of the second). Matrix that interpolates from the second camera's points (bilinearly)
    to the chosen points of the first camera.
    """

    @classmethod
    def of(cls, first: Points, second: Points, field: Field) -> "Pairs":
        """Find the points of the first camera that the second camera also sees.

        The grid of points is that of `field`, the displacement field of the second camera.
        """
        from scipy.sparse import csr_array

        px = _seen_by(second.calibration, _on_grid(first, second))
        column = (px[:, 0] - field.x_px[0]) / _pitch(field.x_px)
        row = (px[:, 1] - field.y_px[0]) / _pitch(field.y_px)
        number = np.full(second.use.shape, -1)
        number[second.use] = np.arange(np.count_nonzero(second.use))
        left, top = np.floor(column).astype(int), np.floor(row).astype(int)
        rows, columns = second.use.shape
        on_grid = (left >= 0) & (top >= 0) & (left + 1 < columns) & (top + 1 < rows)
        left, top = np.where(on_grid, left, 0), np.where(on_grid, top, 0)
        right, down = column - left, row - top
        corners = np.stack([number[top + j, left + i] for j in (0, 1) for i in (0, 1)], axis=1)
        weights = np.stack(
            [(1 - right) * (1 - down), right * (1 - down), (1 - right) * down, right * down], 1
        )
        chosen = np.flatnonzero(on_grid & (corners >= 0).all(axis=1))
        entries = (weights[chosen].ravel(), (np.repeat(np.arange(len(chosen)), 4), corners[chosen].ravel()))
        return cls(first, second, chosen, csr_array(entries, shape=(len(chosen), int(number.max()) + 1)))

    @cached_property
    def seen(self) -> "Seen":
        """The places of the chosen points."""
        start, count = self.first.before_mm[self.chosen], len(self.chosen)
        moved = self.second.after_mm - self.second.before_mm
        places = start, self.first.after_mm[self.chosen], start + self.partner @ moved
        return Seen(*places, np.full(count, 1.0 / count))

    @cached_property
    def smooth(self) -> "Seen":
        """A few places that stand for the chosen points, on the polynomials that fit their displacements.

        Derivatives of estimates hardly depend on the rest of the displacements, so these places give them.
        """
        return self.seen.at_nodes()


@dataclass(frozen=True)
class Seen:
    """The places of material points as both cameras see them."""

    start_mm: Float
    """Shape (n, 2). Positions in the reference."""
    first_mm: Float
    second_mm: Float
    """Shape (n, 2). Calibrated positions in the deformed images, for each camera."""
    share: Float
    """Shape (n,). Weight of each place in a mean over all points."""

    def at_nodes(self) -> "Seen":
        """Return the places at nodes instead of the points."""
        nodes, terms = Nodes.of(self.start_mm, self.share), polynomial_terms(self.start_mm)
        moved = np.hstack([self.first_mm - self.start_mm, self.second_mm - self.start_mm])
        inverse = np.linalg.pinv(terms.T @ terms, _RANK, hermitian=True)
        fitted = polynomial_terms(nodes.at, self.start_mm) @ (inverse @ (terms.T @ moved))
        return Seen(nodes.at, nodes.at + fitted[:, :2], nodes.at + fitted[:, 2:], nodes.weights)

    def rises(self, centres_mm: tuple[Float, Float]) -> tuple[Float, Float]:
        """Return the shift of the calibrated positions by a height of 1 mm, shape (n, 2), for each camera.

        The difference between both cameras' shifts is the parallax vector e.
        """
        of_first, of_second = centres_mm
        return (self.first_mm - of_first[:2]) / of_first[2], (self.second_mm - of_second[:2]) / of_second[2]

    def gradient(self, values: Float) -> Float:
        """Return the mean gradients (…, 2) of fields (n, …) of the points."""
        flat = self._slopes.T @ values.reshape(len(values), -1)
        return np.asarray(np.moveaxis(flat.reshape(2, *values.shape[1:]), 0, -1))

    @cached_property
    def _slopes(self) -> Float:
        """Weights (n, 2) of the values at the points in their mean gradient."""
        weighted = self.share[:, None] * (self.start_mm - self.share @ self.start_mm)
        return np.asarray(np.linalg.solve(weighted.T @ self.start_mm, weighted.T).T)


def _pitch(places_px: Indices) -> float:
    return float(places_px[1] - places_px[0]) if len(places_px) > 1 else 1.0


def _on_grid(first: Points, second: Points) -> Float:
    """Return where the second camera's rays to the first camera's points meet the grid's plane, (n, 2)."""
    calibrated_mm = first.calibration.map(first.px[0])
    x, y, z = first.surface.met(calibrated_mm, first.grid_centre_mm).T
    centre_mm = second.grid_centre_mm
    across = np.column_stack([x, y]) - centre_mm[:2]
    return np.asarray(centre_mm[:2] + across * (centre_mm[2] / (centre_mm[2] - z))[:, None])


def _seen_by(calibration: Calibration, points_mm: Float) -> Float:
    """Return the image points (n, 2) that the calibration maps to given points (n, 2) of the grid's plane."""
    if calibration.pinhole is None:
        raise ValueError("this calibration knows no camera centre")
    px = calibration.pinhole.project(points_mm)
    for _ in range(3):
        seen_mm, jacobian = calibration.map_and_jacobian(px)
        px = px + np.linalg.solve(jacobian, (points_mm - seen_mm)[:, :, None])[:, :, 0]
    return np.asarray(px)


@dataclass(frozen=True)
class Bulge:
    """The three quadratic terms of a curved surface, each without the plane that fits it best."""

    fitted: Float
    """Shape (n, 3). The terms X²/2, X Y and Y²/2 at the points with known heights, minus their best-fitting
    planes, mm².
    """
    planes: Float
    """Shape (3, 3). Slope x, slope y and height of the three planes, in the columns."""
    share: Float
    """Shape (n,). Weight of each point in a mean over all points."""

    @classmethod
    def of(cls, heights: "Heights") -> "Bulge":
        """Return the three quadratic terms at the points with these heights."""
        flat, quadratic = _terms(heights.position_mm)
        weighted = (heights.share[:, None] * flat).T
        planes = np.asarray(np.linalg.solve(weighted @ flat, weighted @ quadratic))
        return cls(np.asarray(quadratic - flat @ planes), planes, heights.share)

    def at(self, position_mm: Float) -> Float:
        """Return the three terms at other points (m, 2), shape (m, 3)."""
        flat, quadratic = _terms(position_mm)
        return np.asarray(quadratic - flat @ self.planes)

    @cached_property
    def weights(self) -> Float:
        """Weights with which the heights enter the three curvatures, shape (3, n)."""
        weighted = (self.share[:, None] * self.fitted).T
        return np.asarray(np.linalg.pinv(weighted @ self.fitted, _RANK, hermitian=True) @ weighted)


def _terms(position_mm: Float) -> tuple[Float, Float]:
    x, y = position_mm.T
    return np.column_stack([x, y, np.ones_like(x)]), np.column_stack([x * x / 2, x * y, y * y / 2])


@dataclass(frozen=True)
class Heights:
    """Heights of material points above the grid's plane in the deformed images, relative to the reference."""

    position_mm: Float
    """Shape (n, 2). True coordinates X and Y of the points."""
    z_mm: Float
    """Shape (n,). Heights of the points."""
    across_mm: Float
    """Shape (n,). Component, perpendicular to the parallax, of the difference between both cameras'
    calibrated positions. This component should contain only noise.
    """
    parallax: Float
    """Shape (n, 2). The parallax vector e of each point."""
    share: Float
    """Shape (n,). Weight of each point in a mean over all points."""

    @classmethod
    def of(cls, seen: Seen, centres_mm: tuple[Float, Float]) -> "Heights":
        """Compute the heights of points that both cameras see; the cameras' centres must differ."""
        rise, other = seen.rises(centres_mm)
        e, apart = rise - other, seen.first_mm - seen.second_mm
        square = (e**2).sum(axis=1)
        z = (apart * e).sum(axis=1) / square
        across = (apart[:, 1] * e[:, 0] - apart[:, 0] * e[:, 1]) / np.sqrt(square)
        return cls(seen.first_mm - rise * z[:, None], z, across, e, seen.share)

    def plane(self) -> Plane:
        """Fit a plane to the heights by least squares."""
        weighted = self._weighted
        slope_x, slope_y, shift_mm = np.linalg.solve(weighted @ self._flat, weighted @ self.z_mm)
        return Plane(float(slope_x), float(slope_y), float(shift_mm))

    def plane_weights(self) -> Float:
        """Return the weights with which the differences m₁ - m₂ of the calibrated positions enter `plane`.

        The result has the shape (n, 2, 3); the plane is given by slope x, slope y and shift (mm).
        """
        inverse = np.linalg.inv(self._weighted @ self._flat)
        of_square = (self.share[:, None] * self._flat) @ inverse
        return np.asarray(self.parallax[:, :, None] * of_square[:, None, :])

    @cached_property
    def _flat(self) -> Float:
        return np.column_stack([self.position_mm, np.ones(len(self.z_mm))])

    @property
    def _weighted(self) -> Float:
        return np.asarray((self.share * (self.parallax**2).sum(axis=1))[:, None] * self._flat).T
