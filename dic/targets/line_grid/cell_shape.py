"""Decide whether the cells found in an image are the areas between grid lines, or round dots.

In a plate of dots, the background looks like lines, and the dots look like the cells between these lines. The
shape of the mean cell distinguishes dots from the cells of a line grid.
"""

import numpy as np

from dic.targets.cells import CellLattice
from dic.targets.lattice import LatticeShape
from dic.targets.sampled_image import GridImage
from dic.typing import Float

# The mean cell is computed from about this number of cells.
_CELLS = 150
# Numbers of samples across a cell, and of radii and directions around its middle.
_ACROSS, _RADII, _DIRECTIONS = 25, 13, 32
# Grey levels that are tried for the ink of the lines. Each is a difference from the brightest level of the
# mean cell, as a fraction of the cell's contrast. Several are tried, because thin lines in a blurred image do
# not reach the grey level of the ink.
_INK = (-0.1, -0.05, 0.0, 0.05, 0.1, 0.2, 0.35, 0.6, 1.0, 2.0, 4.0, 8.0)
# Two models are fitted to the mean cell: ellipses for a dot, and a product f(x)·g(y) for a cell between
# lines. Cells are round if the misfit of the ellipses is below this multiple of the misfit of the product.
# Measured ratios are at most 1.2 for dots, even for dots of 5 px with a blur of 1.5 px, and at least 2.5 for
# cells between lines.
_ROUND = 1.6


def cells_are_round(image: GridImage, shape: LatticeShape, cells: CellLattice) -> bool:
    """Return True if the cells are round, as dots are, and not the areas between lines.

    The bare background is visible only where no line of either direction covers it. Therefore the grey level
    of a cell between lines is ``ink + f(x)·g(y)``, even after the blur of the lens. The grey level of a dot
    is constant on ellipses around the dot's middle. The function fits both models to the mean cell and
    compares the misfits.

    `image`: the image, in which the lines are bright. `shape`: map from lattice index to image position. The
    cells' middles have the indices of the cells plus 0.5.
    """
    every = max(1, len(cells.index) // _CELLS)
    middle = cells.index[::every].astype(np.float64) + 0.5
    side = np.linspace(-0.5, 0.5, _ACROSS)
    square = np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1)
    cell = _mean_cell(image, shape, middle, square)
    if not np.isfinite(cell).all() or np.ptp(cell) == 0:
        return False
    rings, weights = _rings(cell, square)
    levels = _mean_cell(image, shape, middle, rings)
    uneven = float(np.average(levels.var(axis=1), weights=weights))
    return uneven < _ROUND**2 * _misfit_of_lines(cell)


def _rings(cell: Float, places: Float) -> tuple[Float, Float]:
    """Return points (rings, directions, 2) on ellipses around a cell's middle, and the weights of the
    ellipses.

    The blur of an image that is seen obliquely makes dots elliptic on the lattice. The ellipses therefore
    have the centroid and the second moments of the cell (n, n), whose samples are at `places` (n, n, 2),
    pitches. The weight of a ring is its area.
    """
    weight = (cell.max() - cell).ravel()
    flat = places.reshape(-1, 2)
    centroid = np.average(flat, axis=0, weights=weight)
    factor = np.linalg.cholesky(np.cov(flat.T, aweights=weight))
    angle = np.arange(_DIRECTIONS) * (2 * np.pi / _DIRECTIONS)
    widest = np.stack([np.cos(angle), np.sin(angle)], axis=-1) @ factor.T
    radius = np.linspace(0.0, 1.0, _RADII)
    scale = (0.5 - np.abs(centroid).max()) / np.abs(widest).max()
    return centroid + radius[:, None, None] * widest * scale, radius


def _mean_cell(image: GridImage, shape: LatticeShape, middle: Float, offsets: Float) -> Float:
    """Return the grey levels (…,) at `offsets` (…, 2), pitches, from the middles: the median of all cells.

    Cells that the image's rim cuts do not count. If the rim cuts all cells, the result is NaN.
    """
    places = shape.map(middle.reshape(-1, *[1] * (offsets.ndim - 1), 2) + offsets)
    levels = image.sample(places)
    whole = np.isfinite(levels).all(axis=tuple(range(1, levels.ndim)))
    result: Float = np.median(levels[whole], axis=0) if whole.any() else np.full(levels.shape[1:], np.nan)
    return result


def _misfit_of_lines(cell: Float) -> float:
    """Return the mean square difference between a cell (n, n) and the best product ``ink + f(x)·g(y)``."""
    brightest, contrast = float(cell.max()), float(np.ptp(cell))
    # A matrix is a product of two vectors if only its first singular value is not zero.
    rests = [
        (np.linalg.svd(cell - brightest - ink * contrast, compute_uv=False)[1:] ** 2).sum() for ink in _INK
    ]
    return float(min(rests)) / cell.size
