"""Measurement of the centres of dots: an ellipse with a blurred edge is fitted to the grey levels.

The image of a round dot is an ellipse, also in perspective. The model of its grey levels is

    I(p) = (1 − S)·(b₀ + b·(p − c)) + S·(d₀ + d·(p − c)),    S = Φ(−t/s)

with the distance t of the pixel p from the ellipse, positive outside, the blur s of the edge, the normal
distribution Φ, and the grey levels and gradients of the background, b, and of the dot, d. Most of the
information about the centre is in the pixels near the edge. Therefore the error of the fit nearly reaches the
Cramér-Rao bound for the noise of the pixels. The error of a centroid is larger.
"""

from dataclasses import dataclass

import numpy as np

from dic.targets.blobs import Blobs, noise_of
from dic.targets.dot_pixels import DotPixels, distance_from_ellipses, nearest_dot
from dic.typing import Float, Grey, Indices, Mask

# The first steps fit each dot alone. The other steps also use the gradients of the light at the neighbours.
_STEPS, _STEPS_IN_KNOWN_LIGHT = 5, 3
_NEIGHBOURS = 9
# A scatter of the neighbours' gradients up to this multiple of the median scatter counts as noise.
_USUAL_SCATTER = 1.5
_DOTS_AT_ONCE = 48
_BLUR_PX = (0.35, 6.0)
# Twelve parameters: levels and gradients of both sides, centre, shape and blur of the ellipse.
_PARAMETERS = 12
_GRADIENTS = [1, 2, 4, 5]


@dataclass(frozen=True)
class Ellipses:
    """Ellipses fitted to dots."""

    centre_px: Float
    """Shape (n, 2). Centres of the ellipses; NaN if a fit failed."""
    area_px2: Float
    """Shape (n,). Areas of the ellipses."""
    contrast: Float
    """Shape (n,). Grey level of the background minus grey level of the dot."""
    misfit: Float
    """Shape (n,). Root mean square difference between the grey levels and the model."""
    saturated: Float
    """Shape (n,). Share of the pixels near the edge that have the highest grey level of the sensor."""


def fit_ellipses(grey: Grey, blobs: Blobs, hollow: Mask) -> Ellipses:
    """Fit ellipses to blobs.

    The model is clipped at the image's lowest and highest grey levels, because the camera clips the light in
    the same way. Therefore the parts of the image that a reflection saturates do not shift the centres.

    `blobs`: approximate ellipses, at least two. `hollow`, shape (n,): True for rings.
    """
    from scipy.spatial import KDTree

    count = len(blobs)
    centre, (area, contrast, misfit, saturated) = np.full((count, 2), np.nan), np.full((4, count), np.nan)
    near = np.arange(1, min(_NEIGHBOURS, count) + 1)
    neighbours = np.asarray(KDTree(blobs.centre_px).query(blobs.centre_px, k=near)[1], np.int64)
    sensor, nearest = _Sensor.of(grey), nearest_dot(blobs, grey.shape)
    by_size = np.argsort(blobs.area_px2)
    batches = [by_size[first : first + _DOTS_AT_ONCE] for first in range(0, count, _DOTS_AT_ONCE)]
    samples = [DotPixels.around(grey, blobs, hollow, nearest, some) for some in batches]
    fits = [_Fit.start(blobs.only(some), its) for some, its in zip(batches, samples, strict=True)]
    unknown_light = _Light(np.zeros((count, 4)), np.zeros((count, 4)))
    for k, its in enumerate(samples):
        for _ in range(_STEPS):
            fits[k] = fits[k].improved(its, sensor, unknown_light.only(batches[k]))
    light = _Light.around(blobs.centre_px, _gathered([fit.linear for fit in fits], batches), neighbours)
    for some, fit, its in zip(batches, fits, samples, strict=True):
        noise2 = fit.misfit(its, sensor)[:, None] ** 2
        known = _Light(light.gradients[some], light.precision[some] * noise2)
        for _ in range(_STEPS_IN_KNOWN_LIGHT):
            fit = fit.improved(its, sensor, known)
        centre[some], area[some] = fit.centre, np.pi / np.sqrt(np.maximum(fit.determinant, 1e-12))
        contrast[some] = fit.linear[:, 0] - fit.linear[:, 3]
        misfit[some] = fit.misfit(its, sensor)
        saturated[some] = sensor.saturated_share(its)
    # If a fitted ellipse left its blob or has a very different size, it does not measure this blob.
    semi_axis = 2 * np.sqrt(np.linalg.eigvalsh(blobs.covariance_px2)[:, 0])
    moved = np.linalg.norm(centre - blobs.centre_px, axis=1) > np.maximum(1.5, 0.3 * semi_axis)
    with np.errstate(invalid="ignore"):
        wrong = moved | ~(np.abs(np.log(area / blobs.area_px2)) < 0.7) | ~np.isfinite(misfit)
    centre[wrong] = np.nan
    return Ellipses(centre, area, contrast, misfit, saturated)


