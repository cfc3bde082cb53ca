"""The offsets of grid lines from the areas that they cover in the pixels.

A pixel measures the mean of the light on its area. Where a line with sharp edges is parallel to the rows or
columns of pixels, interpolated grey levels are wrong in the same way at all places of the line, and the line
is found up to 0.05 px away. Here, a line with two straight edges, blurred by the lens, is integrated over the
areas of the pixels and fitted to the grey levels themselves, without interpolation. Blur and width are
common to all lines of one direction.
"""

from dataclasses import dataclass

import numpy as np

from dic.targets.sampled_image import GridImage
from dic.typing import Float, Mask

_ROUNDS = 10
_SMALL_PX = 1e-3
"""The fit ends if no line moves by more; the next step would be much smaller still."""
_SOME_PIXELS, _MOST_PIXELS = 300, 4000
"""Numbers of pixels of a segment that are enough to come near the result, and for the last step."""
_LEAST_PIXELS = 24
_OWN = 7
"""Number of unknowns of a segment."""
_FAR = 7.0
"""Standard deviations of the blur beyond which an edge has no effect; the density there is 1e-11."""
_BLUR_PX2, _LEAST_BLUR_PX2, _MOST_BLUR_PX2 = 0.1, 1e-4, 9.0
"""First, smallest and largest variance of the blur."""
_MOST_STEP_PX = 0.3
_MOST_WIDENING = 0.2
_LEAST_SINE = 1e-3
_NOISE_TIMES, _SHARE_OF_CONTRAST = 4.0, 0.15
"""A pixel is left out if its misfit exceeds this multiple of the noise plus this share of the contrast."""
BRIGHTEST_LINE = 4.0
"""Largest grey level of a line divided by that of the background. Beyond it the background is too dark."""
_STEP_OF_CONTRAST = 0.02
"""Expected step of the background across an inner line, as a share of the contrast."""


@dataclass(frozen=True)
class Corridors:
    """The pixels beside the segments of the lines of one direction.

    S segments are listed line by line. Each has up to P pixels; unused places of the arrays are False in
    `used`.
    """

    used: Mask
    """Shape (S, P)."""
    grey: Float
    """Shape (S, P). Grey level; the lines are bright."""
    distance_px: Float
    """Shape (S, P). Distance of the pixel's centre from the expected centre of the line."""
    along: Float
    """Shape (S, P). Place along the segment, from −½ to ½."""
    normal: Float
    """Shape (S, 2). Unit normals of the segments."""
    spacing_px: Float
    """Shape (lines, segments). Distance to the next line in the direction of the normal."""

    @classmethod
    def of(cls, image: GridImage, ends_px: Float, reach_px: Float, most: int = _MOST_PIXELS) -> "Corridors":
        """Return the pixels near segments.

        `ends_px`, shape (lines, segments, 2, 2): expected ends of the segments. `reach_px`, shape (lines,
        segments): largest distance of a pixel's centre from the line. `most`: number of pixels of a segment
        of which every second row or fewer are used.
        """
        length_px = np.linalg.norm(ends_px[..., 1, :] - ends_px[..., 0, :], axis=-1)
        normal = unit_normals(ends_px)
        step = np.gradient(ends_px.mean(axis=-2), axis=0)
        segments = ends_px.reshape(-1, 2, 2), normal.reshape(-1, 2), length_px.ravel(), reach_px.ravel()
        strips = [_strip(image, most, *segment) for segment in zip(*segments, strict=True)]
        used = np.arange(max(strip.shape[1] for strip in strips)) < [[strip.shape[1]] for strip in strips]
        pixels = np.zeros((3, *used.shape))
        pixels[:, used] = np.concatenate(strips, axis=1)
        grey, distance_px, along = pixels
        spacing_px = (step * normal).sum(axis=-1)
        return cls(used, grey, distance_px, along, normal.reshape(-1, 2), spacing_px)


def unit_normals(ends_px: Float) -> Float:
    """Return the unit normals (…, 2) of segments between two ends (…, 2, 2)."""
    chord = ends_px[..., 1, :] - ends_px[..., 0, :]
    turned = np.stack([-chord[..., 1], chord[..., 0]], axis=-1)
    return np.asarray(turned / np.linalg.norm(turned, axis=-1, keepdims=True))


