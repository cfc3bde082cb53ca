"""Detection of the cells of a line grid and of their lattice indices: the first, rough step of the detection.

A cell is the area between neighbouring lines.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dic.typing import Float, Grey, Indices

_MIN_CELL_AREA_PX = 12
_SEEDS = 12
# Largest distance between a neighbour and its predicted place, as a fraction of the lattice vector.
_LATTICE_TOLERANCE = 0.3


@dataclass(frozen=True)
class CellLattice:
    """The cells that form one lattice in the image.

    Attributes
    ----------
    index : ndarray of int64, shape (n, 2)
        Lattice indices of the cells; their origin and directions are arbitrary.
    centre_px : ndarray, shape (n, 2)
        Centres of the cells in the image.
    dark_lines : bool
        True if the lines between the cells are darker than the cells.
    """

    index: Indices
    centre_px: Float
    dark_lines: bool


def find_cells(grey: Grey, expected: int) -> CellLattice:
    """Return the largest lattice of cells that is found in the image.

    A black top-hat filter (the morphological closing minus the image) detects dark lines. The top-hat filter
    ignores slow changes of light and the brightness step at the rim of the grid. The regions that lines
    enclose are the cells. The function tries several line widths, from 1 px to a few tens of px, for dark and
    for bright lines.

    Parameters
    ----------
    grey : ndarray, shape (height, width)
    expected : int
        Number of cells of the whole grid. The search ends as soon as a lattice has 90 % of this number.
    """
    best = CellLattice(np.empty((0, 2), np.int64), np.empty((0, 2)), True)
    for width_px in (21, 11, 41, 81):
        if width_px > min(grey.shape) // 4:
            continue
        for dark_lines in (True, False):
            centres, areas = _enclosed_regions(grey if dark_lines else -grey, width_px)
            index, placed = lattice_of_regions(centres, areas)
            centres = centres[placed]
            if len(index) > len(best.index):
                best = CellLattice(along_short_vectors(index, centres), centres, dark_lines)
            if len(best.index) >= 0.9 * expected:
                return best
    return best


def _enclosed_regions(grey: Grey, width_px: int) -> tuple[Float, Float]:
    """Return the centres (n, 2) and areas (n,) of regions between dark lines narrower than `width_px`."""
    import cv2

    smooth = cv2.GaussianBlur(grey, (0, 0), max(0.7, width_px / 20))
    square = cv2.getStructuringElement(cv2.MORPH_RECT, (width_px, width_px))
    depth = cv2.morphologyEx(smooth, cv2.MORPH_BLACKHAT, square)
    wide = cv2.getStructuringElement(cv2.MORPH_RECT, (2 * width_px + 1, 2 * width_px + 1))
    contrast = cv2.GaussianBlur(cv2.dilate(depth, wide), (0, 0), width_px)
    cells = (depth < 0.45 * contrast).astype(np.uint8)
    _, _, stats, centres = cv2.connectedComponentsWithStats(cells, connectivity=4)
    stats, centres = stats[1:], centres[1:]
    area = stats[:, cv2.CC_STAT_AREA]
    box = stats[:, cv2.CC_STAT_WIDTH] * stats[:, cv2.CC_STAT_HEIGHT]
    compact = (area >= _MIN_CELL_AREA_PX) & (area > 0.3 * box) & (area < grey.size / 9)
    return centres[compact].astype(np.float64), area[compact].astype(np.float64)


def lattice_of_regions(centres: Float, areas: Float) -> tuple[Indices, Indices]:
    """Return the largest lattice in a set of regions with the given centres (n, 2) and areas (n,).

    Returns
    -------
    index : ndarray of int64, shape (m, 2)
        Lattice indices of the m regions that form the lattice.
    placed : ndarray of int64, shape (m,)
        For each lattice index, the number of the region in `centres`.
    """
    from scipy.spatial import KDTree

    none = np.empty((0, 2), np.int64), np.empty(0, np.int64)
    if len(centres) < 9:
        return none
    tree = KDTree(centres)
    neighbours: NDArray[Any] = np.asarray(tree.query(centres, k=9)[1])
    seeds = {}
    for cell in range(len(centres)):
        basis = _local_basis(centres, areas, neighbours[cell])
        if basis is not None:
            seeds[cell] = basis
    if not seeds:
        return none
    middle = np.median(centres[list(seeds)], axis=0)
    nearest_first = sorted(seeds, key=lambda cell: float(np.linalg.norm(centres[cell] - middle)))
    best: dict[tuple[int, int], int] = {}
    seen: set[int] = set()
    tried = 0
    for seed in nearest_first:
        if tried == _SEEDS:
            break
        if seed not in seen:
            tried += 1
            grown = _grow(tree, centres, areas, seed, seeds[seed])
            seen.update(grown.values())
            best = max(best, grown, key=len)
    return np.array(list(best), np.int64).reshape(-1, 2), np.array(list(best.values()), np.int64)


def _local_basis(centres: Float, areas: Float, neighbours: NDArray[Any]) -> Float | None:
    """Return the two lattice vectors (2, 2) at a cell, or None if the neighbours do not determine them.

    A lattice vector leads from a cell to a neighbour. The function uses only pairs of neighbours with similar
    areas, on opposite sides of the cell.
    """
    cell = neighbours[0]
    alike = [other for other in neighbours[1:] if 0.5 < areas[other] / areas[cell] < 2]
    steps = centres[alike] - centres[cell]
    basis: list[Float] = []
    for step in steps:
        length = np.linalg.norm(step)
        if np.linalg.norm(steps + step, axis=1).min() > 0.2 * length:
            continue
        if all(abs(np.linalg.det([step, other])) > 0.5 * length * np.linalg.norm(other) for other in basis):
            basis.append(step)
        if len(basis) == 2:
            return np.array(basis)
    return None


def along_short_vectors(index: Indices, centres: Float) -> Indices:
    """Change lattice indices (n, 2) so that they count along the shortest lattice vectors.

    The method is Gauss's lattice reduction. The reduction is needed because, where a cell is missing,
    `_local_basis` may return a diagonal as a lattice vector.
    """
    index = index.copy()
    for _ in range(4):
        affine = np.linalg.lstsq(np.column_stack([index, np.ones(len(index))]), centres, rcond=None)[0]
        for axis in (0, 1):
            shorter, longer = affine[axis], affine[1 - axis]
            shear = round(float(shorter @ longer / (shorter @ shorter)))
            if shear:
                index[:, axis] += shear * index[:, 1 - axis]
                break
    return index


def _grow(
    tree: Any,
    centres: Float,
    areas: Float,
    seed: int,
    basis: Float,
) -> dict[tuple[int, int], int]:
    """Find all regions of the lattice around the region `seed`; return a dict from lattice index to region.

    The search goes from each found region to its neighbours. The lattice vectors of the found region predict
    the place of a neighbour, and the found neighbour then updates the vectors.
    """
    placed = {(0, 0): seed}
    taken = {seed}
    front = [((0, 0), basis)]
    while front:
        following = []
        for at, vectors in front:
            cell = placed[at]
            for axis, sign in ((0, 1), (0, -1), (1, 1), (1, -1)):
                there = (at[0] + sign * (axis == 0), at[1] + sign * (axis == 1))
                if there in placed:
                    continue
                step = sign * vectors[axis]
                miss, other = tree.query(centres[cell] + step)
                alike = 0.5 < areas[other] / areas[cell] < 2
                if other in taken or not alike or miss > _LATTICE_TOLERANCE * np.linalg.norm(step):
                    continue
                placed[there] = int(other)
                taken.add(int(other))
                updated = vectors.copy()
                updated[axis] += 0.5 * (sign * (centres[other] - centres[cell]) - vectors[axis])
                following.append((there, updated))
        front = following
    return placed
