"""Measurement of the corners at which four squares meet: two crossing blurred edges are fitted to the pixels.

The model of the grey levels around a corner c is

    I(p) = m + g·d + (a + h·d) E₁ E₂,    Eₖ = 2 Fₖ(nₖ·(p − c)) − 1,    d = p − c₀,

with the normals n₁ and n₂ of the two edges, the mean grey level m, half of the contrast a, the gradients g
and h of the light, and the approximate corner c₀. Fₖ(t) is the share of a pixel's area that lies beyond an
edge, if the pixel's centre is at the distance t from the edge. The blur of the edge is a normal distribution.
The formula for Fₖ is exact for an edge of any direction, even without blur.

The model is compared with the pixels themselves. Grey levels interpolated between pixels are wrong by several
percent of the contrast beside a sharp edge, and would shift corners by up to 0.08 px.
"""

from dataclasses import dataclass

import numpy as np

from dic.targets.blobs import noise_of
from dic.typing import Float, Grey, Indices, Mask

_CORNERS_AT_ONCE = 32
# The first steps of the fit keep a large start value of the blur, because the fit then converges from farther
# away. In the other steps the blur is an unknown.
_STEPS_WITH_BLUR, _STEPS = 3, 5
_START_BLUR_PX, _BLUR_PX = 1.5, (0.15, 6.0)
# At this distance from a marker, in standard deviations of the blur, the marker does not change the pixels.
_FREE_OF_BLUR = 2.5
# The window does not extend farther from the corner, because lens distortion bends the edges there.
_FARTHEST_PX = 16.0
# At least the share `_IN_PICTURE` of the window must lie in the image. A fit has converged if its last step
# is shorter than `_LAST_STEP_PX`.
_IN_PICTURE, _LAST_STEP_PX = 0.6, 0.05
# `_MISFIT` is the largest accepted misfit as a multiple of the median. `_MISFIT_OF_CONTRAST` is the misfit
# without any noise, as a fraction of the contrast. An object, dirt or a reflection in the window causes a
# larger misfit.
_MISFIT, _MISFIT_OF_CONTRAST = 1.7, 0.02
# Parameters: corner, angles of the edges, blur; m, g; a, h.
_PARAMETERS, _BLUR = 11, 4
# If an edge is parallel to a side of the pixels, the width of this side across the edge is 0, by which the
# model cannot divide. This small width replaces 0.
_SHORT_PX = 0.01


def fit_corners(
    grey: Grey, px: Float, along: Float, reach: float, margin: float = np.inf
) -> tuple[Float, float]:
    """Return fitted corners, and how much the grey levels around them differ from the model of crossing
    edges.

    `px`, shape (n, 2): approximate corners, to about 2 px. `along`, shape (n, 2, 2): for each corner, the two
    vectors, px, along the edges to the neighbouring corners. `reach`: length of the edges that is used on
    either side of the corner, as a fraction of the vectors `along`. `margin`: in the bright squares, only
    pixels up to this distance from an edge are used. The distance is a fraction of the vectors `along`. A
    ChArUco board has its markers farther inside. Default: all pixels.

    Returns
    -------
    px : ndarray, shape (n, 2)
        The corners; NaN where a fit failed, is worse than usual, or leaves the image.
    difference : float
        Median of the misfits that remain after subtraction of the noise, as a fraction of the contrast. NaN
        if no corner was fitted.
    """
    result = np.full(px.shape, np.nan)
    misfit, contrast = np.full((2, len(px)), np.nan)
    known = np.flatnonzero(np.isfinite(px).all(axis=1) & np.isfinite(along).all(axis=(1, 2)))
    for first in range(0, len(known), _CORNERS_AT_ONCE):
        some = known[first : first + _CORNERS_AT_ONCE]
        vectors, place = along[some], px[some]
        margin_px = margin * np.linalg.norm(vectors, axis=-1).min(axis=-1)
        window = _Window.around(grey, place, vectors, reach, margin_px / 2)
        fit = _Fit.start(vectors, window)
        for _ in range(_STEPS_WITH_BLUR):
            fit = fit.improved(window, blur_known=True)
        for _ in range(_STEPS_WITH_BLUR):
            fit = fit.improved(window, blur_known=False)
        # Centre the window on the fitted corner. Effects that the model leaves out are then equal on opposite
        # sides of the corner and do not shift it.
        there = np.where(np.abs(fit.corner) < _FARTHEST_PX, fit.corner, 0.0)
        free_px = np.maximum(margin_px / 2, margin_px - _FREE_OF_BLUR * np.median(fit.parameters[:, _BLUR]))
        window = _Window.around(grey, place + there, vectors, reach, free_px)
        fit, before = fit.moved(-there), fit
        for _ in range(_STEPS):
            before, fit = fit, fit.improved(window, blur_known=False)
        corner = there + fit.corner
        allowed = np.maximum(1.0, reach * np.linalg.norm(vectors, axis=-1).min(axis=-1) / 2)
        still = np.linalg.norm(fit.corner - before.corner, axis=1) < _LAST_STEP_PX
        sound = still & (np.linalg.norm(corner, axis=1) < allowed) & window.mostly_in_picture
        result[some[sound]] = place[sound] + corner[sound]
        misfit[some], contrast[some] = fit.misfit(window), 2 * np.abs(fit.parameters[:, 8])
    seen = np.isfinite(result).all(axis=1)
    if not seen.any():
        return result, np.nan
    usual = _MISFIT * np.median(misfit[seen]) + _MISFIT_OF_CONTRAST * np.median(contrast[seen])
    result[seen & ~(misfit < usual)] = np.nan
    beyond_noise2 = float(np.median(misfit[seen])) ** 2 - noise_of(grey) ** 2
    return result, float(np.sqrt(max(beyond_noise2, 0.0)) / np.median(contrast[seen]))


