"""Sub-pixel centres of grid lines, measured across each line at many stations."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dic.targets.lattice import LatticeShape
from dic.targets.sampled_image import GridImage, station_index

Floats = NDArray[np.float64]
_SAMPLE_PX = 0.5
_PASSES = 3
# Without noise, what interpolation and grey levels leave over differs from station to station.
_MISFIT_OF_ROUNDING = 0.03
# How many times brighter than the ground a line is taken to be, at most: beyond, the ground says nothing.
_BRIGHTEST_LINE = 4.0


@dataclass(frozen=True)
class LineTrace:
    """All lines of one direction, cut into segments between neighbouring intersections.

    Attributes
    ----------
    station_px : ndarray, shape (lines, segments, stations, 2)
        Points on the lines' centres.
    valid : ndarray of bool, shape (lines, segments, stations)
        Whether a line of the usual contrast and shape was seen there.
    """

    station_px: Floats
    valid: NDArray[np.bool_]


@dataclass(frozen=True)
class _Template:
    """The mean profile of all lines of one direction: symmetric, 0 beside the line and 1 on it."""

    offsets_px: Floats
    level: Floats

    @classmethod
    def of(cls, profiles: Floats, offsets_px: Floats) -> "_Template":
        mean = np.nanmean(profiles.reshape(-1, len(offsets_px)), axis=0)
        symmetric = (mean + mean[::-1]) / 2
        beside = min(symmetric[0], symmetric[1])
        return cls(offsets_px, (symmetric - beside) / (symmetric.max() - beside))

    @property
    def half_width_px(self) -> float:
        """Distance from the middle beyond which the line does not reach."""
        return float(np.abs(self.offsets_px[self.level > 0.05]).max())

    @property
    def width_px(self) -> float:
        """Width at half height."""
        return float(np.count_nonzero(self.level > 0.5) * _SAMPLE_PX)

    @property
    def _shapes(self) -> Floats:
        slope = np.gradient(self.level, self.offsets_px)
        step = np.cumsum(np.abs(slope)) * _SAMPLE_PX
        widening = self.offsets_px * slope
        return np.column_stack([np.ones_like(step), step - step.mean(), self.level, slope, widening])

    def shading(self, profiles: Floats) -> tuple[Floats, Floats]:
        """Return how steeply the light rises across each segment, beside the line and on it.

        Both (lines, segments, 1), grey levels per px. Light multiplies what is printed, so it rises on a dark
        line as much less as the line is darker than the ground. It changes slowly: neighbours share it, and
        one station alone could not tell it from an offset. The outermost lines, beside which the ground
        may differ, take it from the lines next to them.
        """
        from scipy.ndimage import median_filter

        design = np.column_stack([self._shapes, self.offsets_px * (1 - self.level)])
        coefficients = profiles @ np.linalg.pinv(design).T
        ground, depth, beside = (
            median_where(np.isfinite(values), values, fallback=0.0)
            for values in (coefficients[..., 0], coefficients[..., 2], coefficients[..., 5])
        )
        beside = median_filter(beside, size=(3, 3, 1), mode="mirror")
        line_to_ground = 1 + depth / np.where(ground == 0, np.inf, ground)
        return beside, beside * np.clip(line_to_ground, 0.0, _BRIGHTEST_LINE)

    def shaded(self, shading: tuple[Floats, Floats]) -> Floats:
        """Return what such shading adds to profiles, (lines, segments, 1, offsets)."""
        beside, on_line = (slope[..., None] for slope in shading)
        result: Floats = self.offsets_px * (beside + (on_line - beside) * self.level)
        return result

    def offsets(self, profiles: Floats) -> tuple[Floats, NDArray[np.bool_]]:
        """Return the lines' offsets c in px and which of them count, both (lines, segments, stations).

        ``I(s) ≈ b + e·S(s) + d·T(s) − d·c·T'(s) − w·s·T'(s)`` by least squares. T is the template; S, the
        running integral of |T'|, is a step for different brightness on the two sides of the outermost lines;
        s·T' takes up that perspective makes lines wider here and narrower there.
        """
        design = self._shapes
        coefficients = profiles @ np.linalg.pinv(design).T
        misfit = np.sqrt(np.mean((profiles - coefficients @ design.T) ** 2, axis=-1))
        depth = coefficients[..., 2]
        usual_depth = regional_median(depth)
        usual_misfit = np.maximum(4 * regional_median(misfit), _MISFIT_OF_ROUNDING * usual_depth)
        valid = (depth > 0.3 * usual_depth) & (usual_depth > 0) & (misfit < usual_misfit)
        # one station's depth is noisy, and dividing by it would skew its offset
        segment_depth = median_where(valid, depth, fallback=np.inf)
        offsets = -coefficients[..., 3] / segment_depth
        valid &= np.abs(offsets) < self.half_width_px
        return np.where(valid, offsets, 0.0), valid


def median_where(mask: NDArray[np.bool_], values: Floats, fallback: float) -> Floats:
    """Return medians over the last axis, kept, of `values` where `mask`; `fallback` where there are none."""
    some = mask.any(axis=-1, keepdims=True)
    medians: Floats = np.nanmedian(
        np.where(some, np.where(mask, values, np.nan), fallback), axis=-1, keepdims=True
    )
    return medians


def regional_median(values: Floats) -> Floats:
    """Return what is usual around each segment, (lines, segments, 1): light differs across an image."""
    from scipy.ndimage import median_filter

    finite = np.isfinite(values)
    segments = median_where(
        finite, values, fallback=np.nan if not finite.any() else float(np.median(values[finite]))
    )
    usual: Floats = median_filter(segments, size=(7, 7, 1), mode="nearest")
    return usual


def trace_lines(image: GridImage, shape: LatticeShape, axis: int, numbers: range, across: range) -> LineTrace:
    """Measure the centres of all lines of one direction.

    Parameters
    ----------
    image, shape
        The image and where the lattice lies in it, to about a quarter of the pitch.
    axis : int
        0 for the lines of constant first index, 1 for those of constant second index.
    numbers : range
        Indices of the lines.
    across : range
        Indices of the lines of the other direction, which bound the segments.

    Notes
    -----
    Profiles across the predicted lines are compared with the mean profile of all of them; the stations are
    moved by what the comparison says and measured again until the rest is small against a line's width.
    """
    middle = station_index(axis, numbers, across, np.array([0.5]))
    pitch_px = float(np.median(np.linalg.norm(_across(shape, axis, middle), axis=-1)))
    along_px = float(np.median(np.linalg.norm(shape.step(middle, 1 - axis), axis=-1)))

    fractions = np.linspace(0.35, 0.65, 9)
    base, normal = _stations(shape, axis, numbers, across, fractions, pitch_px)
    wide = _offsets_px(0.36 * pitch_px)
    start = _coarse_offsets(_profiles(image, base, normal, wide), wide)
    wide = _offsets_px(0.45 * pitch_px)
    profiles = _profiles(image, base + start[..., None] * normal, normal, wide)
    template = _Template.of(profiles, wide)
    shading = template.shading(profiles)

    clear = min(0.35, (template.half_width_px + 1) / along_px)
    count = int(np.clip((1 - 2 * clear) * along_px, 6, 40))
    fractions = np.linspace(clear, 1 - clear, count)
    base, normal = _stations(shape, axis, numbers, across, fractions, pitch_px)
    moved = np.repeat(start[..., :1], count, axis=-1)
    near = _offsets_px(min(0.45 * pitch_px, template.half_width_px + 3))
    for _ in range(_PASSES):
        profiles = _profiles(image, base + moved[..., None] * normal, normal, near)
        template = _Template.of(profiles, near)
        profiles = profiles - template.shaded(shading)
        offset, valid = template.offsets(profiles)
        measured = moved + offset
        moved = _straightened(measured, valid, fractions, fallback=moved)
    index = station_index(axis, numbers, across, fractions)
    measured -= pitch_px * _eccentricity(shape, axis, index, template.width_px / pitch_px)
    return LineTrace(base + measured[..., None] * normal, valid)


def _offsets_px(reach_px: float) -> Floats:
    count = max(4, int(reach_px / _SAMPLE_PX))
    return np.arange(-count, count + 1, dtype=np.float64) * _SAMPLE_PX


def _across(shape: LatticeShape, axis: int, index: Floats) -> Floats:
    """Return the vectors perpendicular to the lines at `index`, as long as the distance of the lines, px."""
    tangent = shape.step(index, 1 - axis)
    normal = np.stack([-tangent[..., 1], tangent[..., 0]], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    distance: Floats = np.abs((normal * shape.step(index, axis)).sum(axis=-1, keepdims=True))
    return normal * distance


def _stations(
    shape: LatticeShape, axis: int, numbers: range, across: range, fractions: Floats, pitch_px: float
) -> tuple[Floats, Floats]:
    """Return predicted stations and normals, both (lines, segments, stations, 2), in px.

    Where perspective shows the grid larger than its usual `pitch_px`, normals are longer than 1, so that one
    template fits lines that are wider there.
    """
    index = station_index(axis, numbers, across, fractions)
    return shape.map(index), _across(shape, axis, index) / pitch_px


def _eccentricity(shape: LatticeShape, axis: int, index: Floats, width: float) -> Floats:
    """Return how far the middle between a line's edges lies from the image of the line's middle.

    In perspective the near half of a line looks wider than the far half. Both edges, `width`/2 on either side
    in pitches, are carried to the image and met along the normal; the result is in pitches as well.
    """
    centre, normal = shape.map(index), _across(shape, axis, index)
    met = []
    for side in (-0.5, 0.5):
        edge = index.copy()
        edge[..., axis] += side * width
        beside, tangent = shape.map(edge) - centre, shape.step(edge, 1 - axis)
        turned = np.stack([-tangent[..., 1], tangent[..., 0]], axis=-1)
        # the edge, straight on this scale, meets the normal where turned · (s·normal − beside) = 0
        met.append((turned * beside).sum(axis=-1) / (turned * normal).sum(axis=-1))
    middle: Floats = (met[0] + met[1]) / 2
    return middle


def _profiles(image: GridImage, base: Floats, normal: Floats, offsets_px: Floats) -> Floats:
    return image.sample(base[..., None, :] + offsets_px[:, None] * normal[..., None, :])


def _coarse_offsets(profiles: Floats, offsets_px: Floats) -> Floats:
    """Return for each segment the middle of its bright streak, (lines, segments, 1), px."""
    from scipy.ndimage import median_filter, uniform_filter1d

    inside = np.isfinite(profiles)
    filled = np.where(inside, profiles, profiles[inside].min())
    # the same streak at all stations of a segment: their mean hides noise and dirt
    together = uniform_filter1d(np.median(filled, axis=-2), size=5, axis=-1)
    # wide lines are flat on top: the middle of what rises above half height, not the highest sample
    low, high = together.min(axis=-1, keepdims=True), together.max(axis=-1, keepdims=True)
    above = np.maximum(together - (low + high) / 2, 0.0)
    streak = (above * offsets_px).sum(axis=-1) / np.maximum(above.sum(axis=-1), 1e-9)
    # the prediction errs smoothly along a line, dirt does not
    usual: Floats = median_filter(streak, size=(1, 7), mode="nearest")[..., None]
    return usual


def _straightened(measured: Floats, valid: NDArray[np.bool_], fractions: Floats, fallback: Floats) -> Floats:
    """Return a straight line through the offsets of each segment; with few stations, `fallback`."""
    t = fractions - fractions.mean()
    weight = valid.astype(float)
    count = weight.sum(axis=-1, keepdims=True)
    enough = count > len(t) / 2
    count = np.maximum(count, 1)
    mean_t = (weight * t).sum(axis=-1, keepdims=True) / count
    mean = (weight * measured).sum(axis=-1, keepdims=True) / count
    spread = (weight * (t - mean_t) ** 2).sum(axis=-1, keepdims=True)
    slope = (weight * (t - mean_t) * measured).sum(axis=-1, keepdims=True) / np.maximum(spread, 1e-9)
    return np.where(enough, mean + slope * (t - mean_t), fallback)
