"""Patterns that repeat, with exactly known motion: dots, lines, woven cloth and halftone prints.

Each pattern is a function of the place on the specimen. An image is its mean over the area of each pixel, so
no image is interpolated.
"""

from collections.abc import Callable

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates, spline_filter

Pattern = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Type of a function that returns the brightness, about 0 to 1, at places (x, y), px."""

KINDS = ("square", "hexagonal", "grid", "plain", "twill", "lines")
_COUNT = 400
_FINER = 3


def turned(angle_rad, x, y):
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return c * x + s * y, -s * x + c * y


def lattice(kind, period_px, angle_rad=0.0, rng=None, irregular=0.0, brightness=0.0):
    """Return a lattice of dots or lines, or cloth whose yarns are `period_px` apart.

    `irregular`: standard deviation of positions and sizes, as a share of the period. `brightness`: standard
    deviation of the brightness of dots, lines and yarns.
    """
    p, rng = period_px, rng or np.random.default_rng(0)
    offset = irregular * p * rng.normal(size=(2, _COUNT, _COUNT))
    size, shade = (
        1 + irregular * rng.normal(size=(_COUNT,) * 2),
        1 + brightness * rng.normal(size=(_COUNT,) * 2),
    )
    shift, tone = irregular * p * rng.normal(size=(2, _COUNT)), 1 + brightness * rng.normal(size=(2, _COUNT))

    def dots(x, y):
        u, v = turned(angle_rad, x, y)
        high = p if kind == "square" else p * np.sqrt(3) / 2
        found = np.zeros_like(u)
        for down in (-1, 0, 1):
            j = np.rint(v / high).astype(int) + down
            aside = 0.0 if kind == "square" else p / 2 * (j % 2)
            for right in (-1, 0, 1):
                i = np.rint((u - aside) / p).astype(int) + right
                at = i % _COUNT, j % _COUNT
                from_centre = np.hypot(u - aside - i * p - offset[0][at], v - j * high - offset[1][at])
                found = np.maximum(found, np.clip(p / 4 * size[at] - from_centre + 0.5, 0, 1) * shade[at])
        return found

    def lines(x, y):
        found = []
        for across, by, bright in zip(turned(angle_rad, x, y), shift, tone, strict=True):
            i = np.rint(across / p).astype(int)
            edge = p / 6 - np.abs(across - i * p - by[i % _COUNT])
            found.append(np.clip(edge + 0.5, 0, 1) * bright[i % _COUNT])
        return found[0] if kind == "lines" else np.maximum(*found)

    def cloth(x, y):
        u, v = (across / p for across in turned(angle_rad, x, y))
        i, j = np.floor(u).astype(int), np.floor(v).astype(int)
        over = ((i + j) % 2 if kind == "plain" else (i + j) // 2 % 2) == 0
        along, across = np.cos(np.pi * (v - j - 0.5)), np.cos(np.pi * (u - i - 0.5))
        warp = (0.55 + 0.35 * across) * (0.75 + 0.25 * along) * tone[0][i % _COUNT]
        return np.where(over, warp, (0.35 + 0.3 * along) * (0.75 + 0.25 * across) * tone[1][j % _COUNT])

    return dots if kind in ("square", "hexagonal") else lines if kind in ("grid", "lines") else cloth


def vectors(kind, period_px, angle_rad=0.0):
    """Return the shortest displacements (x, y) that take a lattice to itself, shape (1 or 2, 2)."""
    p = period_px
    straight = {
        "lines": [(p, 0)],
        "hexagonal": [(p, 0), (p / 2, p * np.sqrt(3) / 2)],
        "plain": [(p, p), (p, -p)],
        "twill": [(p, -p), (2 * p, 2 * p)],
    }.get(kind, [(p, 0), (0, p)])
    return np.stack(turned(-angle_rad, *np.array(straight, float).T), axis=1)


def speckles(size_px, rng, side=700):
    """Return random speckles; the full width at half maximum of their autocovariance is `size_px`."""
    texture = gaussian_filter(rng.normal(size=(side, side)), size_px / 3.33, mode="wrap")
    spline = spline_filter(np.clip(0.5 + 0.2 * texture / texture.std(), 0, 1), 3, mode="grid-wrap")
    return lambda x, y: map_coordinates(spline, [y + 99, x + 99], mode="grid-wrap", prefilter=False)


def halftone(size_px, pitch_px, angle_rad, rng):
    """Return random speckles that are printed as dots of a screen; the size of a dot gives its tone."""
    tones = speckles(size_px, rng)

    def dots(x, y):
        u, v = turned(angle_rad, x, y)
        at = np.rint(u / pitch_px) * pitch_px, np.rint(v / pitch_px) * pitch_px
        tone = np.clip(tones(*turned(-angle_rad, *at)), 0.03, 0.97)
        return np.clip(pitch_px * np.sqrt(tone / np.pi) - np.hypot(u - at[0], v - at[1]) + 0.5, 0, 1)

    return dots


def image(pattern, shape, motion=(0.0, 0.0), gradient=((0.0, 0.0), (0.0, 0.0)), noise=2.0, blur=0.7, seed=1):
    """Return the picture of a pattern that has moved by `motion` and is deformed about the first pixel."""
    rng, back = np.random.default_rng(seed), np.linalg.inv(np.eye(2) + np.array(gradient))
    y, x = np.mgrid[: shape[0], : shape[1]].astype(float)
    grey = np.zeros(shape)
    for right in (np.arange(_FINER) + 0.5) / _FINER - 0.5:
        for down in (np.arange(_FINER) + 0.5) / _FINER - 0.5:
            places = np.stack([x + right - motion[0], y + down - motion[1]])
            grey += pattern(*np.einsum("ab,bij->aij", back, places))
    grey = gaussian_filter(50 + 150 * grey / _FINER**2, blur)
    return np.clip(np.rint(grey + noise * rng.normal(size=shape)), 0, 255).astype(np.uint8)
