"""A smooth map from lattice index to image px: predicts where intersections lie."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]


@dataclass(frozen=True)
class LatticeShape:
    """A homography, which perspective asks for, plus a cubic polynomial for what the lens adds.

    Attributes
    ----------
    homography : ndarray, shape (3, 3)
        From normalised index to px.
    correction : ndarray, shape (10, 2)
        Coefficients of the polynomial in the normalised index, px.
    centre, scale : ndarray, shape (2,)
        Normalised index = (index − centre)/scale.
    """

    homography: NDArray[np.float64]
    correction: NDArray[np.float64]
    centre: NDArray[np.float64]
    scale: NDArray[np.float64]

    @classmethod
    def fit(cls, index: Points, px: Points) -> "LatticeShape":
        """Fit to index (n, 2) and px (n, 2), n ≥ 9, leaving out points off by a third of the pitch."""
        import cv2

        centre = (index.min(axis=0) + index.max(axis=0)) / 2
        scale = np.maximum((index.max(axis=0) - index.min(axis=0)) / 2, 1.0)
        unit = (index - centre) / scale
        extent = px.max(axis=0) - px.min(axis=0)
        tolerance = 0.3 * float(np.sqrt(np.prod(extent) / len(px)))
        homography, agrees = cv2.findHomography(unit, px, cv2.USAC_MAGSAC, tolerance, maxIters=2000)
        if homography is None:
            homography, agrees = cv2.findHomography(unit, px)
        correction = np.zeros((10, 2))
        shape = cls(np.asarray(homography, np.float64), correction, centre, scale)
        good = np.ravel(agrees).astype(bool)
        if np.count_nonzero(good) >= 40:
            residual = px - shape.map(index)
            correction[:] = np.linalg.lstsq(_cubics(unit[good]), residual[good], rcond=None)[0]
        return shape

    def map(self, index: Points) -> Points:
        """Return px (…, 2) of lattice indices (…, 2), which need not be whole."""
        unit = (index - self.centre) / self.scale
        ideal = np.concatenate([unit, np.ones_like(unit[..., :1])], axis=-1) @ self.homography.T
        result: Points = ideal[..., :2] / ideal[..., 2:] + _cubics(unit) @ self.correction
        return result

    def step(self, index: Points, axis: int) -> Points:
        """Return the image px (…, 2) per unit of index `axis`: the lattice vector at `index`."""
        half = np.zeros(2)
        half[axis] = 0.05
        return (self.map(index + half) - self.map(index - half)) * 10.0


def in_line(index: Points, px: Points) -> NDArray[np.bool_]:
    """Tell which points (n,) lie where the others say, within eight times the usual: dirt bends lines.

    Points that are NaN do not.
    """
    result: NDArray[np.bool_] = np.asarray(np.isfinite(px).all(axis=-1))
    if np.count_nonzero(result) < 16:
        return result
    index, px = index[result], px[result]
    deviation = np.linalg.norm(px - LatticeShape.fit(index, px).map(index), axis=1)
    result[result] = deviation < 8 * np.median(deviation) + 0.05
    return result


def _cubics(unit: Points) -> NDArray[np.float64]:
    x, y = unit[..., 0], unit[..., 1]
    return np.stack([x**i * y**j for i in range(4) for j in range(4 - i)], axis=-1)
