"""The quality of a reference image, assessed before the measurement: pattern, light, focus and noise."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dic.correlation.correlator import Correlator
from dic.correlation.repetition import Repetition, find_repetition, naming_repetition
from dic.correlation.settings import CorrelationSettings
from dic.errors import CorrelationError, require_kind
from dic.image.given import checked_region, grey_image, name_of
from dic.image.read import require_same_size
from dic.image.spline import spline_image
from dic.image.stored import StoredImage
from dic.quality.interpolation import InterpolationBias, assess_interpolation
from dic.quality.noise import noise_of_one, noise_of_two
from dic.quality.noise_floor import (
    LEAST_SHARE,
    noise_floor,
    predicted_std,
    sample_points,
    smallest_subset,
    squared_gradients,
)
from dic.quality.picture import PictureValues, assess_picture
from dic.quality.speckle import autocovariance, even_light, speckle_size
from dic.specimen.find import Specimen, find_specimen
from dic.typing import Float, Grey, ImageLike, Indices, Mask, PathLike

SPECKLES_PER_SUBSET = 3.0
"""Smallest number of speckles across a subset. If there are fewer, neighbouring subsets look alike."""


@dataclass(frozen=True, kw_only=True)
class Quality(PictureValues):
    """The quality of an image: speckles, noise and noise floor, and the light and focus of `PictureValues`.

    Attributes
    ----------
    settings : CorrelationSettings
        Settings of the correlation for which the quality was assessed.
    wanted_px : float
        Wanted standard deviation of the displacement of one point.
    region : ndarray of bool, shape (height, width)
        True at the pixels that were used for the assessment.
    specimen : Specimen or None
        The specimen that was found; None if a region was given.
    noise : float
        Standard deviation of the noise, grey levels.
    whiteness : float
        Noise at the highest spatial frequencies divided by `noise`. The whiteness is 1 if the noise of
        neighbouring pixels is independent, less if their noise is correlated, and NaN if only one image was
        given.
    covariance_x, covariance_y : ndarray, shape (n,)
        Autocovariance of the pattern along x and along y, at lags 0, 1, … px, without noise.
    speckle_x_px, speckle_y_px : float
        Size of the speckles along x and along y: the full width at half maximum of the autocovariance.
    sssig : ndarray, shape (k, 2)
        Sums of squared grey level gradients along x and y in the subset of each of the `points`. The sums
        include the gradients that noise causes.
    points : ndarray of int, shape (k, 2)
        Coordinates x and y of the sampled points.
    std_px : ndarray, shape (k, 2)
        Noise floor of u and v at `points`.
    subset_for_wanted_px : int or None
        Width of the smallest subset whose noise floor is at most `wanted_px` at 95 % of the points with
        texture; None if no subset is large enough.
    mean_gradient : float
        Mean magnitude of the grey level gradient, grey levels per px.
    interpolation : InterpolationBias
        Predicted interpolation bias, and the smoothing that the correlation will apply. `sssig` is computed
        from the image without smoothing, and `std_px` from the smoothed image.
    repetition : Repetition or None
        How the pattern repeats; None if it does not.
    told_apart : bool
        False if the pattern repeats and subsets one period apart look the same.
    """

    settings: CorrelationSettings
    wanted_px: float
    region: Mask
    specimen: Specimen | None
    noise: float
    whiteness: float
    covariance_x: Float
    covariance_y: Float
    speckle_x_px: float
    speckle_y_px: float
    sssig: Float
    points: Indices
    std_px: Float
    subset_for_wanted_px: int | None
    mean_gradient: float
    interpolation: InterpolationBias
    repetition: Repetition | None
    told_apart: bool

    def __repr__(self) -> str:
        speckles = f"speckles {self.speckle_x_px:.1f} × {self.speckle_y_px:.1f} px"
        resolved = f"resolves {self.floor_px:.4f} px with subsets of {self.settings.subset_px} px"
        return f"Quality({speckles}, noise {self.noise:.2f}, {resolved})"

    @staticmethod
    def require_wanted(wanted_px: float) -> None:
        """Raise an error if the wanted standard deviation of the displacement is out of range.

        Raises
        ------
        CorrelationError
            If `wanted_px` is not above 0 and below 10 px.
        """
        if not 0.0 < wanted_px < 10.0:
            raise CorrelationError(
                "settings",
                "wanted resolution",
                "above 0 and below 10 px",
                f"{wanted_px:g} px",
                "give --wanted-px 0.01",
            )

    @staticmethod
    def require_strain_range(strain_range: float) -> None:
        """Raise an error if the largest strain of the experiment is not above 0 and at most 1.

        Raises
        ------
        CorrelationError
        """
        if not 0.0 < strain_range <= 1.0:
            raise CorrelationError(
                "settings",
                "largest strain",
                "above 0 and at most 1",
                f"{strain_range:g}",
                "give --strain-range 0.01 for strains up to 1 %",
            )

    @property
    def floor_px(self) -> float:
        """Noise floor, px, that u and v do not exceed at 95 % of the points with texture."""
        return noise_floor(self.std_px, _share_of_textured(self.std_px))

    @property
    def bare_share(self) -> float:
        """Share of the points whose subset shows noise but no pattern."""
        return float(np.isinf(self.std_px).any(axis=1).mean())

    @property
    def recommended_subset_px(self) -> int | None:
        """Width, px, of the smallest subset that is good enough for `wanted_px` and holds three speckles.

        The noise floor of this subset is at most `wanted_px`, and three speckles lie side by side in it. The
        value is None if no such subset was found.
        """
        speckle = max(self.speckle_x_px, self.speckle_y_px)
        if self.subset_for_wanted_px is None or not np.isfinite(speckle):
            return None
        return max(self.subset_for_wanted_px, int(np.ceil(SPECKLES_PER_SUBSET * speckle)) | 1)

    def figures(self) -> dict[str, float]:
        """Return a dict of the values that `docs/quality.md` explains; an unknown value is NaN."""
        std_px, sssig = np.median(self.std_px, axis=0), np.median(self.sssig, axis=0)
        return {
            "noise": self.noise,
            "whiteness": self.whiteness,
            "speckle_x_px": self.speckle_x_px,
            "speckle_y_px": self.speckle_y_px,
            "sssig_x": float(sssig[0]),
            "sssig_y": float(sssig[1]),
            "std_u_px": float(std_px[0]),
            "std_v_px": float(std_px[1]),
            "floor_px": self.floor_px,
            "bare_share": self.bare_share,
            "mean_gradient": self.mean_gradient,
            **self.interpolation.figures(),
            **super().figures(),
        }

    def as_dict(self) -> dict[str, Any]:
        """Return the settings and the values of `figures` as a dict for JSON, with None instead of NaN."""
        repetition = self.repetition
        return {
            "subset_px": self.settings.subset_px,
            "shape": self.settings.shape,
            "wanted_px": self.wanted_px,
            "recommended_subset_px": self.recommended_subset_px,
            **super().as_dict(),
            "repetition": repetition and {**repetition.as_dict(), "told_apart": self.told_apart},
        }


def assess_quality(
    image: ImageLike,
    region: Mask | PathLike | None = None,
    settings: CorrelationSettings | None = None,
    *,
    second: ImageLike | None = None,
    wanted_px: float = 0.01,
    full_level: float | None = None,
    strain_range: float = 0.01,
) -> Quality:
    """Assess the quality of a reference image.

    Parameters
    ----------
    image : ndarray, shape (height, width), or path
    region : ndarray of bool, shape (height, width), or path, optional
        Region of interest. Default: the specimen, which is found by its speckles.
    settings : CorrelationSettings, optional
        Settings of the correlation for which the quality is assessed.
    second : ndarray, of the same shape, or path, optional
        Another image of the specimen at rest. A second image makes the estimate of the noise more accurate.
    wanted_px : float
        Wanted standard deviation of the displacement of one point.
    full_level : float, optional
        Highest grey level of the sensor. Default: the highest grey level of the image.
    strain_range : float
        Largest strain of the experiment, for which the strain error of interpolation is stated.

    Raises
    ------
    MeasurementError
        If an image cannot be used, `wanted_px` or `strain_range` is out of range, there is no texture, the
        two images do not show the specimen at rest, or the region is too small for a subset.
    """
    require_kind("settings", settings, CorrelationSettings | None, "give dic.CorrelationSettings()")
    settings = settings or CorrelationSettings()
    Quality.require_wanted(wanted_px)
    Quality.require_strain_range(strain_range)
    grey = grey_image(image, name_of(image, "image"))
    spline = spline_image(grey, settings.order)
    slopes = spline.gradient()
    given = None if region is None else checked_region(region, grey.shape)
    centres, region, specimen = _region(given, grey, settings.subset_px)
    other = None if second is None else _second_image(second, grey, name_of(image, "image"))
    known = None if other is None else noise_of_two(grey, other, slopes, region)
    noise, whiteness = known or (noise_of_one(grey, region), float("nan"))
    pattern = even_light(grey, region)
    covariance_y, covariance_x = (autocovariance(pattern, region, noise, axis) for axis in (0, 1))
    points = _points(centres, settings.subset_px)
    interpolation = assess_interpolation(
        grey, region, noise, settings, noise_known=second is not None, strain_range=strain_range
    )
    smoothing = interpolation.smoothing
    smoothed = smoothing.apply(grey)
    smooth = spline_image(smoothed, settings.order) if smoothing.width_px > 0.0 else spline
    std_px = predicted_std(smooth, noise, points, region, settings, smoothing)
    share = _share_of_textured(std_px)
    repetition, told_apart = _repetition(StoredImage(smoothed), region, noise, settings)
    picture = assess_picture(grey, region, noise=noise, full_level=full_level)
    return Quality(
        **vars(picture),
        settings=settings,
        wanted_px=wanted_px,
        region=region,
        specimen=specimen,
        noise=noise,
        whiteness=whiteness,
        covariance_x=covariance_x,
        covariance_y=covariance_y,
        speckle_x_px=speckle_size(covariance_x),
        speckle_y_px=speckle_size(covariance_y),
        sssig=squared_gradients(spline, points, region, settings.subset_px),
        points=points,
        std_px=std_px,
        subset_for_wanted_px=smallest_subset(
            smooth, noise, centres, region, settings, smoothing, wanted_px, share
        ),
        mean_gradient=float(np.hypot(*slopes)[region].mean()),
        interpolation=interpolation,
        repetition=repetition,
        told_apart=told_apart,
    )


def _repetition(
    image: StoredImage, region: Mask, noise: float, settings: CorrelationSettings
) -> tuple[Repetition | None, bool]:
    """Return how the smoothed image repeats, and whether its subsets tell one period from the next."""
    repetition = find_repetition(image, region)
    if repetition is None:
        return None, True
    correlator = Correlator(image.stored, region, replace(settings, smoothing_px=0.0))
    return repetition, correlator.tells_periods_apart(noise)


def _second_image(second: ImageLike, grey: Grey, name: str) -> Grey:
    """Return the grey levels of the second image; raise an error if its size differs from the first one's."""
    other = grey_image(second, name_of(second, "second image"))
    require_same_size([grey, other], [name, name_of(second, "second image")])
    return other


