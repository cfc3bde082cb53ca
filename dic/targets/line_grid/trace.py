"""Sub-pixel centres of grid lines, measured across each line at many stations."""

from dataclasses import dataclass

import numpy as np

from dic.targets.lattice import LatticeShape
from dic.targets.sampled_image import GridImage, station_index
from dic.typing import Float, Mask

_SAMPLE_PX = 0.5
_PASSES = 3
# A misfit below this fraction of a line's depth is always accepted: interpolation and rounding of grey levels
# cause it in images without noise.
_MISFIT_OF_ROUNDING = 0.03
# Upper limit of the brightness of a line relative to the background. A larger ratio means that the background
# is too dark to be measured.
_BRIGHTEST_LINE = 4.0


@dataclass(frozen=True)
class LineTrace:
    """All lines of one direction, divided into segments between neighbouring intersections.

    Attributes
    ----------
    station_px : ndarray, shape (lines, segments, stations, 2)
        Measured points on the centre lines, px.
    valid : ndarray of bool, shape (lines, segments, stations)
        True where the profile has the usual contrast and shape of a line.
    """

    station_px: Float
    valid: Mask


@dataclass(frozen=True)
class _Template:
    """The mean profile of all lines of one direction, made symmetric; 0 beside the line and 1 on it."""

    offsets_px: Float
    level: Float

    @classmethod
    def of(cls, profiles: Float, offsets_px: Float) -> "_Template":
        mean = np.nanmean(profiles.reshape(-1, len(offsets_px)), axis=0)
        symmetric = (mean + mean[::-1]) / 2
        beside = min(symmetric[0], symmetric[1])
        return cls(offsets_px, (symmetric - beside) / (symmetric.max() - beside))

    @property
    def half_width_px(self) -> float:
        """Half of the full width of the line."""
        return float(np.abs(self.offsets_px[self.level > 0.05]).max())

    @property
    def width_px(self) -> float:
        """Width of the line at half height."""
        return float(np.count_nonzero(self.level > 0.5) * _SAMPLE_PX)

    @property
    def _shapes(self) -> Float:
        slope = np.gradient(self.level, self.offsets_px)
        step = np.cumsum(np.abs(slope)) * _SAMPLE_PX
        widening = self.offsets_px * slope
        return np.column_stack([np.ones_like(step), step - step.mean(), self.level, slope, widening])

    def shading(self, profiles: Float) -> tuple[Float, Float]:
        """Return the gradient of the light across each segment: on the background and on the line.

        Both have the shape (lines, segments, 1), in grey levels per px. Light multiplies the reflectance, so
        the gradient on a dark line is smaller, in proportion to the line's grey level. One station alone
        cannot tell a gradient from an offset of the line. So the gradient is smoothed over neighbouring
        segments and lines. The outermost lines use the gradient of the lines next to them, because the
        background may change beyond the grid's rim.
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

    def shaded(self, shading: tuple[Float, Float]) -> Float:
        """Return the grey levels (lines, segments, 1, offsets) that `shading` adds to profiles."""
        beside, on_line = (slope[..., None] for slope in shading)
        result: Float = self.offsets_px * (beside + (on_line - beside) * self.level)
        return result

    def offsets(self, profiles: Float) -> tuple[Float, Mask]:
        """Return the lines' offsets c in px, and which of them are valid, both (lines, segments, stations).

        ``I(s) ≈ b + e·S(s) + d·T(s) − d·c·T'(s) − w·s·T'(s)`` is fitted by least squares. T is the template.
        S, the running integral of |T'|, is a step. It allows for different brightness on the two sides of an
        outermost line. The term w·s·T' allows for the width of the line, which varies with perspective.
        """
        design = self._shapes
        coefficients = profiles @ np.linalg.pinv(design).T
        misfit = np.sqrt(np.mean((profiles - coefficients @ design.T) ** 2, axis=-1))
        depth = coefficients[..., 2]
        usual_depth = regional_median(depth)
        usual_misfit = np.maximum(4 * regional_median(misfit), _MISFIT_OF_ROUNDING * usual_depth)
        valid = (depth > 0.3 * usual_depth) & (usual_depth > 0) & (misfit < usual_misfit)
        # the median over the segment, because the depth d of one station is noisy
        segment_depth = median_where(valid, depth, fallback=np.inf)
        offsets = -coefficients[..., 3] / segment_depth
        valid &= np.abs(offsets) < self.half_width_px
        return np.where(valid, offsets, 0.0), valid


def median_where(mask: Mask, values: Float, fallback: float) -> Float:
    """Return the medians (…, 1) of `values` (…, n) where `mask` is True; `fallback` where it is all False."""
    some = mask.any(axis=-1, keepdims=True)
    medians: Float = np.nanmedian(
        np.where(some, np.where(mask, values, np.nan), fallback), axis=-1, keepdims=True
    )
    return medians


def regional_median(values: Float) -> Float:
    """Return the median over stations and over 7 × 7 lines and segments, (lines, segments, 1)."""
    from scipy.ndimage import median_filter

    finite = np.isfinite(values)
    segments = median_where(
        finite, values, fallback=np.nan if not finite.any() else float(np.median(values[finite]))
    )
    usual: Float = median_filter(segments, size=(7, 7, 1), mode="nearest")
    return usual


def trace_lines(image: GridImage, shape: LatticeShape, axis: int, numbers: range, across: range) -> LineTrace:
    """Measure points on the centres of all lines of one direction.

    Parameters
    ----------
    image, shape
        The image, and the map that predicts where the lattice lies in it, to about a quarter of the pitch.
    axis : int
        0 for the lines of constant first index, 1 for those of constant second index.
    numbers : range
        Indices of the lines.
    across : range
        Indices of the lines of the other direction, which bound the segments.

    Notes
    -----
    Profiles are sampled across the predicted lines. Their offsets from the mean profile of all lines are
    fitted, and the stations are moved by them. This is done three times.
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


