"""Measurement of the centres of grid lines with sub-pixel resolution.

A segment is the part of a line between two neighbouring intersections. The centre of the line is measured at
several places ("stations") of each segment, from grey level profiles across the line. The mean offset and
direction of each segment are then measured from the areas of its pixels, because the interpolation of sharp
edges moves lines that are parallel to the rows of pixels.
"""

from dataclasses import dataclass

import numpy as np

from dic.targets.lattice import LatticeShape
from dic.targets.line_grid.pixel_areas import BRIGHTEST_LINE, offsets_by_area, unit_normals
from dic.targets.sampled_image import GridImage, station_index
from dic.typing import Float, Mask

_SAMPLE_PX = 0.5
_PASSES = 3
# A misfit below this fraction of a line's contrast is always accepted. Even in images without noise, the
# interpolation and the rounding of grey levels cause such a misfit.
_MISFIT_OF_ROUNDING = 0.03
_MOST_BY_AREA_PX = 0.2
"""Largest difference between the offsets from profiles and from areas; beyond it, dirt is likely."""


@dataclass(frozen=True)
class LineTrace:
    """The measured centres of all lines of one direction, divided into segments between intersections."""

    station_px: Float
    """Shape (lines, segments, stations, 2). Measured points on the centres of the lines, px."""
    valid: Mask
    """Shape (lines, segments, stations). True for each measuring place where the profile has the usual
    contrast and shape of a line.
    """


