"""Intersections of traced lines: a local parabola through each line, and where the two cross."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dic.targets.line_grid.trace import LineTrace, median_where

Floats = NDArray[np.float64]
_SEGMENTS = 4
# A window moves off centre for stations of at least this part of a segment more, per segment.
_MOST_SHIFT = 2
_SHIFT_COSTS = 0.4
_NEWTON_STEPS = 4
_REJECTIONS = 4


@dataclass(frozen=True)
class _LocalCurve:
    """``normal·(p − origin) = q0 + q1·s + q2·s²``, ``s = tangent·(p − origin)/scale``, per intersection."""

    origin: Floats
    tangent: Floats
    normal: Floats
    scale: Floats
    coefficients: Floats
    sound: NDArray[np.bool_]

    def miss(self, points: Floats) -> tuple[Floats, Floats]:
        """Return the distance of points (n, 2) from the curve (n,) and its gradient (n, 2)."""
        relative = points - self.origin
        s = (relative * self.tangent).sum(axis=-1) / self.scale
        q0, q1, q2 = np.moveaxis(self.coefficients, -1, 0)
        distance = (relative * self.normal).sum(axis=-1) - (q0 + (q1 + q2 * s) * s)
        gradient = self.normal - ((q1 + 2 * q2 * s) / self.scale)[..., None] * self.tangent
        return distance, gradient


def intersect(first: LineTrace, second: LineTrace, predicted: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """Return where the lines of two directions cross.

    Parameters
    ----------
    first, second : LineTrace
        (n0 lines, n1 − 1 segments, …) and (n1 lines, n0 − 1 segments, …).
    predicted : ndarray, shape (n0, n1, 2)
        Roughly where, px.

    Returns
    -------
    crossing_px : ndarray, shape (n0, n1, 2)
    sound : ndarray of bool, shape (n0, n1)
        Whether most stations on the nearest segments of both lines were seen and lie on a smooth curve.
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


def _local_curves(trace: LineTrace, predicted: Floats) -> _LocalCurve:
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
    sound = (kept.mean(axis=-1) > 0.6) & _touched(trace.valid)
    return _LocalCurve(predicted, tangent, normal, scale, coefficients, sound)


def _windows(seen: Floats) -> NDArray[np.int64]:
    """Return the segments whose stations describe each line at each intersection, (lines, segments + 1, 4).

    Two on either side; where something hides those of one side, more of the other, as at the grid's rim.
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


def _touched(valid: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Tell at which intersections a line is seen close by on at least one side, (lines, segments + 1)."""
    half = valid.shape[-1] // 2
    none = np.zeros((len(valid), 1), bool)
    before = valid[..., -half:].mean(axis=-1) > 0.5
    after = valid[..., :half].mean(axis=-1) > 0.5
    return np.asarray(np.hstack([none, before]) | np.hstack([after, none]))


def _robust_parabolas(s: Floats, h: Floats, valid: NDArray[np.bool_]) -> tuple[Floats, NDArray[np.bool_]]:
    """Return least-squares parabolas (…, 3) and the stations kept, those within four standard deviations."""
    design = np.stack([np.ones_like(s), s, s * s], axis=-1)
    kept = valid
    for rejection in range(_REJECTIONS + 1):
        weighted = design * kept[..., None]
        normal = np.swapaxes(weighted, -1, -2) @ design + 1e-9 * np.eye(3)
        right = np.swapaxes(weighted, -1, -2) @ h[..., None]
        coefficients = np.linalg.solve(normal, right)[..., 0]
        if rejection < _REJECTIONS:
            deviation = np.abs(h - (design @ coefficients[..., None])[..., 0])
            # 1.5 times the median deviation is about one standard deviation
            kept = valid & (deviation <= 6 * median_where(valid, deviation, fallback=0.0) + 0.01)
    return coefficients.astype(np.float64), kept