def _offsets_px(reach_px: float) -> Float:
    count = max(4, int(reach_px / _SAMPLE_PX))
    return np.arange(-count, count + 1, dtype=np.float64) * _SAMPLE_PX


def _across(shape: LatticeShape, axis: int, index: Float) -> Float:
    """Return vectors perpendicular to the lines at `index`; their length is the line spacing there, px."""
    tangent = shape.step(index, 1 - axis)
    normal = np.stack([-tangent[..., 1], tangent[..., 0]], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    distance: Float = np.abs((normal * shape.step(index, axis)).sum(axis=-1, keepdims=True))
    return normal * distance


def _stations(
    shape: LatticeShape, axis: int, numbers: range, across: range, fractions: Float, pitch_px: float
) -> tuple[Float, Float]:
    """Return predicted stations and normals, both (lines, segments, stations, 2), in px.

    The length of a normal is the local line spacing divided by `pitch_px`. So profiles are stretched where
    perspective makes lines wider, and one template fits all of them.
    """
    index = station_index(axis, numbers, across, fractions)
    return shape.map(index), _across(shape, axis, index) / pitch_px


def _eccentricity(shape: LatticeShape, axis: int, index: Float, width: float) -> Float:
    """Return the distance of the middle between a line's edges from the image of the line's centre.

    In perspective the near half of a line looks wider than the far half. Both edges, ± `width`/2 from the
    centre, are projected into the image and intersected with the normal. `width` and the result are in
    pitches.
    """
    centre, normal = shape.map(index), _across(shape, axis, index)
    met = []
    for side in (-0.5, 0.5):
        edge = index.copy()
        edge[..., axis] += side * width
        beside, tangent = shape.map(edge) - centre, shape.step(edge, 1 - axis)
        turned = np.stack([-tangent[..., 1], tangent[..., 0]], axis=-1)
        # the edge is straight on this scale: it meets the normal where turned · (s·normal − beside) = 0
        met.append((turned * beside).sum(axis=-1) / (turned * normal).sum(axis=-1))
    middle: Float = (met[0] + met[1]) / 2
    return middle


def _profiles(image: GridImage, base: Float, normal: Float, offsets_px: Float) -> Float:
    return image.sample(base[..., None, :] + offsets_px[:, None] * normal[..., None, :])


def _coarse_offsets(profiles: Float, offsets_px: Float) -> Float:
    """Return the approximate offset of the line in each segment, (lines, segments, 1), px."""
    from scipy.ndimage import median_filter, uniform_filter1d

    inside = np.isfinite(profiles)
    filled = np.where(inside, profiles, profiles[inside].min())
    # the line is the same at all stations of a segment, so averages suppress noise and dirt
    together = uniform_filter1d(np.median(filled, axis=-2), size=5, axis=-1)
    # wide lines have a flat top, so take the centroid above half height and not the highest sample
    low, high = together.min(axis=-1, keepdims=True), together.max(axis=-1, keepdims=True)
    above = np.maximum(together - (low + high) / 2, 0.0)
    streak = (above * offsets_px).sum(axis=-1) / np.maximum(above.sum(axis=-1), 1e-9)
    # the error of the prediction changes smoothly along a line, dirt does not: a median removes dirt
    usual: Float = median_filter(streak, size=(1, 7), mode="nearest")[..., None]
    return usual


def _straightened(measured: Float, valid: Mask, fractions: Float, fallback: Float) -> Float:
    """Return the offsets on a straight line fitted to each segment; `fallback` if few stations are valid."""
    t = fractions - fractions.mean()
    weight = valid.astype(float)
    count = weight.sum(axis=-1, keepdims=True)
    enough = count > len(t) / 2
    count = np.maximum(count, 1)
    mean_t = (weight * t).sum(axis=-1, keepdims=True) / count
    mean = (weight * measured).sum(axis=-1, keepdims=True) / count
    variance = (weight * (t - mean_t) ** 2).sum(axis=-1, keepdims=True)
    slope = (weight * (t - mean_t) * measured).sum(axis=-1, keepdims=True) / np.maximum(variance, 1e-9)
    return np.where(enough, mean + slope * (t - mean_t), fallback)