@dataclass(frozen=True)
class _Template:
    """The mean grey level profile of all lines of one direction, made symmetric.

    The profile is scaled to 0 beside the line and 1 on the line.
    """

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
        """Half of the width of the line, including its blurred edges."""
        return float(np.abs(self.offsets_px[self.level > 0.05]).max())

    @property
    def width_px(self) -> float:
        """Width of the line at half of its contrast."""
        return float(np.count_nonzero(self.level > 0.5) * _SAMPLE_PX)

    @property
    def _shapes(self) -> Float:
        slope = np.gradient(self.level, self.offsets_px)
        step = np.cumsum(np.abs(slope)) * _SAMPLE_PX
        widening = self.offsets_px * slope
        return np.column_stack([np.ones_like(step), step - step.mean(), self.level, slope, widening])

    def shading(self, profiles: Float) -> tuple[Float, Float]:
        """Return the gradient of the light across each segment, on the background and on the line.

        Both gradients have the shape (lines, segments, 1), in grey levels per px. The grey level is the
        product of light and reflectance. Therefore the gradient on a dark line is smaller than on the
        background, in proportion to the grey levels. At a single measuring place, a gradient of the light
        looks like an offset of the line. For this reason the gradient is smoothed over neighbouring segments
        and lines. The outermost lines use the gradient of the lines next to them, because the background may
        be different outside the grid.
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
        return beside, beside * np.clip(line_to_ground, 0.0, BRIGHTEST_LINE)

    def shaded(self, shading: tuple[Float, Float]) -> Float:
        """Return the grey levels that the gradient of the light adds to the profiles.

        The argument `shading` is the result of the method `shading`. The result has the shape (lines,
        segments, 1, offsets).
        """
        beside, on_line = (slope[..., None] for slope in shading)
        result: Float = self.offsets_px * (beside + (on_line - beside) * self.level)
        return result

    def offsets(self, profiles: Float) -> tuple[Float, Mask]:
        """Return the offsets c, px, of the lines from the middle of their profiles, and a mask.

        The mask is True for valid offsets. Both arrays have the shape (lines, segments, stations). The
        function ``I(s) ≈ b + e·S(s) + d·T(s) − d·c·T'(s) − w·s·T'(s)`` is fitted to each profile by least
        squares. In this formula, I is the grey level at the distance s from the middle of the profile, T is
        the mean profile, d is the contrast and b is the grey level of the background. The function S is a
        smooth step, the running integral of |T'|. The term e·S allows for a different grey level on each side
        of an outermost line. The term w·s·T' allows for the width of the line, which varies with perspective.
        """
        design = self._shapes
        coefficients = profiles @ np.linalg.pinv(design).T
        misfit = np.sqrt(np.mean((profiles - coefficients @ design.T) ** 2, axis=-1))
        depth = coefficients[..., 2]
        usual_depth = regional_median(depth)
        usual_misfit = np.maximum(4 * regional_median(misfit), _MISFIT_OF_ROUNDING * usual_depth)
        valid = (depth > 0.3 * usual_depth) & (usual_depth > 0) & (misfit < usual_misfit)
        # Use the median of the contrast d over the segment, because the value of a single station is noisy.
        segment_depth = median_where(valid, depth, fallback=np.inf)
        offsets = -coefficients[..., 3] / segment_depth
        valid &= np.abs(offsets) < self.half_width_px
        return np.where(valid, offsets, 0.0), valid


def median_where(mask: Mask, values: Float, fallback: float) -> Float:
    """Return the medians (…, 1), along the last axis, of the `values` (…, n) at which `mask` is True.

    Where the mask has no True element along the last axis, the result is `fallback`.
    """
    some = mask.any(axis=-1, keepdims=True)
    medians: Float = np.nanmedian(
        np.where(some, np.where(mask, values, np.nan), fallback), axis=-1, keepdims=True
    )
    return medians


def regional_median(values: Float) -> Float:
    """Return the median over the measuring places of a segment, then over 7 × 7 neighbouring segments.

    The result has the shape (lines, segments, 1).
    """
    from scipy.ndimage import median_filter

    finite = np.isfinite(values)
    segments = median_where(
        finite, values, fallback=np.nan if not finite.any() else float(np.median(values[finite]))
    )
    usual: Float = median_filter(segments, size=(7, 7, 1), mode="nearest")
    return usual


def trace_lines(image: GridImage, shape: LatticeShape, axis: int, numbers: range, across: range) -> LineTrace:
    """Measure points on the centres of all lines of one direction.

    `image`, `shape`: the image, and the map that predicts the positions of the lattice points in the image,
    with an error of at most about a quarter of the pitch. `axis`: direction of the lines: 0 for lines of
    constant first index, 1 for lines of constant second index. `numbers`: indices of the lines. `across`:
    indices of the lines of the other direction, which divide the lines into segments.

    Notes
    -----
    The function samples grey level profiles across the predicted lines. The mean profile of all lines is
    fitted to each profile, which gives the offset of the line. The measuring place is moved by this offset.
    Sampling, fitting and moving are done three times.
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

    near = _offsets_px(min(0.45 * pitch_px, template.half_width_px + 3))
    clear = min(0.35, _clearance_px(shape, axis, middle, template.half_width_px, near[-1]) / along_px)
    count = int(np.clip((1 - 2 * clear) * along_px, 6, 40))
    fractions = np.linspace(clear, 1 - clear, count)
    base, normal = _stations(shape, axis, numbers, across, fractions, pitch_px)
    moved = np.repeat(start[..., :1], count, axis=-1)
    for _ in range(_PASSES):
        profiles = _profiles(image, base + moved[..., None] * normal, normal, near)
        template = _Template.of(profiles, near)
        profiles = profiles - template.shaded(shading)
        offset, valid = template.offsets(profiles)
        measured = moved + offset
        moved = _straightened(measured, valid, fractions, fallback=moved)
    scale = np.linalg.norm(normal[:, :, 0], axis=-1)
    width_px, reach_px = template.width_px * scale, near[-1] * scale
    measured = measured + _more_by_area(image, base + moved[..., None] * normal, normal, width_px, reach_px)
    index = station_index(axis, numbers, across, fractions)
    measured -= pitch_px * _eccentricity(shape, axis, index, template.width_px / pitch_px)
    return LineTrace(base + measured[..., None] * normal, valid)


def _more_by_area(image: GridImage, places: Float, normal: Float, width_px: Float, reach_px: Float) -> Float:
    """Return how much further along their normals the lines are according to the areas of their pixels.

    `places`, shape (lines, segments, stations, 2), are on one straight line in each segment; `normal` as from
    `_stations`. `width_px`, `reach_px`, shape (lines, segments): width of the lines, and how far from the
    lines pixels are used. The result, shape (lines, segments, stations), is 0 where the areas give no offset.
    """
    ends = places[:, :, [0, -1]]
    offset, slope = offsets_by_area(image, ends, reach_px, width_px)
    along = np.linspace(-0.5, 0.5, places.shape[2])
    more_px = offset[..., None] + slope[..., None] * along
    scale = (unit_normals(ends)[:, :, None] * normal).sum(axis=-1)
    return np.where(np.abs(more_px) < _MOST_BY_AREA_PX, more_px / scale, 0.0)


