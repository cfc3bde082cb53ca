"""Patterns with sharp speckles whose shifted images are exact: drawn discs, and reduced real images.

No image is interpolated here. Discs are drawn on a grid eight times finer than the pixels, and averaged over
each pixel. A real image is first extended by its mirror image to a periodic image. The shift theorem of the
Fourier transform shifts the periodic image exactly. The result is blurred as by a lens, and averaged over
squares of pixels as by a coarser sensor.
"""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from dic.image.read import read_image

Draw = Callable[[float, float], np.ndarray]
"""Type of a function that returns the image shifted by (u, v) px."""

_FINER = 8


def coarser(grey: np.ndarray, factor: int) -> np.ndarray:
    height, width = (size // factor for size in grey.shape)
    cut = grey[: height * factor, : width * factor]
    return cut.reshape(height, factor, width, factor).mean(axis=(1, 3)).astype(np.float32)


def discs(diameter_px: float, blur_px: float, size_px: int = 260, seed: int = 1) -> Draw:
    """Return a function that draws shifted dark discs with sharp edges, blurred by a lens by `blur_px`."""
    rng = np.random.default_rng(seed)
    margin = 12
    count = int(0.5 * (size_px + 2 * margin) ** 2 / (np.pi * diameter_px**2 / 4))
    x, y = rng.uniform(-margin, size_px + margin, (2, count))
    radius = diameter_px / 2 * rng.uniform(0.7, 1.3, count)

    def draw(u: float, v: float) -> np.ndarray:
        fine = np.zeros((size_px * _FINER, size_px * _FINER), np.float32)
        for centre_x, centre_y, r in zip(
            (x + u + 0.5) * _FINER - 0.5, (y + v + 0.5) * _FINER - 0.5, radius * _FINER, strict=True
        ):
            left, right = (int(np.clip(at, 0, len(fine))) for at in (centre_x - r - 1, centre_x + r + 2))
            top, bottom = (int(np.clip(at, 0, len(fine))) for at in (centre_y - r - 1, centre_y + r + 2))
            rows, columns = np.ogrid[top:bottom, left:right]
            disc = np.clip(r + 0.5 - np.hypot(columns - centre_x, rows - centre_y), 0, 1)
            fine[top:bottom, left:right] = np.maximum(fine[top:bottom, left:right], disc)
        if blur_px:
            fine = cv2.GaussianBlur(fine, (0, 0), blur_px * _FINER)
        return 220 - 180 * coarser(fine, _FINER)

    return draw


def real_pattern(path: Path, factor: int, blur_px: float, crop: tuple[slice, slice] = np.s_[:, :]) -> Draw:
    """Return a function that draws a real image, shifted, blurred and with `factor` times wider pixels.

    The blur's standard deviation is `blur_px`, in the wider pixels.
    """
    grey = read_image(path)[crop].astype(np.float64)
    tile = np.block([[grey, grey[:, ::-1]], [grey[::-1], grey[::-1, ::-1]]])
    waves = np.fft.fft2(tile)
    down, right = np.fft.fftfreq(tile.shape[0])[:, None], np.fft.fftfreq(tile.shape[1])
    waves *= np.exp(-2 * (np.pi * blur_px * factor) ** 2 * (down**2 + right**2))

    def draw(u: float, v: float) -> np.ndarray:
        moved = np.fft.ifft2(waves * np.exp(-2j * np.pi * factor * (right * u + down * v))).real
        return coarser(moved[: grey.shape[0], : grey.shape[1]], factor)

    return draw
