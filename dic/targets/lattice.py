"""A smooth map from the index of a lattice point to its position in the image.

The map predicts the positions of the intersections of a line grid, for example.
"""

from dataclasses import dataclass

import numpy as np

from dic.typing import Float, Mask

# Smallest number of points for the ten coefficients of the lens. Without these coefficients, the images of
# large dots would count as symmetric. With a radius of 50 px and a distortion of 1 %, the centres would then
# be wrong by 0.05 px.
_FEWEST_FOR_LENS = 25


@dataclass(frozen=True)
class LatticeShape:
    """Map from lattice index to image position: a homography plus a cubic polynomial for lens distortion.

    The index is first normalised to values between -1 and 1.
    """

    homography: Float
    """Shape (3, 3). Homography from the normalised index to the image position in px."""
    correction: Float
    """Shape (10, 2). Coefficients, px, of the polynomial of the normalised index."""
    centre: Float
    scale: Float
    """Shape (2,). Values that normalise an index: normalised index = (index − centre)/scale."""

    @classmethod
    def fit(cls, index: Float, px: Float) -> "LatticeShape":
        """Fit the map to at least nine points with lattice indices (n, 2) and image positions (n, 2), px.

        Points that are more than about 0.3 pitches away from the fit are rejected.
        """
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
        if np.count_nonzero(good) >= _FEWEST_FOR_LENS:
            residual = px - shape.map(index)
            correction[:] = np.linalg.lstsq(_cubics(unit[good]), residual[good], rcond=None)[0]
        return shape

    def map(self, index: Float) -> Float:
        """Return the image positions (…, 2), px, of lattice indices (…, 2), which need not be integers."""
        unit = (index - self.centre) / self.scale
        ideal = np.concatenate([unit, np.ones_like(unit[..., :1])], axis=-1) @ self.homography.T
        result: Float = ideal[..., :2] / ideal[..., 2:] + _cubics(unit) @ self.correction
        return result

    def step(self, index: Float, axis: int) -> Float:
        """Return the lattice vectors along `axis` in the image, shape (…, 2), px, at lattice indices (…, 2).

        A lattice vector leads from one point to its neighbour.
        """
        half = np.zeros(2)
        half[axis] = 0.05
        return (self.map(index + half) - self.map(index - half)) * 10.0


def fits_lattice(index: Float, px: Float) -> Mask:
    """Return True for each point (n,) that fits a smooth lattice through all points.

    Dirt, for example, can move a point away from the lattice. A point fits if its deviation is at most about
    eight times the median deviation. Points with NaN coordinates do not fit.
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