@dataclass(frozen=True)
class _Window:
    """The pixels around n corners: places (n, m, 2) from the corner, grey levels and a mask (n, m)."""

    places: Float
    level: Float
    used: Mask
    mostly_in_picture: Mask

    @classmethod
    def around(cls, grey: Grey, px: Float, along: Float, reach: float, margin_px: Float) -> "_Window":
        lengths = np.linalg.norm(along, axis=-1)
        ends = np.minimum(reach * lengths, _FARTHEST_PX)
        half = int(np.ceil((ends[..., None] * np.abs(along) / lengths[..., None]).sum(axis=1).max()))
        y, x = np.mgrid[-half : half + 1, -half : half + 1]
        pixel = np.rint(px).astype(np.int64)[:, None] + np.stack([x, y], axis=-1).reshape(-1, 2)
        height, width = grey.shape
        inside = ((pixel >= 0) & (pixel < (width, height))).all(axis=-1)
        column, row = np.clip(pixel, 0, (width - 1, height - 1)).transpose(2, 0, 1)
        level = grey[row, column].astype(np.float64)
        places = pixel - px[:, None]
        # Coordinates along the two edges, px.
        unit = along / lengths[..., None]
        both = np.einsum("nmi,nij->nmj", places, np.linalg.inv(unit))
        wanted = (np.abs(both) <= ends[:, None]).all(axis=-1)
        first_pair = both[..., 0] * both[..., 1] > 0
        near = np.abs(both) < margin_px[:, None, None]
        beside = wanted & inside & near.any(axis=-1)
        levels = [_mean(level, beside & pair) for pair in (first_pair, ~first_pair)]
        bright = first_pair == (levels[0] > levels[1])[:, None]
        wanted &= ~bright | near.any(axis=-1)
        used = wanted & inside
        share = used.sum(axis=1) / np.maximum(wanted.sum(axis=1), 1)
        return cls(places, level, used, np.asarray(share >= _IN_PICTURE))


def _mean(level: Float, mask: Mask) -> Float:
    mean: Float = (level * mask).sum(axis=1) / np.maximum(mask.sum(axis=1), 1)
    return mean


