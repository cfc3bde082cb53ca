"""Computation of the intersections of grid lines.

A parabola is fitted to each of two crossing lines near their intersection. The result is the intersection of
the two parabolas.
"""

from dataclasses import dataclass

import numpy as np

from dic.targets.line_grid.trace import LineTrace, median_where
from dic.typing import Float, Indices, Mask

# Number of segments of a line to which a parabola is fitted.
_SEGMENTS = 4
# These segments need not be centred on the intersection: they may be shifted by up to `_MOST_SHIFT` segments.
# For each segment of shift, the number of valid segments must increase by `_SHIFT_COSTS`.
_MOST_SHIFT = 2
_SHIFT_COSTS = 0.4
_NEWTON_STEPS = 4
_REJECTIONS = 4


@dataclass(frozen=True)
class _LocalCurve:
    """The parabolas that approximate the grid lines near each intersection, in local axes.

    There are n0 × n1 intersections, and the first two axes of every array are (n0, n1).

    The parabola is ``normal·(p − origin) = q0 + q1·s + q2·s²`` with ``s = tangent·(p − origin)/scale``. In
    this formula, p is a point of the curve, and q0, q1 and q2 are the coefficients.
    """

    origin: Float
    tangent: Float
    normal: Float
    scale: Float
    coefficients: Float
    sound: Mask

    def miss(self, points: Float) -> tuple[Float, Float]:
        """Return the distances (…,) of points (…, 2) from the parabolas, px, and the distances' gradients."""
        relative = points - self.origin
        s = (relative * self.tangent).sum(axis=-1) / self.scale
        q0, q1, q2 = np.moveaxis(self.coefficients, -1, 0)
        distance = (relative * self.normal).sum(axis=-1) - (q0 + (q1 + q2 * s) * s)
        gradient = self.normal - ((q1 + 2 * q2 * s) / self.scale)[..., None] * self.tangent
        return distance, gradient


def intersect(first: LineTrace, second: LineTrace, predicted: Float) -> tuple[Float, Mask]:
    """Return the intersections of the grid lines of the first direction with those of the second direction.

    `first`, `second`: measured lines of the two directions. The first direction has n0 lines of n1 − 1
    segments, the second has n1 lines of n0 − 1 segments. `predicted`, shape (n0, n1, 2): approximate
    intersections, px.

    Returns
    -------
    crossing_px : ndarray, shape (n0, n1, 2)
        The intersections in the image.
    sound : ndarray of bool, shape (n0, n1)
        True if the intersection is reliable: on both lines, most measurements near the intersection are valid
        and lie on the parabola.
    """
    along = _local_curves(first, predicted)
    transposed = _local_curves(second, predicted.transpose(1, 0, 2))
    crossing = _LocalCurve(
        *(np.swapaxes(getattr(transposed, name), 0, 1) for name in _LocalCurve.__dataclass_fields__)
    )
    points = predicted.copy()
    for _ in range(_NEWTON_STEPS):
        (miss_a, slope_a), (miss_b, slope_b) = along.miss(points), crossing.miss(points)
        slopes = np.stack([slope_a, slope_b], axis=-2)
        misses = np.stack([miss_a, miss_b], axis=-1)
        points = points - np.linalg.solve(slopes, misses[..., None])[..., 0]
    return points, along.sound & crossing.sound


def _local_curves(trace: LineTrace, predicted: Float) -> _LocalCurve:
    lines, segments = trace.valid.shape[:2]
    nearby = _windows(trace.valid.mean(axis=-1))
    line = np.arange(lines)[:, None, None]
    stations = trace.station_px[line, nearby].reshape(lines, segments + 1, -1, 2)
    valid = trace.valid[line, nearby].reshape(lines, segments + 1, -1)
    chord = stations[:, :, -1] - stations[:, :, 0]
    scale = np.linalg.norm(chord, axis=-1)
    tangent = chord / scale[..., None]
    normal = np.stack([-tangent[..., 1], tangent[..., 0]], axis=-1)
    relative = stations - predicted[:, :, None]
    s = np.einsum("abkc,abc->abk", relative, tangent) / scale[..., None]
    h = np.einsum("abkc,abc->abk", relative, normal)
    coefficients, kept = _robust_parabolas(s, h, valid)
    sound = (kept.mean(axis=-1) > 0.6) & _visible_nearby(trace.valid)
    return _LocalCurve(predicted, tangent, normal, scale, coefficients, sound)


def _windows(seen: Float) -> Indices:
    """Return the numbers of the four segments used at each intersection, shape (lines, segments + 1, 4).

    Usually two segments on each side of the intersection are used. At the rim of the grid, or where an object
    hides one side, more segments of the other side are used. The argument `seen` (lines, segments) is the
    share of valid measuring places in each segment.
    """
    segments = seen.shape[1]
    used = min(_SEGMENTS, segments)
    centred = np.clip(np.arange(segments + 1) - used // 2, 0, segments - used)
    total = np.lib.stride_tricks.sliding_window_view(seen, used, axis=1).sum(axis=-1)
    best, first = total[:, centred], np.broadcast_to(centred, (len(seen), segments + 1))
    for shift in range(-_MOST_SHIFT, _MOST_SHIFT + 1):
        shifted = np.clip(centred + shift, 0, segments - used)
        score = total[:, shifted] - _SHIFT_COSTS * np.abs(shifted - centred)
        first = np.where(score > best, shifted, first)
        best = np.maximum(score, best)
    return first[..., None] + np.arange(used)


def _visible_nearby(valid: Mask) -> Mask:
    """Return True for each intersection that has valid measuring places next to it on at least one side.

    More than half of the measuring places in the half segment next to the intersection must be valid. The
    result has the shape (lines, segments + 1).
    """
    half = valid.shape[-1] // 2
    none = np.zeros((len(valid), 1), bool)
    before = valid[..., -half:].mean(axis=-1) > 0.5
    after = valid[..., :half].mean(axis=-1) > 0.5
    return np.asarray(np.hstack([none, before]) | np.hstack([after, none]))


def _robust_parabolas(s: Float, h: Float, valid: Mask) -> tuple[Float, Mask]:
    """Fit parabolas by least squares; leave out points farther away than four standard deviations.

    The function returns the coefficients (…, 3) and a mask (…, n) of the points used.
    """
    design = np.stack([np.ones_like(s), s, s * s], axis=-1)
    kept = valid
    for rejection in range(_REJECTIONS + 1):
        weighted = design * kept[..., None]
        normal = np.swapaxes(weighted, -1, -2) @ design + 1e-9 * np.eye(3)
        right = np.swapaxes(weighted, -1, -2) @ h[..., None]
        coefficients = np.linalg.solve(normal, right)[..., 0]
        if rejection < _REJECTIONS:
            deviation = np.abs(h - (design @ coefficients[..., None])[..., 0])
            # 1.5 times the median of the absolute deviations is about one standard deviation.
            kept = valid & (deviation <= 6 * median_where(valid, deviation, fallback=0.0) + 0.01)
    return coefficients.astype(np.float64), kept
