"""Decide which predicted grid lines are really in the image, and so determine the number of lines.

A segment is the part of a line between two neighbouring intersections.
"""

import numpy as np

from dic.targets.cells import CellLattice
from dic.targets.lattice import LatticeShape
from dic.targets.line_grid.trace import median_where
from dic.targets.sampled_image import GridImage, line_evidence, line_irregularity, profiles_across
from dic.typing import Float, Indices, Mask

# Smallest contrast of a segment, and of a whole line, as fractions of the usual contrast. The usual contrast
# is that of the lines between found cells.
_SEGMENT_SEEN = 0.4
_LINE_SEEN = 0.3
# Smallest number of visible segments in a line, as a fraction of the number in a complete line. The outer
# lines of a grid reach 0.9. One pitch outside the grid, speckles reach up to 0.7 by chance.
_MOST_SEGMENTS = 0.75
# Largest value of `line_irregularity` for true lines.
_IRREGULAR = 0.25
# In a partly hidden line, at least the share `_PARTLY_SEEN` of the segments is visible, and at least `_RUN`
# neighbouring segments are visible. Beside a grid, speckles reach a share of 0.1 by chance.
_PARTLY_SEEN = 0.25
_RUN = 3
# The typical profile must explain at least this share of a profile's variance. The typical profile may be
# shifted by up to `_SHIFT` samples.
_AGREEMENT = 0.6
_SHIFT = 3
# Number of rows of cells at the rim of the grid that `find_cells` may have missed.
_BEYOND = 2


def line_extents(image: GridImage, shape: LatticeShape, cells: CellLattice) -> tuple[range, range]:
    """Return the indices of the lines that are really in the image, for both directions.

    The cells do not determine the number of lines: cells at the rim may be missing, and there may be
    false cells beyond the rim. The lattice of the cells predicts where each line should lie. A line
    counts if it is visible in most of its segments, and if the median of the grey level profiles across
    these segments still shows a line. The median shows a line only if most segments have about the same
    offset from the prediction; the offsets of speckles beside the grid are random. Outer lines that are
    partly hidden are added afterwards. If there are no lines between the cells, both ranges are empty.
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
        visible = np.flatnonzero(_visible_lines(profiles, between))
        like_lines = _segments_of_lines(profiles, between)
        first, last = _with_partly_hidden_lines(like_lines, int(visible[0]), int(visible[-1]))
        found.append(range(int(low[axis]) + first, int(low[axis]) + last + 1))
    return found[0], found[1]


def _between_cells(cells: CellLattice, axis: int, low: Indices, shape: tuple[int, ...]) -> Mask:
    """Return True for each segment, shape (lines, segments), that lies between two found cells."""
    known = {(int(i), int(j)) for i, j in cells.index}
    between = np.zeros(shape, bool)
    for i, j in known:
        if ((i - 1, j) if axis == 0 else (i, j - 1)) in known:
            at = (i - low[0], j - low[1])
            between[at if axis == 0 else at[::-1]] = True
    return between


def _visible_lines(profiles: Float, between: Mask) -> Mask:
    """Return True for each line that is visible in the image, shape (lines,).

    The grey level profiles across the lines have the shape (lines, segments, stations, offsets).
    """
    usual = _usual_evidence(line_evidence(profiles), between)
    # Use only segments within the grid. If the grid is small, most of the other segments lie outside the
    # grid.
    within = between.any(axis=0)
    relative = (profiles / usual[..., None, None])[:, within]
    segments = (line_evidence(relative) > _SEGMENT_SEEN).sum(axis=1)
    together = np.moveaxis(relative, 1, -1)
    whole = median_where(np.isfinite(together), together, fallback=0.0)[..., 0]
    most = np.sort(segments)[-max(1, len(segments) // 4)]
    result: Mask = (segments > _MOST_SEGMENTS * most) & (line_evidence(whole) > _LINE_SEEN)
    return result if np.any(result) else np.asarray(between.any(axis=1))


def _with_partly_hidden_lines(like_lines: Mask, first: int, last: int) -> tuple[int, int]:
    """Return the numbers of the first and the last line, including outer lines that are partly hidden.

    `like_lines`, shape (lines, segments): True for the segments that look like a line, from
    `_segments_of_lines`. `first`, `last`: numbers of the outermost lines that are mostly visible.
    """
    share = like_lines.mean(axis=1)
    run = np.lib.stride_tricks.sliding_window_view(like_lines, min(_RUN, like_lines.shape[1]), axis=1)
    partly = (share > _PARTLY_SEEN) & run.all(axis=-1).any(axis=-1)
    while first > 0 and partly[first - 1]:
        first -= 1
    while last < len(partly) - 1 and partly[last + 1]:
        last += 1
    return first, last


def _segments_of_lines(profiles: Float, between: Mask) -> Mask:
    """Return True for each segment, shape (lines, segments), with profiles like those of a known line.

    A segment between two found cells is certainly part of a line. Every segment has grey level profiles at
    three places. A segment counts as a line only if all three profiles have about the shape and the contrast
    of the certain segments. Speckles may look like a line at one place, but not at all three.
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
        height = smooth @ shifted / max(float(shifted @ shifted), 1e-12)
        rest = smooth - height[..., None] * shifted
        agreement = 1 - (rest**2).sum(axis=-1) / np.maximum((smooth**2).sum(axis=-1), 1e-12)
        sized = (height > 0.5) & (height < 2.0)
        best = np.maximum(best, np.where(sized, agreement, -np.inf).min(axis=-1))
    result: Mask = best > _AGREEMENT
    return result


def _usual_evidence(evidence: Float, between: Mask) -> Float:
    """Return for every segment the median contrast of the nearest segments between found cells."""
    from scipy.ndimage import distance_transform_edt, median_filter

    nearest = distance_transform_edt(~between, return_distances=False, return_indices=True)
    usual = median_filter(evidence[tuple(nearest)], size=5, mode="nearest")
    # Where there is no contrast, return infinity, so that no segment there counts as a line.
    return np.where(usual > 0, usual, np.inf)