def _offsets_px(reach_px: float) -> Float:
    count = max(4, int(reach_px / _SAMPLE_PX))
    return np.arange(-count, count + 1, dtype=np.float64) * _SAMPLE_PX


def _across(shape: LatticeShape, axis: int, index: Float) -> Float:
    """Return vectors perpendicular to the lines at `index`, as long as the local line spacing in px."""
    tangent = shape.step(index, 1 - axis)
    normal = np.stack([-tangent[..., 1], tangent[..., 0]], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    distance: Float = np.abs((normal * shape.step(index, axis)).sum(axis=-1, keepdims=True))
    return normal * distance


def _stations(
    shape: LatticeShape, axis: int, numbers: range, across: range, fractions: Float, pitch_px: float
) -> tuple[Float, Float]:
    """Return the predicted measuring places on the lines, and the normals of the lines, in px.

    Both arrays have the shape (lines, segments, stations, 2). The length of a normal is the local line
    spacing divided by `pitch_px`. Therefore a profile is longer where perspective makes the lines wider, and
    one mean profile fits all lines.
    """
    index = station_index(axis, numbers, across, fractions)
    return shape.map(index), _across(shape, axis, index) / pitch_px


def _clearance_px(
    shape: LatticeShape, axis: int, index: Float, half_width_px: float, reach_px: float
) -> float:
    """Return the smallest allowed distance, px, between a measuring place and an intersection.

    A profile at this distance from an intersection does not reach the crossing line. In an oblique view, the
    lines do not meet at 90°. Therefore the end of a profile is closer to the crossing line than the middle of
    the profile, by ``reach·cot(angle)``. In the direction of the measured line, the crossing line is wider by
    the factor ``1/sin(angle)``. The crossing lines end soon beyond an outermost line. If a profile of the
    outermost line reaches the crossing lines, its two sides differ, and the measured centre is too far out.
    """
    along, step = shape.step(index, 1 - axis), shape.step(index, axis)
    cross = np.abs(along[..., 0] * step[..., 1] - along[..., 1] * step[..., 0])
    sine = cross / (np.linalg.norm(along, axis=-1) * np.linalg.norm(step, axis=-1))
    cotangent = np.abs((along * step).sum(axis=-1)) / cross
    return float(np.median((half_width_px + 1) / sine + reach_px * cotangent))


def _eccentricity(shape: LatticeShape, axis: int, index: Float, width: float) -> Float:
    """Return how far perspective moves the middle between a line's two edges away from the line's centre.

    In perspective the near half of a line looks wider than the far half. The function projects both edges of
    the line into the image and intersects them with the normal of the line. The edges are at ± `width`/2 from
    the centre. `width` and the result are in pitches.
    """
    centre, normal = shape.map(index), _across(shape, axis, index)
    met = []
    for side in (-0.5, 0.5):
        edge = index.copy()
        edge[..., axis] += side * width
        beside, tangent = shape.map(edge) - centre, shape.step(edge, 1 - axis)
        turned = np.stack([-tangent[..., 1], tangent[..., 0]], axis=-1)
        # The edge is nearly straight. The normal intersects it where turned · (s·normal − beside) = 0.
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
    # The profile of a line is the same at all stations of a segment, so an average suppresses noise and dirt.
    together = uniform_filter1d(np.median(filled, axis=-2), size=5, axis=-1)
    # Wide lines have a flat top. Therefore take the centroid above half height, not the highest sample.
    low, high = together.min(axis=-1, keepdims=True), together.max(axis=-1, keepdims=True)
    above = np.maximum(together - (low + high) / 2, 0.0)
    streak = (above * offsets_px).sum(axis=-1) / np.maximum(above.sum(axis=-1), 1e-9)
    # The error of the prediction changes smoothly along a line; an error from dirt does not. The median
    # removes the errors from dirt.
    usual: Float = median_filter(streak, size=(1, 7), mode="nearest")[..., None]
    return usual


def _straightened(measured: Float, valid: Mask, fractions: Float, fallback: Float) -> Float:
    """Replace the measured offsets of each segment by those of a straight line fitted to them.

    If at most half of the measuring places of a segment are valid, the result is `fallback` in this segment.
    """
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
