"""Errors of a calibration's map as smooth functions of the position in the grid's plane."""

from dataclasses import dataclass

import numpy as np

from dic.calibration.calibration import Calibration
from dic.calibration.one_grid import shared_factors
from dic.typing import Float

_POWERS = [(i, j) for i in range(4) for j in range(4)]


@dataclass(frozen=True)
class MapErrors:
    """The errors of mapped positions by q independent sources with variance 1.

    The errors at the grid points are fitted by bicubic polynomials, to evaluate them at many positions.
    """

    middle_mm: Float
    half_mm: float
    coefficients: Float
    """Shape (16, 2, q). Coefficients of the polynomials, mm."""

    @classmethod
    def of(cls, calibration: Calibration) -> "MapErrors":
        """Return the errors of a calibration's map; the sources are those of `Points.calibration_factors`."""
        px = calibration.grid.uv_px
        position = calibration.map(px)
        middle_mm = position.mean(axis=0)
        half_mm = float(np.abs(position - middle_mm).max())
        factors = in_order(calibration.error_factors(px), calibration)
        terms = _terms((position - middle_mm) / half_mm)
        solution = np.linalg.lstsq(terms, factors.reshape(len(px), -1), rcond=None)[0]
        return cls(middle_mm, half_mm, np.asarray(solution.reshape(len(_POWERS), 2, -1), np.float64))

    def adjusted(self, position_mm: Float, sources: Float) -> Float:
        """Return positions (n, 2) if the calibration has errors of the given sizes (q,)."""
        terms = _terms((position_mm - self.middle_mm) / self.half_mm)
        moved: Float = position_mm + terms @ (self.coefficients @ sources)
        return moved


def in_order(of_map: Float, calibration: Calibration) -> Float:
    """Return the effects of all sources of error on a map, (…, q), with 0 for those of the centre alone.

    The sources of the pinhole model are those of its covariance, and then those of the grid. The bicubic map
    has errors of its own instead of the first, which come before them.
    """
    if calibration.model == "pinhole" or calibration.pinhole is None:
        return of_map
    shared = shared_factors(calibration.pinhole)
    alone = calibration.pinhole.centre_factors().shape[1] - shared
    own = of_map.shape[-1] - shared
    nothing = np.zeros((*of_map.shape[:-1], alone))
    return np.concatenate([of_map[..., :own], nothing, of_map[..., own:]], axis=-1)


def _terms(position: Float) -> Float:
    # Products are computed much faster than powers.
    of_x, of_y = (np.stack([np.ones_like(t), t, t * t, t * t * t], axis=1) for t in position.T)
    terms: Float = (of_x[:, :, None] * of_y[:, None, :]).reshape(len(position), -1)
    return terms
