"""A pattern without noise that looks like the pattern of a noisy image, drawn deformed at will.

The noise of a reference image is also in every deformed copy of this image. There it moves with the pattern,
so it would cause no error at all, and a displacement computed from the image and its copy says nothing about
noise. This module therefore removes the noise first. Then independent noise can be added to both images.

Every wave of the image, a term of its cosine transform, is multiplied by √(1 - N / P). P is the mean power
of the image at neighbouring wave numbers, and N is the power of the noise, which is white. So the result has
the power that the pattern has without noise, and waves that consist of noise alone vanish. In the remaining
waves, the noise has slightly changed amplitude and phase. The result is not the exact pattern, but another
pattern of the same kind, with the same contrast and slopes.

The deformed pattern is the sum of the cosines at the displaced places. This is the exact interpolation of a
band-limited image, continued beyond its edges by reflection. The splines of the correlation take no part.
"""

from dataclasses import dataclass

import numpy as np

from dic.typing import Float, Grey

_CORNER = 0.9
"""Waves above this share of the Nyquist frequency, along both axes, hold hardly any pattern."""
_FINER = 4
"""Points per pixel and axis at which a deformed pattern is computed exactly, before a spline joins them."""
_NEIGHBOURS = 15
"""Width of the square of wave numbers over which the power is averaged."""


def corner_noise(grey: Grey) -> float:
    """Return the standard deviation of an image's noise, grey levels, from its finest waves along both axes.

    Sharp speckles have some power in these waves, but less than in all others. The result is then too large,
    but less so than that of `dic.quality.noise.noise_of_one`.

    Parameters
    ----------
    grey : ndarray, shape (height, width)
    """
    from scipy.fft import dctn

    terms = np.asarray(dctn(grey.astype(np.float64), norm="ortho"))
    first_row, first_column = (int(_CORNER * length) for length in terms.shape)
    return float(np.sqrt((terms[first_row:, first_column:] ** 2).mean()))


@dataclass(frozen=True)
class Pattern:
    """A pattern as a sum of cosines.

    Attributes
    ----------
    terms : ndarray, shape (height, width)
        Terms of the orthonormal discrete cosine transform of type II.
    """

    terms: Float

    @classmethod
    def of(cls, grey: Grey, noise: float) -> "Pattern":
        """Return the pattern of an image without its white noise.

        Parameters
        ----------
        grey : ndarray, shape (height, width)
        noise : float
            Standard deviation of the noise, grey levels.
        """
        from scipy.fft import dctn
        from scipy.ndimage import uniform_filter

        terms = np.asarray(dctn(grey.astype(np.float64), norm="ortho"))
        power = terms * terms
        # The mean grey level would hide the power of the longest waves.
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

        The sum of cosines is computed exactly at four points per pixel along each axis. There, the finest
        waves of the image are far below the Nyquist frequency, and a quintic spline joins the points.
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