@dataclass(frozen=True)
class _Fit:
    """The parameters of n corners, shape (n, 11): offset from the approximate corner, angles, blur, light."""

    parameters: Float

    @classmethod
    def start(cls, along: Float, window: _Window) -> "_Fit":
        parameters = np.zeros((len(along), _PARAMETERS))
        # The normal of an edge is perpendicular to the vector along the edge.
        parameters[:, 2:4] = np.arctan2(along[..., 0], -along[..., 1])
        parameters[:, _BLUR] = _START_BLUR_PX
        parameters[:, 5] = _mean(window.level, window.used)
        sides = [np.sign(np.einsum("nmi,ni->nm", window.places, normal)) for normal in _normals(parameters)]
        pattern = sides[0] * sides[1]
        parameters[:, 8] = _mean((window.level - parameters[:, 5:6]) * pattern, window.used)
        return cls(parameters)

    @property
    def corner(self) -> Float:
        corner: Float = self.parameters[:, :2]
        return corner

    def moved(self, by: Float) -> "_Fit":
        """Return the parameters with the corners shifted by (n, 2), px."""
        parameters = self.parameters.copy()
        parameters[:, :2] += by
        return _Fit(parameters)

    def improved(self, window: _Window, blur_known: bool) -> "_Fit":
        """Return the parameters after a step of Gauss and Newton."""
        model, jacobian = self._model(window.places)
        jacobian *= window.used[..., None]
        if blur_known:
            jacobian[..., _BLUR] = 0.0
        # Scale the equations, because the parameters differ in size by powers of ten.
        scale = np.sqrt((jacobian**2).sum(axis=1)) + 1e-9
        jacobian /= scale[:, None]
        normal = np.swapaxes(jacobian, 1, 2) @ jacobian + 1e-9 * np.eye(_PARAMETERS)
        right = np.swapaxes(jacobian, 1, 2) @ (window.level - model)[..., None]
        step = np.linalg.solve(normal, right)[..., 0] / scale
        # Far from the solution a step may be too long, so limit its length.
        length = np.linalg.norm(step[:, :2], axis=1)
        step *= np.minimum(1.0, 1.0 / np.maximum(length, 1e-9))[:, None]
        parameters = self.parameters + step
        parameters[:, _BLUR] = np.clip(parameters[:, _BLUR], *_BLUR_PX)
        return _Fit(parameters)

    def misfit(self, window: _Window) -> Float:
        """Return the root mean square difference between the grey levels and the model, shape (n,)."""
        return np.sqrt(_mean((window.level - self._model(window.places)[0]) ** 2, window.used))

    def _model(self, places: Float) -> tuple[Float, Float]:
        """Return the model's grey levels (n, m) and their derivatives ∂/∂parameters (n, m, 11)."""
        jacobian = np.empty((*places.shape[:2], _PARAMETERS))
        blur = self.parameters[:, _BLUR]
        from_corner = places - self.corner[:, None]
        edges = []
        for normal in _normals(self.parameters):
            distance = np.einsum("nmi,ni->nm", from_corner, normal)
            turned = normal @ np.array([[0.0, 1.0], [-1.0, 0.0]])
            arm = np.einsum("nmi,ni->nm", from_corner, turned)
            edges.append((normal, arm, *_edge(distance, normal, blur)))
        (normal_1, arm_1, edge_1, slope_1, spread_1), (normal_2, arm_2, edge_2, slope_2, spread_2) = edges
        terms = np.concatenate([np.ones_like(places[..., :1]), places], axis=-1)
        pattern = edge_1 * edge_2
        half_contrast = np.einsum("nmk,nk->nm", terms, self.parameters[:, 8:])
        by_first, by_second = half_contrast * slope_1 * edge_2, half_contrast * slope_2 * edge_1
        jacobian[..., :2] = -np.einsum("nm,ni->nmi", by_first, normal_1)
        jacobian[..., :2] -= np.einsum("nm,ni->nmi", by_second, normal_2)
        jacobian[..., 2], jacobian[..., 3] = by_first * arm_1, by_second * arm_2
        jacobian[..., _BLUR] = half_contrast * (spread_1 * edge_2 + spread_2 * edge_1)
        jacobian[..., 5:8], jacobian[..., 8:] = terms, terms * pattern[..., None]
        level: Float = np.einsum("nmk,nk->nm", terms, self.parameters[:, 5:8]) + half_contrast * pattern
        return level, jacobian


def _normals(parameters: Float) -> tuple[Float, Float]:
    """Return the normals (n, 2) of the two edges."""
    first, second = (
        np.stack([np.cos(angle), np.sin(angle)], axis=-1) for angle in (parameters[:, 2], parameters[:, 3])
    )
    return first, second


def _edge(distance: Float, normal: Float, blur: Float) -> tuple[Float, Float, Float]:
    """Return E = 2F − 1 of pixels at distances (n, m) from edges, ∂E/∂distance and ∂E/∂blur.

    The projection of a square pixel onto the edge's normal is the convolution of two boxes. The widths a and
    b of these boxes are the components of the normal. Let Φ be the normal distribution, and let Ψ be its
    second integral for the blur s. The share of the pixel beyond the edge is

        F(t) = Σ ± Ψ(t ± a/2 ± b/2)/(a b),    Ψ(t) = ((t² + s²) Φ(t/s) + s t φ(t/s))/2.

    The derivative of any blurred function with respect to s is s times its second derivative.
    """
    from scipy.special import ndtr

    sides = np.maximum(np.abs(normal), _SHORT_PX)
    value, slope, spread = np.sign(distance), np.zeros_like(distance), np.zeros_like(distance)
    close = np.abs(distance) < (4.5 * blur + sides.sum(axis=1) / 2)[:, None]
    corner: Indices = np.nonzero(close)[0]
    s, (a, b), t = blur[corner], sides[corner].T, distance[close]
    share, density, change = np.zeros((3, len(t)))
    for sign, offset in ((1, a + b), (-1, a - b), (-1, b - a), (1, -a - b)):
        x = t + offset / 2
        beyond = ndtr(x / s)
        bell = s * np.exp(-((x / s) ** 2) / 2) / np.sqrt(2 * np.pi)
        share += sign * ((x**2 + s**2) * beyond + x * bell) / 2
        density += sign * (x * beyond + bell)
        change += sign * beyond
    value[close] = 2 * share / (a * b) - 1
    slope[close] = 2 * density / (a * b)
    spread[close] = 2 * s * change / (a * b)
    return value, slope, spread
