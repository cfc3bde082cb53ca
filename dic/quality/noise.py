"""The noise of an image's grey levels, from one image or from two of the specimen at rest."""

import numpy as np
from numpy.typing import NDArray

from dic.errors import CorrelationError

Float = NDArray[np.float64]
Grey = NDArray[np.float32]
Mask = NDArray[np.bool_]

# The fourth difference along both axes leaves only the finest ripples, where optics pass no texture.
_FOURTH_DIFFERENCE = np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / np.sqrt(70.0)
_NORMAL_MAD = 0.6745
_AT_REST_PX = 0.1
_OF_TEXTURE = 0.5


def noise_of_one(grey: Grey, region: Mask) -> float:
    """Return the standard deviation of an image's noise, in grey levels, taken as white.

    After J. Immerkær, "Fast noise variance estimation", Computer Vision and Image Understanding 64 (1996)
    300-302, with a higher difference, which fine speckles disturb less, and the median, which edges disturb
    less. Noise that the camera has smoothed (colour mosaics, compression) is underestimated.

    Parameters
    ----------
    grey : ndarray, shape (height, width)
    region : ndarray of bool, shape (height, width)
        Where to look. Pixels at the image's darkest or brightest level, which hide noise, are left out.
    """
    import cv2

    hidden = ((grey == grey.min()) | (grey == grey.max()) | ~region).astype(np.uint8)
    clear = np.asarray(cv2.dilate(hidden, np.ones((5, 5), np.uint8))) == 0
    ripples = cv2.sepFilter2D(grey, cv2.CV_32F, _FOURTH_DIFFERENCE, _FOURTH_DIFFERENCE)
    chosen = np.abs(np.asarray(ripples)[clear if clear.any() else region])
    return float(np.median(chosen)) / _NORMAL_MAD


def noise_of_two(first: Grey, second: Grey, slopes: tuple[Grey, Grey], region: Mask) -> tuple[float, float]:
    """Return the noise of two images of the specimen at rest, and how white it is.

    A change of light and a motion far below a pixel are taken out of their difference.

    Parameters
    ----------
    first, second : ndarray, shape (height, width)
    slopes : two ndarray, shape (height, width)
        Derivatives of the first along x and y.
    region : ndarray of bool, shape (height, width)

    Returns
    -------
    noise : float
        Standard deviation of one image's noise, grey levels.
    whiteness : float
        Share of it that the finest ripples have: 1 if no pixel's noise depends on its neighbours', less if
        the camera has smoothed.

    Raises
    ------
    CorrelationError
        If the images differ by more than light and noise.
    """
    change = (second - first)[region].astype(np.float64)
    grey = first[region].astype(np.float64)
    terms = np.column_stack([np.ones(grey.size), grey, *(slope[region] for slope in slopes)])
    known = np.linalg.solve(terms.T @ terms, terms.T @ change)
    rest = change - terms @ known
    # The noise of the first is enlarged by the change of light, too.
    both = np.hypot(1.0, 1.0 + known[1])
    noise = float(rest.std() / both)
    moved = float(np.hypot(*known[2:]))
    if moved > _AT_REST_PX or noise > _OF_TEXTURE * grey.std():
        raise CorrelationError(
            "second image",
            "compare with the first",
            f"the specimen at rest, within {_AT_REST_PX:g} px",
            "another picture" if noise > _OF_TEXTURE * grey.std() else f"a motion of {moved:.2f} px",
            "take two images right after each other, or leave the second out",
        )
    residual = np.zeros(first.shape, np.float32)
    residual[region] = rest
    fine = noise_of_one(residual, region) / float(both)
    return noise, fine / noise if noise > 0.0 else 1.0
