"""The mark that fixes a line grid's origin and axes: dots in three of the four cells around its middle.

The rule: intersection ``(lines along X // 2, lines along Y // 2)``, the middle one of odd numbers, has a
dot as dark as the lines in the middle of three of its four cells; the one without lies towards +X and +Y.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dic.targets.axes import Axes, axes_towards
from dic.targets.lattice import LatticeShape
from dic.targets.sampled_image import GridImage

Floats = NDArray[np.float64]

# In pitches: well within a dot of radius 0.15, and between it and the lines.
_DOT, _RING = 0.07, 0.26
# A dot is as dark as the lines; what is half as dark is dirt or blur.
_DARK = 0.5
_ALIKE = 0.5


@dataclass(frozen=True)
class Mark:
    """A mark that was found.

    Attributes
    ----------
    axes : Axes
    spans : tuple of range
        The lattice indices of all lines of the target, hidden ones included.
    """

    axes: Axes
    spans: tuple[range, range]


def find_mark(
    image: GridImage, shape: LatticeShape, spans: tuple[range, range], vectors: Floats, lines: tuple[int, int]
) -> Mark | None:
    """Return the mark, if there is just one that agrees with the lines seen.

    Parameters
    ----------
    image, shape
        The image and where the lattice lies in it.
    spans : tuple of range
        Lattice indices of the lines that are seen.
    vectors : ndarray, shape (2, 2)
        The lattice's two vectors at the middle of the grid, px.
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
                whole = whole_spans(axes, (spans[0][i + 1], spans[1][j + 1]), lines)
                if within(spans, whole):
                    found.append(Mark(axes, whole))
    return found[0] if len(found) == 1 else None


def whole_spans(axes: Axes, origin: tuple[int, int], lines: tuple[int, int]) -> tuple[range, range]:
    """Return the lattice indices of all lines, if the middle intersection lies at `origin`."""
    spans = [range(0), range(0)]
    for which, axis in enumerate(axes.lattice_axes):
        count = lines[which]
        before = count - 1 - count // 2 if axes.flip[which] else count // 2
        spans[axis] = range(origin[axis] - before, origin[axis] - before + count)
    return spans[0], spans[1]


def within(seen: tuple[range, range], whole: tuple[range, range]) -> bool:
    """Tell whether all lines seen are among all lines there are."""
    return all(every[0] <= some[0] and some[-1] <= every[-1] for some, every in zip(seen, whole, strict=True))


def _darkness(image: GridImage, shape: LatticeShape, spans: tuple[range, range]) -> Floats:
    """Return how dark the middle of each cell is against its surroundings, of a line's darkness, (n0, n1)."""
    cells = np.stack(np.meshgrid(spans[0][:-1], spans[1][:-1], indexing="ij"), axis=-1) + 0.5
    angle = np.arange(12) * (np.pi / 6)
    around = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    middle, ring = (
        np.median(image.sample(shape.map(cells[..., None, :] + radius * around)), axis=-1)
        for radius in (_DOT, _RING)
    )
    line = np.median(image.sample(shape.map(cells + np.array([0.5, 0.0]))) - ring)
    result: Floats = np.nan_to_num((middle - ring) / line) if line > 0 else np.zeros_like(middle)
    return result


def _empty_quarter(block: Floats) -> tuple[int, int] | None:
    """Return where in 2 × 2 cells the one without a dot lies, (±1, ±1), if the other three have like ones."""
    marked = block > _DARK
    if np.count_nonzero(marked) != 3 or block[marked].min() < _ALIKE * block[marked].max():
        return None
    i, j = np.argwhere(~marked)[0]
    return (1 if i else -1, 1 if j else -1)
