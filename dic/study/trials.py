"""Tries one combination of subset and shape function on a part of the user's image.

The systematic error is measured on a pattern without noise and its deformed copy. The effect of noise is
measured on a pair of images at rest. Without such a pair, noise is drawn and added to the pattern and its
copy; the effect of noise is then the difference of the displacements with and without noise.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dic.correlation.correlator import Correlator
from dic.correlation.field import Field
from dic.correlation.settings import CorrelationSettings
from dic.strain.settings import StrainSettings
from dic.strain.tensor import strain_of
from dic.study.parts import ImagePart
from dic.study.pattern import Pattern
from dic.study.wave import Phases, Wave
from dic.study.windows import window_strain
from dic.typing import Float, Grey, Indices, Mask

EDGE_PX = 6
"""Least distance of subsets from the edge of a part, because the reflected pattern has a kink at the edge."""

_FEWEST_WINDOWS = 16
"""Least number of complete strain windows in a part; with fewer, the strain error is not computed."""


@dataclass(frozen=True)
class TrialImages:
    """The images of one part of the region."""

    clean: tuple[Grey, Grey]
    """Pattern without noise, before and after the deformation."""
    noisy: tuple[Grey, Grey]
    """The same two images with noise, or two images of the specimen at rest."""
    region: Mask
    """Shape (height, width). The region within the part."""
    phases: Phases
    """Phases of the wave in this part."""
    wave: Wave
    at_rest: bool
    """True if `noisy` are images of the specimen at rest."""


def trial_images(
    images: tuple[Grey, Grey | None], region: Mask, part: ImagePart, wave: Wave, noise: float, number: int
) -> TrialImages:
    """Return the images of a part, with phases that depend on its number.

    The phases of the parts differ by 90°. So all parts together contain every strain of the wave about
    equally often, even if a part is smaller than the period of the wave.

    `images`: the reference image, and an image of the specimen at rest, or None to draw noise. `noise`:
    standard deviation of the reference's noise, grey levels. `number`: number of the part, which also
    determines the drawn noise. `region` has the shape (height, width).
    """
    phases = np.pi / 2 * (number % 2), np.pi / 2 * ((number + number // 2) % 2) * (not wave.is_plane)
    grey, second = images
    own = grey[part.pixels]
    pattern = Pattern.of(own, noise)
    y, x = np.mgrid[: own.shape[0], : own.shape[1]].astype(np.float64)
    from_x, from_y = wave.origin(x, y, phases)
    # A plane wave moves whole rows and columns of pixels, for which `draw` is faster than `draw_at`.
    moved = pattern.draw(from_y[:, 0], from_x[0]) if wave.is_plane else pattern.draw_at(from_y, from_x)
    clean = pattern.draw(y[:, 0], x[0]), moved
    if second is None:
        rng = np.random.default_rng(number)
        first_noisy, second_noisy = (
            (each + rng.normal(0.0, noise, each.shape)).astype(np.float32) for each in clean
        )
        noisy = first_noisy, second_noisy
    else:
        noisy = own, np.ascontiguousarray(second[part.pixels])
    inside = np.ascontiguousarray(region[part.pixels])
    return TrialImages(clean, noisy, inside, phases, wave, second is not None)


@dataclass(frozen=True)
class Trial:
    """The errors of one subset and shape function in one part."""

    x_px: Indices
    y_px: Indices
    """Shapes (columns,) and (rows,). Points in the part."""
    uv_px: Float
    """Shape (2, rows, columns). Displacements measured on the pattern without noise; NaN if the subset is not
    whole or failed to correlate.
    """
    noise_px: Float
    """Shape (2, rows, columns). Errors of the displacements that noise causes."""
    settings: CorrelationSettings
    images: TrialImages
    lost: tuple[int, int]
    """Number of points without a displacement, and of all points with a whole subset."""

    def bias_px(self) -> Float:
        """Return the systematic errors of the displacements u and v at n points, shape (2, n)."""
        x, y = self._places(1)
        true = self.images.wave.displacement_px(x, y, self.images.phases)
        return _known(self.uv_px - true)

    def strain_noise(self, step_px: int, strain: StrainSettings) -> Float:
        """Return the errors of exx and eyy due to noise, at n points `step_px` apart, shape (2, n)."""
        every = step_px // self.settings.step_px
        u, v = self.noise_px[:, ::every, ::every]
        # The noise is small, so strain of any measure is linear in the noise; compute it as small strain.
        return _known(window_strain(u, v, step_px, replace(strain, measure="small")))

    def strain_bias(self, step_px: int, strain: StrainSettings) -> Float:
        """Return the systematic errors of exx and eyy, at n points `step_px` apart, shape (2, n).

        The result is empty if the part contains too few complete strain windows.
        """
        every = step_px // self.settings.step_px
        u, v = self.uv_px[:, ::every, ::every]
        gradient = self.images.wave.gradient(*self._places(every), self.images.phases)
        true = strain_of(gradient, None, strain.measure)[0][:2]
        errors = _known(window_strain(u, v, step_px, strain) - true)
        return errors if errors.shape[1] >= _FEWEST_WINDOWS else errors[:, :0]

    def _places(self, every: int) -> tuple[Float, Float]:
        """Return x and y of every `every`-th point in each direction, each of shape (rows, columns)."""
        x, y = np.meshgrid(self.x_px[::every].astype(np.float64), self.y_px[::every].astype(np.float64))
        return x, y


def tried(images: TrialImages, settings: CorrelationSettings) -> Trial:
    """Correlate the pattern without noise and the noisy images of a part.

    Raises `CorrelationError` if the part is too small for a subset, or if the images do not match.
    """
    clean, whole = _correlated(images.clean, images.region, settings)
    noisy, _ = _correlated(images.noisy, images.region, settings)
    uv_px = _displacements(clean, whole)
    found = _displacements(noisy, whole)
    noise_px = _without_plane(found) if images.at_rest else found - uv_px
    known = np.isfinite(uv_px[0]) & np.isfinite(found[0])
    lost = int(np.count_nonzero(whole & ~known)), int(np.count_nonzero(whole))
    return Trial(clean.x_px, clean.y_px, uv_px, noise_px, settings, images, lost)


def rms(parts: Sequence[Float]) -> tuple[float, float]:
    """Return the root mean squares of two components in all parts; NaN if there is no value."""
    together = np.concatenate([each.reshape(2, -1) for each in parts], axis=1)
    if not np.isfinite(together).any():
        return np.nan, np.nan
    x, y = np.sqrt(np.nanmean(together * together, axis=1))
    return float(x), float(y)


def _correlated(pair: tuple[Grey, Grey], region: Mask, settings: CorrelationSettings) -> tuple[Field, Mask]:
    """Return the field of two images, and a mask of points with whole subsets far from the part's edge."""
    reference, deformed = pair
    correlator = Correlator(reference, region, settings, copy=False)
    field, grid = correlator.correlate(deformed), correlator.grid
    whole = grid.active & (grid.pixels == settings.subset_px**2)
    reach = settings.radius_px + EDGE_PX
    inside: Callable[[Indices, int], Mask] = lambda at, n: (at >= reach) & (at < n - reach)  # noqa: E731
    height, width = reference.shape
    return field, whole & inside(field.y_px, height)[:, None] & inside(field.x_px, width)[None, :]


def _displacements(field: Field, whole: Mask) -> Float:
    return np.where(whole & field.converged, np.stack([field.u_px, field.v_px]), np.nan)


def _without_plane(uv_px: Float) -> Float:
    """Subtract a rigid motion and a uniform strain, which a warming camera causes, from displacements."""
    rows, columns = np.mgrid[: uv_px.shape[1], : uv_px.shape[2]].astype(np.float64)
    known = np.isfinite(uv_px[0])
    if np.count_nonzero(known) <= 3:
        return np.full_like(uv_px, np.nan)
    terms = np.stack([np.ones_like(rows), rows, columns], axis=-1)
    rest = np.full_like(uv_px, np.nan)
    for k, values in enumerate(uv_px):
        plane = np.linalg.lstsq(terms[known], values[known], rcond=None)[0]
        rest[k] = values - terms @ plane
    return rest


def _known(errors: Float) -> Float:
    flat = errors.reshape(2, -1)
    return flat[:, np.isfinite(flat).all(axis=0)]
