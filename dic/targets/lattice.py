"""A smooth map from lattice index to image px, which predicts where intersections lie."""

from dataclasses import dataclass

import numpy as np

from dic.typing import Float, Mask


@dataclass(frozen=True)
class LatticeShape:
    """A homography for the perspective plus a cubic polynomial for the lens distortion.

    Attributes
    ----------
    homography : ndarray, shape (3, 3)
        Maps the normalised index to px.
    correction : ndarray, shape (10, 2)
        Coefficients of the polynomial of the normalised index, px.
    centre, scale : ndarray, shape (2,)
        Normalised index = (index − centre)/scale.
    """

    homography: Float
    correction: Float
    centre: Float
    scale: Float

    @classmethod
    def fit(cls, index: Float, px: Float) -> "LatticeShape":
        """Fit to indices (n, 2) and px (n, 2), n ≥ 9; points about 0.3 pitches off are rejected."""
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

    def map(self, index: Float) -> Float:
        """Return px (…, 2) of lattice indices (…, 2), which may be fractions."""
        unit = (index - self.centre) / self.scale
        ideal = np.concatenate([unit, np.ones_like(unit[..., :1])], axis=-1) @ self.homography.T
        result: Float = ideal[..., :2] / ideal[..., 2:] + _cubics(unit) @ self.correction
        return result

    def step(self, index: Float, axis: int) -> Float:
        """Return the lattice vector along `axis` at lattice indices (…, 2), shape (…, 2), px."""
        half = np.zeros(2)
        half[axis] = 0.05
        return (self.map(index + half) - self.map(index - half)) * 10.0


def fits_lattice(index: Float, px: Float) -> Mask:
    """Tell which points (n,) fit the map through all points; dirt, for example, moves points.

    A point may deviate by eight times the median deviation. Points that are NaN do not fit.
    """
    result: Mask = np.asarray(np.isfinite(px).all(axis=-1))
    if np.count_nonzero(result) < 16:
        return result
    index, px = index[result], px[result]
    deviation = np.linalg.norm(px - LatticeShape.fit(index, px).map(index), axis=1)
    result[result] = deviation < 8 * np.median(deviation) + 0.05
    return result


def _cubics(unit: Float) -> Float:
    x, y = unit[..., 0], unit[..., 1]
    return np.stack([x**i * y**j for i in range(4) for j in range(4 - i)], axis=-1)
