"""Strain from displacements, for a whole region and at every point, with standard deviations."""

from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from dic.image.memory import give_back_memory
from dic.image.threads import bands_of
from dic.strain.displacement import Displacement
from dic.strain.fit import fitted_gradients, mean_gradient
from dic.strain.mean_in_blocks import MANY_POINTS, mean_gradient_in_blocks
from dic.strain.settings import StrainSettings
from dic.strain.tensor import COMPONENTS, limited, shared_std, strain_of
from dic.typing import Float, Mask

_POINTS = 20_000
"""Approximate number of points whose strains are computed at a time."""

STRAIN_KEYS = (*COMPONENTS, *(f"{name}_std" for name in COMPONENTS))
IMAGES_KEYS = tuple(f"{name}_std_images" for name in COMPONENTS[:3])
"""Names of the parts of the standard deviations that the images cause."""


def gauge_text(gauge_px: int, axes_mm_per_px: tuple[float, float] | None) -> str:
    """Return the size of a virtual strain gauge as text, for reports and messages.

    Parameters
    ----------
    gauge_px : int
        Width of the square gauge in the image.
    axes_mm_per_px : tuple of float or None
        Scale along the image's x and y, from `Calibration.axes_mm_per_px`; None without a calibration. In the
        image of an off-axis camera the two scales differ, so the gauge is no square on the specimen.
    """
    text = f"virtual strain gauge {gauge_px} px"
    if axes_mm_per_px is None:
        return text
    across, along = (length_text(gauge_px * each) for each in axes_mm_per_px)
    return f"{text} ({across})" if across == along else f"{text} ({across} × {along})"


def length_text(length_mm: float) -> str:
    """Return a length with three significant digits and its unit, always without an exponent.

    Examples
    --------
    >>> length_text(2.0), length_text(279.96), length_text(1084.0)
    ('2.00 mm', '280 mm', '1080 mm')
    """
    rounded = f"{length_mm:.2e}"
    decimals = max(0, 2 - int(rounded.partition("e")[2]))
    return f"{float(rounded):.{decimals}f} mm"


@dataclass(frozen=True)
class MeanStrain:
    """The mean strain of a region, with its standard deviations and the mean rotation.

    Attributes
    ----------
    exx, eyy, exy : float
        Components of the mean strain; NaN if fewer than three points have a valid displacement, or if these
        points lie on one line.
    rotation_deg : float
        Rigid rotation in degrees, positive from x towards y, in the interval (-180, 180].
    points : int
        Number of points used for the mean strain.
    e1, e2 : float
        Principal strains; e1 is the larger one.
    direction_deg : float
        Direction of the principal strain e1: the angle from x towards y in degrees, in the interval
        (-90, 90].
    exx_std, eyy_std, exy_std, e1_std, e2_std, direction_deg_std : float
        Standard deviations of the strains; NaN if they are not known. `direction_deg_std` is at most 52°.
    """

    exx: float
    eyy: float
    exy: float
    rotation_deg: float
    points: int
    e1: float
    e2: float
    direction_deg: float
    exx_std: float
    eyy_std: float
    exy_std: float
    e1_std: float
    e2_std: float
    direction_deg_std: float

    def __repr__(self) -> str:
        strains = ", ".join(
            f"{name} {1e6 * getattr(self, name):z.0f} ± {1e6 * getattr(self, name + '_std'):.0f}"
            for name in ("exx", "eyy", "exy")
        )
        return f"MeanStrain({strains} µε, rotation {self.rotation_deg:z.3f}°, {self.points} points)"

    def as_dict(self) -> dict[str, float | int | None]:
        """Return a dict of the values for JSON, with None instead of NaN."""
        return {k: None if v != v else v for k, v in vars(self).items()}


@dataclass(frozen=True)
class StrainField:
    """Strain at every point of the grid.

    Attributes
    ----------
    exx, eyy, exy, e1, e2, direction_deg : ndarray, shape (rows, columns)
        Strain values with the same meaning as in `MeanStrain`, for each point. The values are NaN where the
        point has no valid displacement, or where too few of its neighbours have one.
    exx_std, eyy_std, exy_std, e1_std, e2_std, direction_deg_std : ndarray, shape (rows, columns)
        Standard deviations of these strain values; NaN where they are not known.
    exx_std_images, eyy_std_images, exy_std_images : ndarray, shape (rows, columns), or None
        The parts of the standard deviations that the images cause. None if the images cause the whole
        standard deviations.
    """

    exx: Float
    eyy: Float
    exy: Float
    e1: Float
    e2: Float
    direction_deg: Float
    exx_std: Float
    eyy_std: Float
    exy_std: Float
    e1_std: Float
    e2_std: Float
    direction_deg_std: Float
    exx_std_images: Float | None = None
    eyy_std_images: Float | None = None
    exy_std_images: Float | None = None

    def __repr__(self) -> str:
        rows, columns = self.exx.shape
        known = int(np.isfinite(self.exx).sum())
        return f"StrainField({rows} × {columns} points, {known} with a value)"


_Strain = TypeVar("_Strain", MeanStrain, StrainField)


