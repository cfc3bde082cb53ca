"""Speckle images whose motion is known exactly: Gaussian blobs that a formula draws at any position.

A motion is a function that gives the displacement (u, v) of the material point that the deformed image shows
at (x, y). So an image can be drawn without the inverse of the motion. Fixed-point iteration of the motion
gives the true displacement of a point of the reference.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dic.typing import Float, Grey

Motion = Callable[[Float, Float], tuple[Float, Float]]

_REACH = 5.5
"""Blobs are cut off at this multiple of their standard deviation, where 3e-7 of their height is left."""


@dataclass(frozen=True)
class Speckle:
    """A random pattern of blobs.

    Parameters
    ----------
    seed : int
    shape : tuple of int
        Height and width of its pictures, px.
    sigma_px : tuple of float
        Smallest and largest standard deviation of a blob.
    density : float
        Blobs per pixel.
    """

    seed: int = 1
    shape: tuple[int, int] = (1024, 1024)
    sigma_px: tuple[float, float] = (1.3, 2.2)
    density: float = 0.035

    def draw(self, motion: Motion | None = None) -> Float:
        """Return the noiseless image after `motion`, with grey levels from 25 to 225."""
        x, y, sigma, weight = self._blobs()
        if motion is not None:
            u, v = truth(motion, x, y)
            centre_x, centre_y = x + u, y + v
        else:
            centre_x, centre_y = x, y
        rows, columns = np.mgrid[: self.shape[0], : self.shape[1]].astype(float)
        back_x, back_y = columns, rows
        if motion is not None:
            u, v = motion(columns, rows)
            back_x, back_y = columns - u, rows - v
        covered = np.zeros(self.shape)
        reach = int(np.ceil(_REACH * self.sigma_px[1])) + 1
        left, top = np.rint(centre_x).astype(int), np.rint(centre_y).astype(int)
        for down in range(-reach, reach + 1):
            for right in range(-reach, reach + 1):
                row, column = top + down, left + right
                near = (row >= 0) & (row < self.shape[0]) & (column >= 0) & (column < self.shape[1])
                near &= np.hypot(down, right) <= _REACH * sigma + 1.5
                at = row[near], column[near]
                squared = (back_x[at] - x[near]) ** 2 + (back_y[at] - y[near]) ** 2
                np.add.at(covered, at, weight[near] * np.exp(-squared / (2 * sigma[near] ** 2)))
        return 25 + 200 * np.exp(-1.1 * covered)

    def _blobs(self) -> tuple[Float, Float, Float, Float]:
        rng = np.random.default_rng(self.seed)
        height, width = self.shape
        margin = 24
        count = int(self.density * (height + 2 * margin) * (width + 2 * margin))
        return (
            rng.uniform(-margin, width + margin, count),
            rng.uniform(-margin, height + margin, count),
            rng.uniform(*self.sigma_px, count),
            rng.uniform(0.4, 1.0, count),
        )


def truth(motion: Motion, x: Float, y: Float) -> tuple[Float, Float]:
    """Return the exact displacement of the points (x, y) of the reference."""
    u, v = np.zeros_like(x, np.float64), np.zeros_like(x, np.float64)
    for _ in range(40):
        u, v = motion(x + u, y + v)
    return u, v


def shift(u_px: float, v_px: float = 0.0) -> Motion:
    """Return a motion with the same displacement at all points."""
    return lambda x, y: (np.full_like(x, u_px), np.full_like(x, v_px))


def gentle_strain(scale: float = 1.0) -> Motion:
    """Return a smooth motion with about 1 % of strain and half a degree of rotation, times `scale`."""

    def motion(x: Float, y: Float) -> tuple[Float, Float]:
        a, b = x - 512, y - 512
        u = 1.7 + 0.007 * a - 0.006 * b + 0.5 * np.sin(a / 61) + 0.4 * np.cos(b / 73)
        v = -2.2 + 0.004 * a - 0.006 * b + 0.5 * np.cos(a / 67) * np.cos(b / 79)
        return scale * u, scale * v

    return motion


def eight_bit(picture: Float, noise: float, seed: int) -> NDArray[np.uint8]:
    """Return the picture with Gaussian noise of `noise` grey levels, rounded to 8 bits as by a camera."""
    noisy = picture + np.random.default_rng(seed).normal(0, noise, picture.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def noisy(picture: Float, noise: float, seed: int) -> Grey:
    """Return the picture with `noise` grey levels of Gaussian noise, neither rounded nor limited."""
    return (picture + np.random.default_rng(seed).normal(0, noise, picture.shape)).astype(np.float32)
