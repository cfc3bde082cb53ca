"""The noise of the grey levels, from one image or from two images of the specimen at rest."""

import numpy as np

from dic.errors import CorrelationError
from dic.typing import Grey, Mask

# The fourth difference along both axes keeps only the highest spatial frequencies. The lens does not transmit
# these frequencies, so they contain noise but no texture.
_FOURTH_DIFFERENCE = np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / np.sqrt(70.0)
_NORMAL_MAD = 0.6745
# Two images count as images of the specimen at rest if the specimen has moved by at most this distance.
_AT_REST_PX = 0.1
# Two images show the same picture if their noise is at most this multiple of the grey levels' standard
# deviation.
_OF_TEXTURE = 0.5
# The contrast of two images of the specimen at rest differs by at most this factor. Without this limit, an
# image of one grey level would be taken for the specimen with the contrast zero, without noise.
_OF_CONTRAST = 2.0


def noise_of_one(grey: Grey, region: Mask) -> float:
    """Return the standard deviation of an image's noise, in grey levels. The noise is assumed to be white.

    The method follows J. Immerkær, "Fast noise variance estimation", Computer Vision and Image Understanding
    64 (1996) 300-302, with two changes. Differences of higher order reduce the influence of fine speckles,
    and a median reduces the influence of edges. If a colour mosaic or compression has smoothed the noise, the
    result is too small.

    `region`, shape (height, width): pixels to use. The function leaves out pixels with the lowest or the
    highest grey level of the image, because these levels may be clipped. The function also leaves out the
    pixels around such pixels.
    """
    import cv2

    hidden = ((grey == grey.min()) | (grey == grey.max()) | ~region).astype(np.uint8)
    clear = np.asarray(cv2.dilate(hidden, np.ones((5, 5), np.uint8))) == 0
    ripples = cv2.sepFilter2D(grey, cv2.CV_32F, _FOURTH_DIFFERENCE, _FOURTH_DIFFERENCE)
    chosen = np.abs(np.asarray(ripples)[clear if clear.any() else region])
    return float(np.median(chosen)) / _NORMAL_MAD


def noise_of_two(first: Grey, second: Grey, slopes: tuple[Grey, Grey], region: Mask) -> tuple[float, float]:
    """Return the noise of an image and the whiteness of the noise, from two images of a specimen at rest.

    The noise follows from the difference of the two images, after a change of light and a small motion have
    been fitted and removed.

    `slopes`, shape (height, width): derivatives of the first image along x and along y. `region`, shape
    (height, width): pixels to use.

    Returns
    -------
    noise : float
        Standard deviation of one image's noise, grey levels.
    whiteness : float
        Noise at the highest spatial frequencies divided by `noise`. The whiteness is 1 if the noise of
        neighbouring pixels is independent, and less if the camera has smoothed the image.

    Raises
    ------
    CorrelationError
        If the specimen has moved by more than 0.1 px, or the two images show different objects.
    """
    change = (second - first)[region].astype(np.float64)
    grey = first[region].astype(np.float64)
    terms = np.column_stack([np.ones(grey.size), grey, *(slope[region] for slope in slopes)])
    # Take the least-squares solution of least norm, because an image of one grey level does not determine the
    # factors.
    known = np.linalg.lstsq(terms.T @ terms, terms.T @ change, rcond=None)[0]
    rest = change - terms @ known
    # The fit multiplies the grey levels of the first image, and therefore their noise, by 1 + known[1].
    contrast = 1.0 + float(known[1])
    both = np.hypot(1.0, contrast)
    noise = float(rest.std() / both)
    moved = float(np.hypot(*known[2:]))
    other = noise > _OF_TEXTURE * grey.std() or not 1.0 / _OF_CONTRAST <= contrast <= _OF_CONTRAST
    if moved > _AT_REST_PX or other:
        raise CorrelationError(
            "second image",
            "compare with the first",
            f"the specimen at rest, within {_AT_REST_PX:g} px",
            "another picture" if other else f"a motion of {moved:.2f} px",
            "take two images directly one after the other, or leave out --second",
        )
    residual = np.zeros(first.shape, np.float32)
    residual[region] = rest
    fine = noise_of_one(residual, region) / float(both)
    return noise, fine / noise if noise > 0.0 else 1.0
