"""Differences between a measurement and the results of another program for the same image."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from dic.comparison.peer import COMPONENTS, PeerField
from dic.strain.measurement import Measurement
from dic.typing import Float, Mask

QUANTILES = (0.05, 0.5, 0.95)


@dataclass(frozen=True)
class Difference:
    """The difference of one quantity: the value of offaxis minus the value of the other program.

    Attributes
    ----------
    quantity : str
        "u_px", "v_px" (positive downwards), "exx", "eyy" or "exy" (y upwards).
    ours, peer : ndarray, shape (n,)
        Values of offaxis and of the other program, at the points of the other program; NaN where a value is
        missing.
    """

    quantity: str
    ours: Float
    peer: Float

    @property
    def values(self) -> Float:
        """The value of offaxis minus the value of the other program, shape (n,); NaN if one is missing."""
        return self.ours - self.peer

    def as_dict(self) -> dict[str, float | int | None]:
        """Return the statistics of the difference for JSON, in the quantity's unit; see `docs/exports.md`."""
        known = self.values[np.isfinite(self.values)]
        if not known.size:
            return {"points": 0}
        low, middle, high = np.quantile(known, QUANTILES).tolist()
        return {
            "points": int(known.size),
            "mean": float(known.mean()),
            "rms": float(np.sqrt(np.mean(known**2))),
            "std": float(known.std()),
            "quantile_05": low,
            "median": middle,
            "quantile_95": high,
            "largest": float(np.abs(known).max()),
        }


@dataclass(frozen=True)
class Comparison:
    """The differences between a measurement and the results of another program.

    Attributes
    ----------
    label : str
        The image of the measurement.
    peer : PeerField
    differences : mapping of str to Difference
        The differences, keyed by quantity. Strains are included only if the other program's file has them.
    our_points : int
        Number of points with a displacement in the measurement.
    """

    label: str
    peer: PeerField
    differences: Mapping[str, Difference]
    our_points: int

    def __repr__(self) -> str:
        return f"Comparison({self.label!r} with {self.peer!r}, {self.common} points in common)"

    @property
    def common(self) -> int:
        """Number of points at which both programs have a displacement."""
        return int(np.isfinite(self.differences["u_px"].values).sum())

    def as_dict(self) -> dict[str, Any]:
        """Return the comparison as a dict for JSON."""
        return {
            "image": self.label,
            "program": self.peer.program,
            "file": self.peer.source,
            "image_of_file": self.peer.image,
            "strain_measure": self.peer.measure,
            "our_points": self.our_points,
            "peer_points": len(self.peer),
            "common_points": self.common,
            "share_of_peer": self.common / len(self.peer),
            "differences": {name: each.as_dict() for name, each in self.differences.items()},
        }


def compare(measurement: Measurement, peer: PeerField) -> Comparison:
    """Compare the raw displacements and strains of an image with the results of another program.

    The measurement is interpolated bilinearly to the other program's points, each between the four grid
    points around it. All four must have a value, and the region must be without a gap between them. A point
    that is itself a grid point needs no interpolation. If the displacement has the second derivative D along
    an axis, the error of the interpolation is at most D step² / 8.
    """
    field = measurement.field
    ours = {name: np.where(field.converged, getattr(field, name), np.nan) for name in ("u_px", "v_px")}
    strain = measurement.raw_strain(peer.measure)
    ours |= {name: getattr(strain, name) for name in COMPONENTS if name in peer.strains}
    theirs = {"u_px": peer.u_px, "v_px": peer.v_px, **peer.strains}
    grid = Interpolation.to(peer.points_px, field.x_px, field.y_px, field.region)
    differences = {name: Difference(name, grid(values), theirs[name]) for name, values in ours.items()}
    return Comparison(measurement.label, peer, differences, int(field.converged.sum()))


@dataclass(frozen=True)
class Interpolation:
    """Bilinear interpolation from a grid of points to other points."""

    corners: Any
    """Shape (4, 2, n). Row and column indices of the four grid points around each of the n points."""
    weights: Float
    """Shape (4, n). Weights of these four grid points."""
    inside: Mask
    """Shape (n,). True for points within the grid, if the region has no gap between the four grid points."""

    @classmethod
    def to(cls, points: Float, x_px: Any, y_px: Any, region: Mask | None) -> "Interpolation":
        """Return the interpolation to points (n, 2) from a grid of columns and rows at `x_px` and `y_px`."""
        (column, right, along), (row, below, down) = (
            _between(points[:, axis], grid) for axis, grid in ((0, x_px), (1, y_px))
        )
        inside = np.isfinite(along) & np.isfinite(down)
        along, down = np.nan_to_num(along), np.nan_to_num(down)
        if region is not None:
            inside &= _within(region, (x_px[column], x_px[right]), (y_px[row], y_px[below]))
        corners = np.array([(row, column), (row, right), (below, column), (below, right)])
        weights = np.array([(1 - down) * (1 - along), (1 - down) * along, down * (1 - along), down * along])
        return cls(corners, weights, inside)

    def __call__(self, values: Float) -> Float:
        """Interpolate values (rows, columns) of the grid to the n points; NaN if a value is missing."""
        parts = [
            # A corner without weight need not have a value.
            np.where(weight > 0.0, weight * values[rows, columns], 0.0)
            for (rows, columns), weight in zip(self.corners, self.weights, strict=True)
        ]
        return np.where(self.inside, np.sum(parts, axis=0), np.nan)


def _between(places: Float, grid: Any) -> tuple[Any, Any, Float]:
    """Return the two grid lines beside each place (indices), and the fraction of the way between them.

    For a place on a grid line, both indices are that line's. For a place outside the grid, the fraction is
    NaN.
    """
    low = np.clip(np.searchsorted(grid, places, side="right") - 1, 0, len(grid) - 1)
    on_grid = places == grid[low]
    high = np.where(on_grid, low, np.minimum(low + 1, len(grid) - 1))
    width = np.where(high > low, grid[high] - grid[low], 1)
    beyond = (places < grid[0]) | (places > grid[-1])
    return low, high, np.where(beyond, np.nan, (places - grid[low]) / width)


def _within(region: Mask, x: tuple[Any, Any], y: tuple[Any, Any]) -> Mask:
    """Return True for each rectangle of pixels, with limits x and y, that lies wholly in the region."""
    summed = np.zeros((region.shape[0] + 1, region.shape[1] + 1), np.int64)
    summed[1:, 1:] = region.cumsum(axis=0, dtype=np.int64).cumsum(axis=1)
    (left, right), (top, bottom) = (x[0], x[1] + 1), (y[0], y[1] + 1)
    count = summed[bottom, right] - summed[top, right] - summed[bottom, left] + summed[top, left]
    return np.asarray(count == (right - left) * (bottom - top))
