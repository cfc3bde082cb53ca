"""Strain from displacements: one value for a region, or a field by local fits.

All strains are Green-Lagrange, E = (FᵀF - I)/2, which no rigid rotation changes, up to a full turn.
Strains are dimensionless; axes are those of the displacement.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dic.displacement import Displacement
from dic.errors import CorrelationError

Float = NDArray[np.float64]

_MIN_WINDOW_SHARE = 0.5


@dataclass(frozen=True)
class MeanStrain:
    """The strain of a region as a whole.

    Attributes
    ----------
    exx, eyy, exy : float
        Green-Lagrange strain; NaN if fewer than three points are valid.
    rotation_deg : float
        Rigid rotation, positive from x towards y, in (-180, 180].
    points : int
        Number of points it comes from.
    """

    exx: float
    eyy: float
    exy: float
    rotation_deg: float
    points: int

    def as_dict(self) -> dict[str, float | int | None]:
        """Return the values by name, for JSON: None instead of NaN."""
        return {k: None if v != v else v for k, v in vars(self).items()}


@dataclass(frozen=True)
class StrainField:
    """Strain at every point of the grid.

    Attributes
    ----------
    exx, eyy, exy : ndarray, shape (rows, columns)
        NaN where too few neighbours are valid.
    window_points : int
        Width of the window of points that each value comes from.
    """

    exx: Float
    eyy: Float
    exy: Float
    window_points: int


def green_lagrange(gradient: Float) -> tuple[Float, Float, Float]:
    """Return (exx, eyy, exy) of displacement gradients, shape (…, 2, 2) with ∂u_i/∂x_j at [i, j]."""
    F = gradient + np.eye(2)
    E = (np.swapaxes(F, -1, -2) @ F - np.eye(2)) / 2
    return E[..., 0, 0], E[..., 1, 1], E[..., 0, 1]


def mean_strain(displacement: Displacement, valid: NDArray[np.bool_] | None = None) -> MeanStrain:
    """Return the strain of the plane motion that fits the valid points best, by least squares.

    Parameters
    ----------
    displacement : Displacement
    valid : ndarray of bool, shape (rows, columns), optional
        Points to use instead of the displacement's own valid ones.
    """
    use = displacement.valid if valid is None else valid
    position, vector = displacement.position[use], displacement.vector[use]
    if len(position) < 3:
        return MeanStrain(np.nan, np.nan, np.nan, np.nan, len(position))
    design = np.column_stack([position - position.mean(axis=0), np.ones(len(position))])
    solution, _, rank, _ = np.linalg.lstsq(design, vector, rcond=None)
    if rank < 3:
        return MeanStrain(np.nan, np.nan, np.nan, np.nan, len(position))
    gradient = solution[:2].T
    F = gradient + np.eye(2)
    rotation_deg = np.degrees(np.arctan2(F[1, 0] - F[0, 1], F[0, 0] + F[1, 1]))
    exx, eyy, exy = green_lagrange(gradient)
    return MeanStrain(float(exx), float(eyy), float(exy), float(rotation_deg), len(position))


def check_window(window_points: int) -> None:
    """Raise `CorrelationError` unless the window of local strains is odd and at least 3 points wide."""
    if window_points < 3 or window_points % 2 == 0:
        raise CorrelationError(
            "settings",
            "strain window",
            expected="an odd number of points, at least 3",
            got=str(window_points),
            remedy="correct the setting",
        )


def strain_field(displacement: Displacement, window_points: int = 5) -> StrainField:
    """Return the strain at every point by a plane fitted to the valid points of a window around it.

    The virtual strain gauge is (window_points - 1) × step + subset wide. A value needs half of its window.

    Parameters
    ----------
    displacement : Displacement
    window_points : int
        Odd width of the window, at least 3.
    """
    check_window(window_points)
    half = window_points // 2
    position = np.pad(displacement.position, ((half, half), (half, half), (0, 0)), constant_values=np.nan)
    vector = np.pad(displacement.vector, ((half, half), (half, half), (0, 0)), constant_values=np.nan)
    valid = np.pad(displacement.valid, half)
    rows, columns = displacement.valid.shape
    normal = np.zeros((rows, columns, 3, 3))
    right = np.zeros((rows, columns, 3, 2))
    for row in range(window_points):
        for column in range(window_points):
            here = (slice(row, row + rows), slice(column, column + columns))
            use = valid[here]
            offset = position[here] - displacement.position
            terms = np.concatenate([np.ones((rows, columns, 1)), offset], axis=2)
            terms[~use] = 0.0
            moved = np.where(use[..., None], vector[here], 0.0)
            normal += terms[..., :, None] * terms[..., None, :]
            right += terms[..., :, None] * moved[..., None, :]
    enough = displacement.valid & (normal[..., 0, 0] >= _MIN_WINDOW_SHARE * window_points**2)
    gradient = np.full((rows, columns, 2, 2), np.nan)
    fitted = np.linalg.solve(normal[enough], right[enough])
    gradient[enough] = np.swapaxes(fitted[:, 1:, :], 1, 2)
    return StrainField(*green_lagrange(gradient), window_points)
