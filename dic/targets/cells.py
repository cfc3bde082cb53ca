"""Detection of the cells of a line grid and of their lattice indices: the first, rough step of finding a
grid.

A cell is the area between neighbouring lines.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dic.targets.sampled_image import as_bytes
from dic.typing import Float, Grey, Indices

_MIN_CELL_AREA_PX = 12
_SEEDS = 12
# An image is reduced to find wide lines only if its height and width are at least this, px.
_LARGE_PX = 1000
# Largest distance between a neighbour and its predicted place, as a fraction of the lattice vector.
_LATTICE_TOLERANCE = 0.3
# The four neighbours of a region: the number of the lattice vector, and its sign.
_WAYS = ((0, 1), (0, -1), (1, 1), (1, -1))


@dataclass(frozen=True)
class CellLattice:
    """The cells that form one lattice in the image."""

    index: Indices
    """Shape (n, 2). Lattice indices of the cells; their origin and directions are arbitrary."""
    centre_px: Float
    """Shape (n, 2). Centres of the cells in the image."""
    dark_lines: bool
    """True if the lines between the cells are darker than the cells."""


def find_cells(grey: Grey, expected: int) -> CellLattice:
    """Return the largest lattice of cells that is found in the image.

    A black top-hat filter (the morphological closing minus the image) detects dark lines. The top-hat filter
    ignores slow changes of light and the brightness step at the rim of the grid. The regions that lines
    enclose are the cells. The function tries several line widths, from 1 px to a few tens of px, for dark and
    for bright lines.

    `expected`: number of cells of the whole grid. The search ends as soon as a lattice has 90 % of this
    number.
    """
    best = CellLattice(np.empty((0, 2), np.int64), np.empty((0, 2)), True)
    image = as_bytes(grey)
    for width_px in (21, 11, 41, 81):
        if width_px > min(grey.shape) // 4:
            continue
        # Look for wide lines in a reduced image, because this takes less time.
        scale = width_px // 21 if width_px > 21 and min(grey.shape) > _LARGE_PX else 1
        level = image if scale == 1 else _reduced(image, scale)
        for dark_lines in (True, False):
            centres, areas = _enclosed_regions(level if dark_lines else 255 - level, width_px // scale)
            index, placed = lattice_of_regions(centres, areas)
            centres = (centres[placed] + 0.5) * scale - 0.5
            if len(index) > len(best.index):
                best = CellLattice(along_short_vectors(index, centres), centres, dark_lines)
            if len(best.index) >= 0.9 * expected:
                return best
    return best


def _reduced(image: NDArray[np.uint8], scale: int) -> NDArray[np.uint8]:
    import cv2

    return np.asarray(cv2.resize(image, None, fx=1 / scale, fy=1 / scale, interpolation=cv2.INTER_AREA))


def _enclosed_regions(image: NDArray[np.uint8], width_px: int) -> tuple[Float, Float]:
    """Return the centres (n, 2) and areas (n,) of regions between dark lines narrower than `width_px`."""
    import cv2

    smooth = cv2.GaussianBlur(image, (0, 0), max(0.7, width_px / 20))
    square = cv2.getStructuringElement(cv2.MORPH_RECT, (width_px, width_px))
    depth = cv2.morphologyEx(smooth, cv2.MORPH_BLACKHAT, square)
    wide = cv2.getStructuringElement(cv2.MORPH_RECT, (2 * width_px + 1, 2 * width_px + 1))
    # Two box filters approximate a Gauss filter with σ = width_px at a cost that does not depend on σ.
    box_px = (int(2.45 * width_px) | 1,) * 2
    contrast = cv2.blur(cv2.blur(cv2.dilate(depth, wide).astype(np.float32), box_px), box_px)
    cells = (depth < 0.45 * contrast).astype(np.uint8)
    _, _, stats, centres = cv2.connectedComponentsWithStats(cells, connectivity=4)
    stats, centres = stats[1:], centres[1:]
    area = stats[:, cv2.CC_STAT_AREA]
    box = stats[:, cv2.CC_STAT_WIDTH] * stats[:, cv2.CC_STAT_HEIGHT]
    compact = (area >= _MIN_CELL_AREA_PX) & (area > 0.3 * box) & (area < image.size / 9)
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
    seeds, bases = _local_bases(centres, areas, neighbours)
    if not len(seeds):
        return none
    middle = np.median(centres[seeds], axis=0)
    nearest_first = np.argsort(np.linalg.norm(centres[seeds] - middle, axis=1), kind="stable")
    best: dict[tuple[int, int], int] = {}
    seen: set[int] = set()
    tried = 0
    for at in nearest_first:
        if tried == _SEEDS or len(best) > len(centres) // 2:
            break
        seed = int(seeds[at])
        if seed not in seen:
            tried += 1
            grown = _grow(tree, centres, areas, seed, bases[at])
            seen.update(grown.values())
            best = max(best, grown, key=len)
    return np.array(list(best), np.int64).reshape(-1, 2), np.array(list(best.values()), np.int64)


def _local_bases(centres: Float, areas: Float, neighbours: NDArray[Any]) -> tuple[Indices, Float]:
    """Return the cells whose neighbours determine lattice vectors, shape (n,), and the vectors, (n, 2, 2).

    A lattice vector leads from a cell to a neighbour. The function uses only pairs of neighbours with similar
    areas, on opposite sides of the cell. The argument `neighbours` (m, 9) has the cell itself and its eight
    nearest neighbours in each row.
    """
    steps = centres[neighbours[:, 1:]] - centres[neighbours[:, :1]]
    ratio = areas[neighbours[:, 1:]] / areas[neighbours[:, :1]]
    alike = (ratio > 0.5) & (ratio < 2)
    length = np.linalg.norm(steps, axis=-1)
    unmatched = np.linalg.norm(steps[:, :, None] + steps[:, None], axis=-1)
    unmatched = np.where(alike[:, None], unmatched, np.inf).min(axis=-1)
    paired = alike & (unmatched <= 0.2 * length)
    every = np.arange(len(steps))
    first = np.argmax(paired, axis=1)
    nearest, its_length = steps[every, first][:, None], length[every, first][:, None]
    cross = np.abs(nearest[..., 0] * steps[..., 1] - nearest[..., 1] * steps[..., 0])
    across = paired & (cross > 0.5 * its_length * length)
    second = np.argmax(across, axis=1)
    sound = np.flatnonzero(across.any(axis=1))
    bases: Float = np.stack([steps[sound, first[sound]], steps[sound, second[sound]]], axis=1)
    return neighbours[sound, 0].astype(np.int64), bases


def along_short_vectors(index: Indices, centres: Float) -> Indices:
    """Change lattice indices (n, 2) so that they count along the shortest lattice vectors.

    The method is Gauss's lattice reduction. The reduction is needed because `_local_bases` may return a
    diagonal as a lattice vector where a cell is missing.
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

    The search goes from each found region to its neighbours. The lattice vectors of a found region predict
    the place of each neighbour. A neighbour that is found there then updates the vectors.
    """
    placed = {(0, 0): seed}
    taken = {seed}
    front, vectors = [(0, 0)], basis[None]
    while front:
        cells = np.array([placed[at] for at in front])
        # (ways, cells of the front, 2)
        steps = np.stack([sign * vectors[:, axis] for axis, sign in _WAYS])
        miss, found = tree.query(centres[cells] + steps)
        ratio = areas[found] / areas[cells]
        near = miss <= _LATTICE_TOLERANCE * np.linalg.norm(steps, axis=-1)
        good = near & (ratio > 0.5) & (ratio < 2)
        following, updated = [], []
        for k, at in enumerate(front):
            for way, (axis, sign) in enumerate(_WAYS):
                there = (at[0] + sign * (axis == 0), at[1] + sign * (axis == 1))
                other = int(found[way, k])
                if not good[way, k] or there in placed or other in taken:
                    continue
                placed[there] = other
                taken.add(other)
                following.append(there)
                updated.append(vectors[k].copy())
                updated[-1][axis] += 0.5 * (sign * (centres[other] - centres[cells[k]]) - vectors[k, axis])
        front, vectors = following, np.array(updated)
    return placed