def _strip(
    image: GridImage, most: int, ends_px: Float, normal: Float, length_px: float, reach_px: float
) -> Float:
    """Return grey level, distance from the line, and place along it of the pixels near a segment."""
    low, grey = image.window(ends_px.min(axis=0) - reach_px, ends_px.max(axis=0) + reach_px)
    y, x = np.indices(grey.shape)
    across_x, across_y = x + low[0] - ends_px[:, 0].mean(), y + low[1] - ends_px[:, 1].mean()
    distance_px = across_x * normal[0] + across_y * normal[1]
    along = (across_x * normal[1] - across_y * normal[0]) / length_px
    inside = (np.abs(distance_px) <= reach_px) & (np.abs(along) <= 0.5)
    # Leave out whole rows of pixels across the line, because each of the others shows both edges.
    every = -(-int(np.count_nonzero(inside)) // most)
    if every > 1:
        inside &= (y if abs(normal[0]) > abs(normal[1]) else x) % every == 0
    return np.stack([values[inside] for values in (grey, distance_px, along)])


def offsets_by_area(
    image: GridImage, ends_px: Float, reach_px: Float, width_px: Float
) -> tuple[Float, Float]:
    """Return offset and slope of each line from its expected place: offset + slope·along, px.

    The results have the shape (lines, segments), and are NaN if a segment has too few pixels. `ends_px`,
    `reach_px`: as for `Corridors.of`. `width_px`, shape (lines, segments): approximate widths of the lines.
    """
    fit = _Fit(Corridors.of(image, ends_px, reach_px, _SOME_PIXELS), width_px.ravel())
    for _ in range(_ROUNDS):
        if fit.improve() < _SMALL_PX:
            break
    fit.continue_with(Corridors.of(image, ends_px, reach_px))
    fit.improve()
    enough = np.count_nonzero(fit.kept, axis=1) >= _LEAST_PIXELS
    offset, slope = (
        np.where(enough, values, np.nan).reshape(width_px.shape) for values in (fit.offset_px, fit.slope_px)
    )
    return offset, slope


class _Fit:
    """A least-squares fit of all lines of one direction, improved step by step (Gauss-Newton)."""

    def __init__(self, corridors: Corridors, width_px: Float) -> None:
        self._corridors, self._width_px = corridors, width_px
        self._blur_px2, self._noise = _BLUR_PX2, 0.0
        self._depth = self._beside = self._on_line = np.zeros(width_px.size)
        self.offset_px, self.slope_px = np.zeros(width_px.size), np.zeros(width_px.size)
        self._explained = np.zeros((width_px.size, _OWN))
        self.kept, self._judged = corridors.used, True
        inner = np.zeros(corridors.spacing_px.shape)
        inner[1:-1] = 1
        self._inner = inner.ravel()

    def continue_with(self, corridors: Corridors) -> None:
        """Use other pixels of the same segments."""
        self._corridors, self._judged = corridors, False

    def improve(self) -> float:
        """Improve all parameters once; return by how much a line moved at most, px."""
        model = self._model()
        if not self._judged:
            self.kept = self._fitting(model[:, -1] - (self._explained[:, None] @ model[:, :_OWN])[:, 0])
            self._judged = True
        kept = model * self.kept[:, None]
        products = kept @ kept.transpose(0, 2, 1)
        count = _OWN
        inverse = np.linalg.inv(self._determined(products[:, :count, :count]))
        solved = inverse @ products[:, :count, count:]
        depth = solved[:, 2, -1]
        # Blur and width explain what the segments' own coefficients leave, in proportion to the contrast.
        rest = products[:, count:, count:] - products[:, count:, :count] @ solved
        normal = np.einsum("s,sij->ij", depth**2, rest[:, :2, :2])
        right = np.einsum("s,si->i", depth, rest[:, :2, 2])
        change = np.linalg.solve(normal + 1e-12 * max(1.0, np.trace(normal)) * np.eye(2), right)
        coefficients = solved[:, :, -1] - depth[:, None] * (solved[:, :, :2] @ change)
        explained = np.concatenate([coefficients, depth[:, None] * change], axis=1)[:, None]
        misfit = model[:, -1] - (explained @ model[:, :-1])[:, 0]
        return self._apply(coefficients, change, misfit)

    def _model(self) -> Float:
        """Return the derivatives by all unknowns, and grey levels without the light across the lines.

        Shape (S, 10, P). The first seven belong to the unknowns of a segment: background, its step across the
        line, contrast, offset and slope times contrast, light along background and line. Two more, divided by
        the contrast, belong to blur and width. The last has the grey levels.
        """
        c = self._corridors
        s = c.distance_px - self.offset_px[:, None] - self.slope_px[:, None] * c.along
        half, sines = self._width_px[:, None] / 2, np.abs(c.normal)
        first, first_slope, first_bend = _edge(s + half, sines, self._blur_px2)
        second, second_slope, second_bend = _edge(s - half, sines, self._blur_px2)
        model = np.empty((len(s), _OWN + 3, s.shape[1]))
        model[:, 0], model[:, 1] = 1, first + second - 1
        level, moved = np.subtract(first, second, out=model[:, 2]), model[:, 3]
        np.subtract(second_slope, first_slope, out=moved)
        model[:, 4], model[:, 5], model[:, 6] = moved * c.along, c.along, c.along * level
        model[:, 7], model[:, 8] = (first_bend - second_bend) / 2, (first_slope + second_slope) * half
        light = c.distance_px * (self._beside[:, None] + (self._on_line - self._beside)[:, None] * level)
        np.subtract(c.grey, light, out=model[:, 9])
        return model

    def _determined(self, normal: Float) -> Float:
        """Return the segments' normal matrices (S, 7, 7), with what is known before the fit."""
        # A segment without pixels gets coefficients of 0.
        least = (1e-9 * np.trace(normal, axis1=1, axis2=2) + 1e-12)[:, None, None]
        result: Float = normal + least * np.eye(normal.shape[-1])
        # A step of the background looks much like an offset.
        step = _STEP_OF_CONTRAST * np.abs(self._depth)
        result[:, 1, 1] += self._inner * np.where(step > 0, self._noise / np.where(step > 0, step, 1), 0) ** 2
        return result

    def _apply(self, coefficients: Float, change: Float, misfit: Float) -> float:
        ground, depth = coefficients[:, 0], coefficients[:, 2]
        moved = coefficients[:, 3:5] / np.where(depth == 0, np.inf, depth)[:, None]
        moved = np.clip(moved, -_MOST_STEP_PX, _MOST_STEP_PX)
        self.offset_px, self.slope_px = self.offset_px + moved[:, 0], self.slope_px + moved[:, 1]
        least = max(_LEAST_BLUR_PX2, self._blur_px2 / 4)
        self._blur_px2 = float(np.clip(self._blur_px2 + change[0], least, _MOST_BLUR_PX2))
        self._width_px = self._width_px * (1 + float(np.clip(change[1], -_MOST_WIDENING, _MOST_WIDENING)))
        spacing_px = self._corridors.spacing_px
        self._beside = _light(ground.reshape(spacing_px.shape), spacing_px)
        on_line = 1 + depth / np.where(ground == 0, np.inf, ground)
        self._on_line = self._beside * np.clip(on_line, 0, BRIGHTEST_LINE)
        self._depth, left = depth, np.abs(misfit)[self.kept]
        self._noise = float(np.median(left)) / 0.6745 if left.size else 0.0
        self.kept = self._fitting(misfit)
        # The next model has these moves.
        self._explained = coefficients * [1, 1, 1, 0, 0, 1, 1]
        return float(np.abs(moved).max())

    def _fitting(self, misfit: Float) -> Mask:
        """Return the pixels (S, P) whose misfit is small enough to be used."""
        most = _NOISE_TIMES * self._noise + _SHARE_OF_CONTRAST * abs(float(np.median(self._depth)))
        return self._corridors.used & (np.abs(misfit) <= most)


def _light(ground: Float, spacing_px: Float) -> Float:
    """Return the gradients of the light across the lines, (S,), grey levels per px.

    A gradient looks like an offset of a single line. The background beside neighbouring lines shows it.
    The outermost lines have the gradient of the lines next to them, because the background may be different
    outside the grid.
    """
    from scipy.ndimage import median_filter

    usual = median_filter(ground, size=3, mode="nearest")
    rise = np.pad(np.gradient(usual[1:-1], axis=0), ((1, 1), (0, 0)), mode="edge")
    gradient: Float = (rise / spacing_px).ravel()
    return gradient


def _edge(distance_px: Float, sines: Float, blur_px2: float) -> tuple[Float, Float, Float]:
    """Return the share of a pixel's area behind a blurred straight edge, and its first two derivatives.

    The edge is `distance_px` away from the pixel's centre. `sines` are the absolute components of its unit
    normal. The area of a square behind a straight edge is the step function, averaged over two boxes as wide
    as these components, which are the projections of the square's sides on the normal.
    """
    from scipy.special import ndtr

    std_px = np.sqrt(blur_px2)
    first, second = np.maximum(sines, _LEAST_SINE).T[..., None]
    reach_px = (first + second) / 2 + _FAR * std_px
    result = np.zeros((3, *distance_px.shape))
    result[0] = distance_px > 0
    near = np.nonzero(np.abs(distance_px) < reach_px)
    distance_px, first, second = distance_px[near], first[near[0], 0], second[near[0], 0]
    total = np.zeros((3, len(distance_px)))
    outer, inner = (first + second) / 2, (first - second) / 2
    for sign, shift in ((1, outer), (-1, inner), (-1, -inner), (1, -outer)):
        z = (distance_px + shift) / std_px
        behind, density = ndtr(z), np.exp(-z * z / 2) / np.sqrt(2 * np.pi)
        total[0] += sign * blur_px2 * ((z * z + 1) * behind + z * density) / 2
        total[1] += sign * std_px * (z * behind + density)
        total[2] += sign * behind
    result[:, near[0], near[1]] = total / (first * second)
    return result[0], result[1], result[2]
