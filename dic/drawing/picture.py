"""The picture of an image that a page shows, as a data URI."""

import base64

import numpy as np

from dic.typing import Grey

_MOST_PIXELS = 4_000_000
"""Largest number of pixels of a picture. More pixels would make the page slow, and a person cannot point so
finely.
"""

_PERCENTILES = (0.5, 99.5)
"""Pixels darker or brighter than these percentiles of the grey levels are shown black or white."""


def shown_picture(grey: Grey) -> tuple[str, int]:
    """Return a picture of an image with good contrast, as the data URI of a PNG file, and its reduction.

    An image of more than 4 megapixels is reduced. The reduction is the number of image pixels along the side
    of a pixel of the picture; 1 if the picture has all pixels.

    A pixel of a reduced picture is the mean of a square of pixels. If the image does not fill the last
    squares, its pixels at the right and lower edge are repeated.
    """
    import cv2

    reduction = int(np.ceil(np.sqrt(grey.size / _MOST_PIXELS)))
    if reduction > 1:
        height, width = (-side % reduction for side in grey.shape)
        padded = cv2.copyMakeBorder(grey, 0, height, 0, width, cv2.BORDER_REPLICATE)
        size = (padded.shape[1] // reduction, padded.shape[0] // reduction)
        grey = np.asarray(cv2.resize(padded, size, interpolation=cv2.INTER_AREA), np.float32)
    low, high = (float(level) for level in np.percentile(grey, _PERCENTILES))
    levels = np.clip((grey - low) * (255.0 / max(high - low, 1e-9)), 0.0, 255.0).astype(np.uint8)
    _, content = cv2.imencode(".png", levels)
    return "data:image/png;base64," + base64.b64encode(content.tobytes()).decode(), reduction
