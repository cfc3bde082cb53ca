"""How many lines a grid has: which of the lines that a lattice predicts are really there."""

import numpy as np
from numpy.typing import NDArray

from dic.targets.cells import CellLattice
from dic.targets.lattice import LatticeShape
from dic.targets.line_grid.trace import median_where
from dic.targets.sampled_image import GridImage, line_evidence, line_irregularity, profiles_across

# Fractions of what is usual between the cells that were found, set between the grid's own outer lines (0.9
# and more) and speckle one pitch beside them (up to 0.7 of the segments by chance).
_SEGMENT_SEEN = 0.4
_LINE_SEEN = 0.3
_MOST_SEGMENTS = 0.75
_IRREGULAR = 0.25
# A line that is hidden in part has this share of its segments seen, and so many in a row. Speckle beside a
# grid gives a tenth by chance.
_PARTLY_SEEN = 0.25
_RUN = 3
_AGREEMENT = 0.6
_SHIFT = 3
# How many rows of cells may have been missed at the rim.
_BEYOND = 2


def line_extents(image: GridImage, shape: LatticeShape, cells: CellLattice) -> tuple[range, range]:
    """Return the indices of the lines that are really there, in both directions.

    Cells at the rim may be missing or, beyond it, spurious: a line counts if most of its segments look like
    one, and if they do so at the same place, which speckle beside the grid does not.
    Both ranges are empty if what lies between the cells does not look like lines at all.
    """
    low = cells.index.min(axis=0) - _BEYOND
    high = cells.index.max(axis=0) + 2 + _BEYOND
    spans = (range(low[0], high[0]), range(low[1], high[1]))
    found = []
    for axis in (0, 1):
        profiles = profiles_across(image, shape, axis, spans[axis], spans[1 - axis])
        between = _between_cells(cells, axis, low, profiles.shape[:2])
        if not between.any() or line_irregularity(profiles[between]) > _IRREGULAR:
            return range(0), range(0)
        present = np.flatnonzero(_present(profiles, between))
        first, last = _widened(_alike(profiles, between), int(present[0]), int(present[-1]))
        found.append(range(int(low[axis]) + first, int(low[axis]) + last + 1))
    return found[0], found[1]


def _between_cells(
    cells: CellLattice, axis: int, low: NDArray[np.int64], shape: tuple[int, ...]
) -> NDArray[np.bool_]:
    """Tell which segments (lines, segments) lie between two cells that were found."""
    known = {(int(i), int(j)) for i, j in cells.index}
    between = np.zeros(shape, bool)
    for i, j in known:
        if ((i - 1, j) if axis == 0 else (i, j - 1)) in known:
            at = (i - low[0], j - low[1])
            between[at if axis == 0 else at[::-1]] = True
    return between


def _present(profiles: NDArray[np.float64], between: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Tell which lines are there, (lines,), from profiles (lines, segments, stations, offsets)."""
    usual = _usual_evidence(line_evidence(profiles), between)
    # the grid's own segments: most of a small grid's would lie beyond it
    within = between.any(axis=0)
    relative = (profiles / usual[..., None, None])[:, within]
    segments = (line_evidence(relative) > _SEGMENT_SEEN).sum(axis=1)
    together = np.moveaxis(relative, 1, -1)
    whole = median_where(np.isfinite(together), together, fallback=0.0)[..., 0]
    most = np.sort(segments)[-max(1, len(segments) // 4)]
    result: NDArray[np.bool_] = (segments > _MOST_SEGMENTS * most) & (line_evidence(whole) > _LINE_SEEN)
    return result if np.any(result) else np.asarray(between.any(axis=1))


def _widened(alike: NDArray[np.bool_], first: int, last: int) -> tuple[int, int]:
    """Return the first and last line, with those beyond that something hides in part.

    Parameters
    ----------
    alike : ndarray of bool, shape (lines, segments)
        Which segments have the very profile of the grid's lines.
    first, last : int
        The outermost lines of which most is seen.
    """
    share = alike.mean(axis=1)
    run = np.lib.stride_tricks.sliding_window_view(alike, min(_RUN, alike.shape[1]), axis=1)
    partly = (share > _PARTLY_SEEN) & run.all(axis=-1).any(axis=-1)
    while first > 0 and partly[first - 1]:
        first -= 1
    while last < len(partly) - 1 and partly[last + 1]:
        last += 1
    return first, last


def _alike(profiles: NDArray[np.float64], between: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Tell which segments look like those between known cells in shape and height, (lines, segments).

    Speckle may be as dark as a line somewhere in a segment; it is not so at all three stations alike.
    """
    from scipy.ndimage import gaussian_filter1d

    usual = _usual_evidence(line_evidence(profiles), between)
    within = between.any(axis=0)
    relative = (profiles / usual[..., None, None])[:, within]
    smooth = gaussian_filter1d(np.nan_to_num(relative), 1.5, axis=-1, mode="nearest")
    smooth -= smooth.mean(axis=-1, keepdims=True)
    typical = np.median(smooth[between[:, within]], axis=(0, 1))
    best = np.full(smooth.shape[:2], -np.inf)
    for shift in range(-_SHIFT, _SHIFT + 1):
        shifted = np.roll(typical, shift)
        height = smooth @ shifted / (shifted @ shifted)
        rest = smooth - height[..., None] * shifted
        agreement = 1 - (rest**2).sum(axis=-1) / np.maximum((smooth**2).sum(axis=-1), 1e-12)
        sized = (height > 0.5) & (height < 2.0)
        best = np.maximum(best, np.where(sized, agreement, -np.inf).min(axis=-1))
    result: NDArray[np.bool_] = best > _AGREEMENT
    return result


def _usual_evidence(evidence: NDArray[np.float64], between: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return for every segment what is usual among the nearest segments that lie between known cells."""
    from scipy.ndimage import distance_transform_edt, median_filter

    nearest = distance_transform_edt(~between, return_distances=False, return_indices=True)
    usual = median_filter(evidence[tuple(nearest)], size=5, mode="nearest")
    # without contrast between cells there is no line to compare with
    return np.where(usual > 0, usual, np.inf)