def with_shared(strain: _Strain, covariance: Float) -> _Strain:
    """Return strains whose standard deviations also contain an error that all points share.

    `strain`: strains with the standard deviations that the images cause. `covariance`, shape (3, 3):
    covariance of the shared error of exx, eyy, exy; NaN if it is not known.
    """
    tensor = np.stack([getattr(strain, name) for name in COMPONENTS[:3]], axis=-1)
    own = np.stack([getattr(strain, f"{name}_std") for name in COMPONENTS])
    total = limited(np.hypot(own, shared_std(tensor, covariance)))
    stds: dict[str, Any] = {f"{name}_std": std for name, std in zip(COMPONENTS, total, strict=True)}
    if isinstance(strain, MeanStrain):
        plain: dict[str, Any] = {name: float(std) for name, std in stds.items()}
        return replace(strain, **plain)
    return replace(strain, **stds | dict(zip(IMAGES_KEYS, own[:3], strict=True)))


def mean_strain(
    displacement: Displacement,
    valid: Mask | None = None,
    measure: str = "green-lagrange",
) -> MeanStrain:
    """Return the mean strain of a region: the strain of an affine displacement fitted to its points.

    `valid`, shape (rows, columns): True for the points to use. Default: the points with a valid displacement.
    `measure`: strain measure: "green-lagrange", "small" or "hencky".
    """
    return mean_strain_and_bias(displacement, valid, measure)[0]


def mean_strain_and_bias(
    displacement: Displacement, valid: Mask | None, measure: str
) -> tuple[MeanStrain, MeanStrain | None]:
    """Return the result of `mean_strain`, and a second one for the interpolation bias alone.

    The standard deviations of the second result contain the interpolation bias alone. The second result is
    None if the errors of the displacements are not known.
    """
    use = displacement.valid if valid is None else valid
    points = int(np.count_nonzero(use))
    fit = mean_gradient if use.size <= MANY_POINTS else mean_gradient_in_blocks
    fitted = fit(displacement, use)
    if fitted is None:
        none = MeanStrain(rotation_deg=np.nan, points=points, **dict.fromkeys(STRAIN_KEYS, np.nan))
        return none, None if displacement.noise is None else none
    found = strain_of_gradient(fitted.gradient, fitted.covariance, points, measure)
    if displacement.noise is None:
        return found, None
    return found, strain_of_gradient(fitted.gradient, fitted.by_bias, points, measure)


def bias_of_mean(displacement: Displacement, valid: Mask | None, measure: str) -> MeanStrain | None:
    """Return the second result of `mean_strain_and_bias` without computing the first one."""
    if displacement.noise is None:
        return None
    return mean_strain(replace(displacement, noise=displacement.noise.of_bias()), valid, measure)


def strain_of_gradient(gradient: Float, covariance: Float | None, points: int, measure: str) -> MeanStrain:
    """Return the strain of a region from its displacement gradient.

    `gradient`, shape (2, 2): displacement gradient, with ∂u_i/∂x_j at [i, j]. `covariance`, shape (4, 4):
    covariance of the gradient's elements xx, xy, yx, yy; None if it is not known. `points`: number of points
    from which the gradient was computed. `measure`: strain measure: "green-lagrange", "small" or "hencky".
    """
    F = gradient + np.eye(2)
    rotation_deg = np.degrees(np.arctan2(F[1, 0] - F[0, 1], F[0, 0] + F[1, 1]))
    values = np.concatenate(strain_of(gradient, covariance, measure))
    named: dict[str, Any] = dict(zip(STRAIN_KEYS, values.tolist(), strict=True))
    return MeanStrain(rotation_deg=float(rotation_deg), points=points, **named)


def strain_field(displacement: Displacement, settings: StrainSettings | None = None) -> StrainField:
    """Return the local strain at every point, from its neighbours or from the shape function of its subset.

    A strain that is fitted to a window needs valid displacements at half of the window's points or more. A
    quadratic fit with a window of n × n points also needs at least 2 n + 1 valid displacements. The standard
    deviation of a fitted strain includes the correlation between overlapping subsets.

    `displacement`: the displacements. If the source of the strain is "shape", the attribute `gradient` must
    not be None.

    Raises `ValueError` if the source of the strain is "shape" and the displacement has no `gradient`.
    """
    settings = settings or StrainSettings()
    if settings.source == "shape" and displacement.gradient is None:
        raise ValueError("strain from shape functions needs Displacement.gradient, which is None")
    count, columns = displacement.valid.shape
    if count * columns > MANY_POINTS:
        give_back_memory()
    values = np.empty((len(STRAIN_KEYS), count, columns))
    # The covariances of a point take ten times as much memory as its strain, so compute some rows at a time.
    for rows in bands_of(count, max(1, _POINTS // max(1, columns))):
        gradient, covariance = _gradients(displacement, settings, rows)
        values[:, rows] = np.concatenate(strain_of(gradient, covariance, settings.measure))
    if values[0].size > MANY_POINTS:
        give_back_memory()
    return StrainField(**dict(zip(STRAIN_KEYS, values, strict=True)))


def _gradients(
    displacement: Displacement, settings: StrainSettings, rows: slice
) -> tuple[Float, Float | None]:
    """Return the displacement gradients and their covariances of some rows of points."""
    if settings.source == "shape" and displacement.gradient is not None:
        known, noise = displacement.valid[rows, :, None, None], displacement.noise
        gradient = np.where(known, displacement.gradient[rows], np.nan)
        return gradient, None if noise is None else np.where(known, noise.gradient[rows], np.nan)
    degree = 2 if settings.source == "quadratic-fit" else 1
    return fitted_gradients(displacement, settings.window_points, degree, rows)
