"""The mark that determines the origin and the axes of a line grid: dots in three of the four middle cells.

The marked intersection is number ``(lines along X // 2, lines along Y // 2)``. For odd numbers of lines, the
marked intersection is the middle one. Three of the four cells around the marked intersection have a dot in
their middle, as dark as the lines. The cell without a dot is the cell towards +X and +Y.
"""

from dataclasses import dataclass

import numpy as np

from dic.targets.axes import Axes, axes_towards
from dic.targets.lattice import LatticeShape
from dic.targets.sampled_image import GridImage
from dic.typing import Float

# Grey levels are sampled on two circles around the middle of a cell: one inside the dot, one just outside the
# dot. These are the radii of the circles in pitches. The radius of a dot is 0.15 pitches.
_DOT, _RING = 0.07, 0.26
# Smallest darkness of a dot, relative to the darkness of the lines.
_DARK = 0.5
# Smallest darkness of the palest of the three dots, relative to the darkest of them.
_ALIKE = 0.5


@dataclass(frozen=True)
class Mark:
    """A mark that was found in an image of a line grid."""

    axes: Axes
    """Directions of X and Y."""
    spans: tuple[range, range]
    """Lattice indices of all lines of the grid, including hidden lines."""


def find_mark(
    image: GridImage, shape: LatticeShape, spans: tuple[range, range], vectors: Float, lines: tuple[int, int]
) -> Mark | None:
    """Return the mark of a line grid.

    The function returns None if no mark agrees with the visible lines, or if several marks agree with them.

    `image`, `shape`: the image, and the map that predicts the positions of the lattice points in the image.
    `spans`: lattice indices of the visible lines. `vectors`, shape (2, 2): the two vectors, px, from the
    middle of the grid to the next intersections. `lines`: numbers of lines along X and along Y.
    """
    darkness = _darkness(image, shape, spans)
    found = []
    for i in range(darkness.shape[0] - 1):
        for j in range(darkness.shape[1] - 1):
            quarter = _empty_quarter(darkness[i : i + 2, j : j + 2])
            if quarter is not None:
                axes = axes_towards(quarter, vectors, "mark")
                whole = grid_spans(axes, (spans[0][i + 1], spans[1][j + 1]), lines)
                if within(spans, whole):
                    found.append(Mark(axes, whole))
    return found[0] if len(found) == 1 else None


def grid_spans(axes: Axes, origin: tuple[int, int], lines: tuple[int, int]) -> tuple[range, range]:
    """Return the lattice indices of all lines of a grid whose middle intersection has the index `origin`."""
    spans = [range(0), range(0)]
    for which, axis in enumerate(axes.lattice_axes):
        count = lines[which]
        before = count - 1 - count // 2 if axes.flip[which] else count // 2
        spans[axis] = range(origin[axis] - before, origin[axis] - before + count)
    return spans[0], spans[1]


def within(seen: tuple[range, range], whole: tuple[range, range]) -> bool:
    """Return True if all visible lines `seen` are among the lines of the `whole` grid."""
    return all(every[0] <= some[0] and some[-1] <= every[-1] for some, every in zip(seen, whole, strict=True))


def _darkness(image: GridImage, shape: LatticeShape, spans: tuple[range, range]) -> Float:
    """Return the darkness of the middle of each cell, shape (n0 − 1, n1 − 1).

    The darkness is relative to the background of the same cell, in units of the darkness of the lines.
    """
    cells = np.stack(np.meshgrid(spans[0][:-1], spans[1][:-1], indexing="ij"), axis=-1) + 0.5
    angle = np.arange(12) * (np.pi / 6)
    around = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    middle, ring = (
        np.median(image.sample(shape.map(cells[..., None, :] + radius * around)), axis=-1)
        for radius in (_DOT, _RING)
    )
    line = np.median(image.sample(shape.map(cells + np.array([0.5, 0.0]))) - ring)
    result: Float = np.nan_to_num((middle - ring) / line) if line > 0 else np.zeros_like(middle)
    return result


def _empty_quarter(block: Float) -> tuple[int, int] | None:
    """Return the direction (±1, ±1) of the cell without a dot in a block of 2 × 2 cells.

    The function returns None if the block is not a mark: exactly three cells must have similar dots.
    """
    marked = block > _DARK
    if np.count_nonzero(marked) != 3 or block[marked].min() < _ALIKE * block[marked].max():
        return None
    i, j = np.argwhere(~marked)[0]
    return (1 if i else -1, 1 if j else -1)
