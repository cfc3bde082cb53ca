"""The mark that fixes a line grid's origin and axes: dots in three of the four cells around its middle.

The marked intersection is ``(lines along X // 2, lines along Y // 2)``; for odd numbers of lines it is the
middle one. Three of the four cells around it have a dot in their middle, as dark as the lines. The cell
without a dot lies towards +X and +Y.
"""

from dataclasses import dataclass

import numpy as np

from dic.targets.axes import Axes, axes_towards
from dic.targets.lattice import LatticeShape
from dic.targets.sampled_image import GridImage
from dic.typing import Float

# Radii in pitches at which grey levels are sampled: within a dot, whose radius is 0.15, and just outside it.
_DOT, _RING = 0.07, 0.26
# Least darkness of a dot relative to the lines.
_DARK = 0.5
# Least darkness of the faintest of the three dots relative to the darkest.
_ALIKE = 0.5


@dataclass(frozen=True)
class Mark:
    """A mark found in an image.

    Attributes
    ----------
    axes : Axes
    spans : tuple of range
        Lattice indices of all lines of the grid, hidden lines included.
    """

    axes: Axes
    spans: tuple[range, range]


def find_mark(
    image: GridImage, shape: LatticeShape, spans: tuple[range, range], vectors: Float, lines: tuple[int, int]
) -> Mark | None:
    """Return the mark, or None if there is not exactly one that agrees with the visible lines.

    Parameters
    ----------
    image, shape
        The image, and the map that predicts where the lattice lies in it.
    spans : tuple of range
        Lattice indices of the visible lines.
    vectors : ndarray, shape (2, 2)
        The two lattice vectors at the middle of the grid, px.
    lines : tuple of int
        Number of lines along X and along Y.
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
    """Tell whether the lines `seen` are all among the lines of the `whole` grid."""
    return all(every[0] <= some[0] and some[-1] <= every[-1] for some, every in zip(seen, whole, strict=True))


def _darkness(image: GridImage, shape: LatticeShape, spans: tuple[range, range]) -> Float:
    """Return the darkness of the middle of each cell, shape (n0 − 1, n1 − 1).

    It is measured against the cell's own background, in units of the darkness of the lines.
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
    """Return the direction (±1, ±1) of the cell without a dot among 2 × 2 cells; None if they are no mark."""
    marked = block > _DARK
    if np.count_nonzero(marked) != 3 or block[marked].min() < _ALIKE * block[marked].max():
        return None
    i, j = np.argwhere(~marked)[0]
    return (1 if i else -1, 1 if j else -1)