def rough_misfit(grey: Grey, blobs: Blobs, hollow: Mask, which: Indices) -> tuple[Float, Float]:
    """Return the misfits (m,) and the contrasts (m,) of ellipses that are fitted to some of the blobs.

    The fit of all blobs takes a long time. A few blobs show whether the blobs are ellipses at all.
    """
    sensor = _Sensor.of(grey)
    samples = DotPixels.around(grey, blobs, hollow, nearest_dot(blobs, grey.shape), which)
    fit = _Fit.start(blobs.only(which), samples)
    unknown_light = _Light(np.zeros((len(which), 4)), np.zeros((len(which), 4)))
    for _ in range(_STEPS):
        fit = fit.improved(samples, sensor, unknown_light)
    return fit.misfit(samples, sensor), fit.linear[:, 0] - fit.linear[:, 3]


@dataclass(frozen=True)
class _Sensor:
    """The lowest and highest grey level of an image, its noise, and whether pixels saturate."""

    low: float
    high: float
    noise: float
    saturates: bool

    @classmethod
    def of(cls, grey: Grey) -> "_Sensor":
        low, high = float(grey.min()), float(grey.max())
        # Rounding to whole grey levels adds noise with the standard deviation 1/√12.
        noise = float(np.hypot(noise_of(grey), np.sqrt(1 / 12)))
        # If no pixel saturates, the highest grey level is rarer than the levels below it.
        below = np.count_nonzero(grey >= high - max(noise, 2.0)) - (highest := np.count_nonzero(grey >= high))
        return cls(low, high, noise, bool(highest > below))

    def saturated_share(self, samples: DotPixels) -> Float:
        """Return the shares (n,) of the pixels near the edges that are saturated."""
        near = samples.weight == 1
        saturated = (near & (samples.level >= self.high)).sum(axis=1) if self.saturates else 0.0
        return np.asarray(saturated / np.maximum(near.sum(axis=1), 1))

    def clipped(self, level: Float) -> tuple[Float, Float]:
        """Return the sensor's mean grey levels for grey levels `level` of the light, and their derivatives.

        For noise of the standard deviation s, the mean of ``max(x, 0)`` is ``s ψ(x/s)`` with the function
        ``ψ(z) = z Φ(z) + φ(z)`` and its derivative Φ.
        """
        from scipy.special import ndtr

        mean, slope = level.copy(), np.ones_like(level)
        near = (level < self.low + 4 * self.noise) | (level > self.high - 4 * self.noise)
        ends = [(level[near] - end) / self.noise for end in (self.low, self.high)]
        over_low, over_high = (z * ndtr(z) + np.exp(-(z**2) / 2) / np.sqrt(2 * np.pi) for z in ends)
        mean[near] = self.low + self.noise * (over_low - over_high)
        slope[near] = ndtr(ends[0]) - ndtr(ends[1])
        return mean, slope


@dataclass(frozen=True)
class _Light:
    """The known gradients of the light (n, 4), and their precisions (n, 4), which are 1/variance."""

    gradients: Float
    precision: Float

    def only(self, which: Indices) -> "_Light":
        return _Light(self.gradients[which], self.precision[which])

    @classmethod
    def around(cls, centre_px: Float, linear: Float, neighbours: Indices) -> "_Light":
        """Return the gradients at each dot, from a plane through the gradients at its neighbours.

        A gradient of the light looks like a shift of the dot. Where light changes little from dot to dot, the
        neighbours give a better gradient than the dot itself. Where the gradients of the neighbours scatter
        more than usual, for example in a reflection, the precision is low. The dot's own grey levels then
        determine its gradient.
        """
        gradients = linear[:, _GRADIENTS]
        offset = centre_px[neighbours] - centre_px[:, None]
        size = np.linalg.norm(offset, axis=-1).max(axis=1)[:, None, None] + 1e-9
        design = np.concatenate([np.ones_like(offset[..., :1]), offset / size], axis=-1)
        # If the neighbours of a dot lie on one line, the equations are singular. A small term on the diagonal
        # prevents this.
        normal = np.swapaxes(design, 1, 2) @ design + np.diag([0.0, 0.05, 0.05]) + 1e-9 * np.eye(3)
        plane = np.linalg.solve(normal, np.swapaxes(design, 1, 2) @ gradients[neighbours])
        scatter2 = ((gradients[neighbours] - design @ plane) ** 2).mean(axis=1)
        usual2 = np.median(scatter2, axis=0)
        excess2 = np.maximum(scatter2 - _USUAL_SCATTER * usual2, 0.0) + usual2 / 10
        return cls(plane[:, 0], 1.0 / np.maximum(excess2, 1e-12))


def _gathered(parts: list[Float], batches: list[Indices]) -> Float:
    """Return the rows of several batches in the order of the dots."""
    every = np.empty((sum(len(some) for some in batches), parts[0].shape[1]))
    for part, some in zip(parts, batches, strict=True):
        every[some] = part
    return every