def _region(region: Mask | None, grey: Grey, subset_px: int) -> tuple[Mask, Mask, Specimen | None]:
    """Return the mask of the allowed points, the mask of the pixels to use, and the specimen.

    The specimen is None if the user gives a region.

    If the user gives a region of interest, both masks are this region. Otherwise the pixels are those of the
    specimen, and points are allowed where at least half of a subset lies on the specimen.
    """
    import cv2

    if min(grey.shape) < 2 * subset_px:
        raise _no_room(subset_px, f"an image of {grey.shape[1]} x {grey.shape[0]} px")
    specimen = None
    if region is None:
        with naming_repetition(grey):
            specimen = find_specimen(grey, subset_px)
        region = specimen.mask
        share = np.asarray(cv2.blur(region.astype(np.float32), (subset_px, subset_px)))
        centres = region & (share >= LEAST_SHARE)
    else:
        centres = region
    if np.count_nonzero(region) < subset_px**2:
        raise _no_room(subset_px, f"{np.count_nonzero(region)} pixels")
    return centres, region, specimen


def _share_of_textured(std_px: Float) -> float:
    """Return the share of all points that corresponds to 95 % of the points with texture."""
    return 0.95 * float(np.isfinite(std_px).all(axis=1).mean())


def _points(centres: Mask, subset_px: int) -> Indices:
    points = sample_points(centres, subset_px)
    if not len(points):
        raise _no_room(subset_px, "a region along the image's edge")
    return points


def _no_room(subset_px: int, got: str) -> CorrelationError:
    return CorrelationError(
        "region of interest",
        "judge the image",
        f"an area with texture that holds subsets of {subset_px} px",
        got,
        f"enlarge the region, or give a smaller subset, such as --subset {max(7, subset_px // 2 | 1)}",
    )
