"""Makes a pattern without noise from a noisy image, and draws this pattern with any deformation.

The noise of a reference image is also in every deformed copy of this image. In the copy it moves with the
pattern, so it causes no error. Therefore a displacement computed from the image and its copy does not show
the effect of noise. This module therefore removes the noise first. Then independent noise can be added to
both images.

Every wave of the image, a term of its cosine transform, is multiplied by √(1 - N / P). P is the mean power of
the image at neighbouring wave numbers, and N is the power of the noise, which is assumed to be white. So the
result has the same power as the pattern without noise, and waves that consist of noise alone vanish. In the
remaining waves, the noise has slightly changed amplitude and phase. Therefore the result is not the exact
pattern, but a pattern of the same kind with the same contrast and slopes.

The deformed pattern is the sum of the cosines, evaluated at the displaced places. Such a sum is the exact
interpolation of a band-limited image that is continued beyond its edges by reflection. The splines of the
correlation are not used.
"""

from dataclasses import dataclass

import numpy as np

from dic.typing import Float, Grey

_CORNER = 0.9
"""Waves above this share of the Nyquist frequency along both axes contain hardly any pattern."""
_FINER = 4
"""Points per pixel and axis at which a deformed pattern is computed exactly, before a spline joins them."""
_NEIGHBOURS = 15
"""Width of the square of wave numbers over which the power is averaged."""


def corner_noise(grey: Grey) -> float:
    """Return the standard deviation of an image's noise, grey levels, from its finest waves along both axes.

    Sharp speckles have some power in these waves, but less than in all other waves. For sharp speckles the
    result is therefore too large, but closer to the truth than the result of
    `dic.quality.noise.noise_of_one`.
    """
    from scipy.fft import dctn

    terms = np.asarray(dctn(grey.astype(np.float64), norm="ortho"))
    first_row, first_column = (int(_CORNER * length) for length in terms.shape)
    return float(np.sqrt((terms[first_row:, first_column:] ** 2).mean()))


@dataclass(frozen=True)
class Pattern:
    """A pattern without noise, stored as a sum of cosines."""

    terms: Float
    """Shape (height, width). Terms of the orthonormal discrete cosine transform of type II."""

    @classmethod
    def of(cls, grey: Grey, noise: float) -> "Pattern":
        """Return the pattern of an image without its white noise.

        `noise`: standard deviation of the noise, grey levels.
        """
        from scipy.fft import dctn
        from scipy.ndimage import uniform_filter

        terms = np.asarray(dctn(grey.astype(np.float64), norm="ortho"))
        power = terms * terms
        # Replace the power of the mean grey level, which would hide the power of the longest waves.
        power[0, 0] = power[:2, :2].sum() - power[0, 0]
        power = uniform_filter(power, min(_NEIGHBOURS, *power.shape), mode="mirror")
        share = np.clip(1.0 - noise**2 / np.maximum(power, 1e-300), 0.0, 1.0)
        share[0, 0] = 1.0
        return cls(terms * np.sqrt(share))

    def draw(self, y: Float, x: Float) -> Grey:
        """Return the grey levels at all pairs of the coordinates `y` and `x`, shape (len(y), len(x))."""
        height, width = self.terms.shape
        return np.asarray(_cosines(y, height) @ self.terms @ _cosines(x, width).T, np.float32)

    def draw_at(self, y: Float, x: Float) -> Grey:
        """Return the grey levels at the places (x, y), both of shape (n, m).

        The sum of cosines is computed exactly at four points per pixel along each axis. On this fine grid,
        even the finest waves of the image are far below the Nyquist frequency, so a quintic spline can
        interpolate between the points.
        """
        from scipy.fft import idctn
        from scipy.ndimage import map_coordinates

        finer = [_FINER * length for length in self.terms.shape]
        points = idctn(_FINER * self.terms, s=finer, norm="ortho")
        places = [_FINER * (at + 0.5) - 0.5 for at in (y, x)]
        return np.asarray(map_coordinates(points, places, order=5, mode="reflect"), np.float32)


def _cosines(at: Float, length: int) -> Float:
    """Return the orthonormal cosines of a transform of `length` values at coordinates, (len(at), length)."""
    waves = np.arange(length)
    cosines = np.cos(np.pi / length * np.multiply.outer(at + 0.5, waves)) * np.sqrt(2.0 / length)
    cosines[:, 0] = np.sqrt(1.0 / length)
    return np.asarray(cosines)