@dataclass(frozen=True)
class _Fit:
    """The parameters of n dots: centre (n, 2), shape Q (n, 3), blur (n,), levels and gradients (n, 6)."""

    centre: Float
    shape: Float
    blur: Float
    linear: Float

    @classmethod
    def start(cls, blobs: Blobs, samples: DotPixels) -> "_Fit":
        shape: Float = np.linalg.inv(4 * blobs.covariance_px2).astype(np.float64)
        distance = distance_from_ellipses(samples.places_px, blobs.centre_px, shape)[0]
        linear = np.zeros((len(blobs), 6))
        for column, side in ((0, distance > 0), (3, distance < 0)):
            weight = samples.weight * side
            linear[:, column] = (samples.level * weight).sum(axis=1) / np.maximum(weight.sum(axis=1), 1)
        upper = np.stack([shape[:, 0, 0], shape[:, 0, 1], shape[:, 1, 1]], axis=-1)
        return cls(blobs.centre_px.copy(), upper, np.full(len(blobs), 1.2), linear)

    @property
    def _matrix(self) -> Float:
        xx, xy, yy = self.shape.T
        matrix: Float = np.stack([np.stack([xx, xy], axis=-1), np.stack([xy, yy], axis=-1)], axis=-2)
        return matrix

    @property
    def determinant(self) -> Float:
        """Determinants of Q, shape (n,), px⁻⁴."""
        determinant: Float = self.shape[:, 0] * self.shape[:, 2] - self.shape[:, 1] ** 2
        return determinant

    def _model(self, pixels: Float, sensor: _Sensor) -> tuple[Float, Float]:
        """Return the model's grey levels (n, m) and their derivatives ∂/∂parameters (n, m, 12)."""
        from scipy.special import ndtr

        distance, by_centre, by_shape = distance_from_ellipses(pixels, self.centre, self._matrix)
        scaled = distance / self.blur[:, None]
        covered = ndtr(-scaled)
        density = np.exp(-(scaled**2) / 2) / np.sqrt(2 * np.pi) / self.blur[:, None]
        d = pixels - self.centre[:, None]
        terms = np.concatenate([np.ones_like(d[..., :1]), d], axis=-1)
        design = np.concatenate([terms * (1 - covered)[..., None], terms * covered[..., None]], axis=-1)
        step = np.einsum("nmk,nk->nm", terms, self.linear[:, 3:] - self.linear[:, :3])
        by_distance = (-step * density)[..., None]
        jacobian = np.concatenate(
            [design, by_distance * by_centre, by_distance * by_shape, by_distance * -scaled[..., None]],
            axis=-1,
        )
        level, slope = sensor.clipped(np.einsum("nmk,nk->nm", design, self.linear))
        return level, slope[..., None] * jacobian

    def improved(self, samples: DotPixels, sensor: _Sensor, light: "_Light") -> "_Fit":
        """Return the parameters after a step of Gauss and Newton."""
        model, jacobian = self._model(samples.places_px, sensor)
        weight = samples.weight
        # Scale the equations, because the parameters differ in size by powers of ten.
        scale = np.sqrt((weight[..., None] * jacobian**2).sum(axis=1)) + 1e-12
        jacobian = jacobian / scale[:, None]
        weighted = jacobian * weight[..., None]
        normal = np.swapaxes(weighted, 1, 2) @ jacobian + 1e-9 * np.eye(_PARAMETERS)
        right = (weighted * (samples.level - model)[..., None]).sum(axis=1)
        its_scale = scale[:, _GRADIENTS]
        normal[:, _GRADIENTS, _GRADIENTS] += light.precision / its_scale**2
        right[:, _GRADIENTS] += light.precision * (light.gradients - self.linear[:, _GRADIENTS]) / its_scale
        step = np.linalg.solve(normal, right[..., None])[..., 0] / scale
        # Far from the solution a step may be too long, so limit its length.
        length = np.linalg.norm(step[:, 6:8], axis=1)
        step *= np.minimum(1.0, 1.0 / np.maximum(length, 1e-9))[:, None]
        shape = self.shape + step[:, 8:11]
        definite = (shape[:, 0] > 0) & (shape[:, 0] * shape[:, 2] > shape[:, 1] ** 2)
        shape = np.where(definite[:, None], shape, self.shape)
        blur = np.clip(self.blur + step[:, 11], *_BLUR_PX)
        return _Fit(self.centre + step[:, 6:8], shape, blur, self.linear + step[:, :6])

    def misfit(self, samples: DotPixels, sensor: _Sensor) -> Float:
        """Return the root mean square difference between model and grey levels near the edge, (n,)."""
        model = self._model(samples.places_px, sensor)[0]
        single = samples.weight == 1
        square = (single * (samples.level - model) ** 2).sum(axis=1) / np.maximum(single.sum(axis=1), 1)
        return np.asarray(np.sqrt(square))
