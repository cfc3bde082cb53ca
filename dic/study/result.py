"""The result of a study: noise, systematic error and resolution of every combination of settings."""

import math
from dataclasses import dataclass, replace
from typing import Any

from dic.correlation.settings import CorrelationSettings
from dic.specimen.find import Specimen
from dic.strain.settings import StrainSettings
from dic.study.parts import ImagePart
from dic.study.wave import Wave
from dic.typing import Mask

LOST_SHARE = 0.02
"""Settings are not recommended if a larger share of the points than this has no displacement."""

NEARLY = 1.02
"""Settings with up to this multiple of the least strain error are recommended if they take less time."""

_EIGHT_COLUMNS = {"affine": 0.7, "quadratic": 0.95}
"""Time for 8 columns of a subset, relative to 16 columns, as measured on a processor with AVX-512."""


@dataclass(frozen=True)
class StudiedSettings:
    """The errors that one combination of settings has on the user's images.

    The pairs of numbers belong to u and v, or to exx and eyy.

    Attributes
    ----------
    correlation : CorrelationSettings
    strain : StrainSettings
    resolution_px : float
        Period of the wave of strain that keeps 90 % of its amplitude.
    noise_px, bias_px : tuple of float
        Standard deviation of the displacement due to noise, and root mean square of the displacement's
        systematic error, px.
    strain_noise, strain_bias : tuple of float
        The same two values for local strain.
    lost_share : float
        Share of the points without a displacement.
    """

    correlation: CorrelationSettings
    strain: StrainSettings
    resolution_px: float
    noise_px: tuple[float, float]
    bias_px: tuple[float, float]
    strain_noise: tuple[float, float]
    strain_bias: tuple[float, float]
    lost_share: float

    @property
    def subset_time(self) -> float:
        """Time for a subset; the unit is the time for 16 columns of one pixel.

        The processor computes 16 columns together, and 8 where at most 8 are left, which takes little less.
        So a subset of 41 px takes three times 16 columns, and one of 39 px less.
        """
        subset_px = self.correlation.subset_px
        whole, left = divmod(subset_px, 16)
        last = 0.0 if left == 0 else _EIGHT_COLUMNS[self.correlation.shape] if left <= 8 else 1.0
        return subset_px * (whole + last)

    @property
    def error_px(self) -> float:
        """Root mean square error of the displacement, √(bias² + noise²), px."""
        return _total(self.noise_px, self.bias_px)

    @property
    def strain_error(self) -> float:
        """Root mean square error of the local strains exx and eyy, √(bias² + noise²)."""
        return _total(self.strain_noise, self.strain_bias)

    def as_dict(self) -> dict[str, Any]:
        """Return the settings and the values as a dict for JSON."""
        return {
            "subset_px": self.correlation.subset_px,
            "step_px": self.correlation.step_px,
            "shape": self.correlation.shape,
            "window_points": self.strain.window_points,
            "gauge_px": self.strain.gauge_px(self.correlation),
            "resolution_px": self.resolution_px,
            "displacement_error_px": self.error_px,
            "strain_error": self.strain_error,
            **_by_component("u", "v", "noise_px", self.noise_px),
            **_by_component("u", "v", "bias_px", self.bias_px),
            **_by_component("exx", "eyy", "noise", self.strain_noise),
            **_by_component("exx", "eyy", "bias", self.strain_bias),
            "lost_share": self.lost_share,
        }


@dataclass(frozen=True)
class Study:
    """The result of `study_settings`.

    Attributes
    ----------
    settings : tuple of StudiedSettings
        All combinations that were not left out, in the order of the sweep.
    wave : Wave
        The assumed strain.
    wave_from : str
        The source of the assumed strain: "given", or the name of the image from which it was estimated.
    noise : float
        Standard deviation of the noise of the reference image, grey levels.
    noise_from : str
        The source of the noise in the results: "reference", or the name of an image of the specimen at rest.
    notes : tuple of str
        A sentence about each further image: at rest or deformed, and the values that show this.
    parts : tuple of ImagePart
        The parts of the reference on which the settings were tried.
    smoothing_px : float
        Standard deviation of the smoothing before interpolation.
    left_out : int
        Number of combinations that were left out, because the subset is narrower than three speckles, the
        strain window does not fit into the parts, or the subsets could not be correlated.
    narrowest_px : float
        Width of three speckles; narrower subsets were left out.
    region : ndarray of bool, shape (height, width)
        The region of interest.
    specimen : Specimen or None
        The specimen that was found; None if a region was given.
    """

    settings: tuple[StudiedSettings, ...]
    wave: Wave
    wave_from: str
    noise: float
    noise_from: str
    notes: tuple[str, ...]
    parts: tuple[ImagePart, ...]
    smoothing_px: float
    left_out: int
    narrowest_px: float
    region: Mask
    specimen: Specimen | None

    def __repr__(self) -> str:
        return f"Study({len(self.settings)} settings, best {self.best[0]!r})"

    @property
    def best(self) -> tuple[StudiedSettings, ...]:
        """All settings, ordered by strain error; settings that lose more than 2 % of the points come last."""
        key = lambda each: (each.lost_share > LOST_SHARE, each.strain_error)  # noqa: E731
        return tuple(sorted(self.settings, key=key))

    @property
    def recommended(self) -> StudiedSettings:
        """The settings with the least strain error, or nearly so with a subset that takes less time."""
        least = self.best[0]
        choice = [
            each
            for each in self.best
            if each.strain_error <= NEARLY * least.strain_error
            and each.lost_share <= max(LOST_SHARE, least.lost_share)
            and replace(each.correlation, subset_px=least.correlation.subset_px) == least.correlation
            and each.strain == least.strain
        ]
        return min(choice, key=lambda each: each.subset_time)

    @property
    def front(self) -> tuple[StudiedSettings, ...]:
        """The Pareto front: no other settings have both less strain noise and a finer resolution."""
        found: list[StudiedSettings] = []
        usable = [each for each in self.settings if each.lost_share <= LOST_SHARE]
        for each in sorted(usable, key=lambda one: (one.resolution_px, root_of(one.strain_noise))):
            if not found or root_of(each.strain_noise) < root_of(found[-1].strain_noise):
                found.append(each)
        return tuple(found)

    def limits_of_sweep(self) -> tuple[str, ...]:
        """Texts such as "widest subset" for recommended values at a limit of the sweep."""
        best = self.recommended
        values = {
            "subset": (best.correlation.subset_px, {e.correlation.subset_px for e in self.settings}),
            "window": (best.strain.window_points, {e.strain.window_points for e in self.settings}),
        }
        # Do not report a narrowest value below which a study cannot go: three speckles, three points.
        lowest = {"subset": max(7.0, self.narrowest_px + 4.0), "window": 3.0}
        return tuple(
            f"{'widest' if own == max(tried) else 'narrowest'} {name}"
            for name, (own, tried) in values.items()
            if len(tried) > 1 and (own == max(tried) or (own == min(tried) and own > lowest[name]))
        )

    def as_dict(self) -> dict[str, Any]:
        """Return the study as a dict for JSON."""
        return {
            "period_px": self.wave.period_px,
            "across_period_px": None if self.wave.is_plane else self.wave.across_px,
            "strain_amplitude": self.wave.strain_amplitude,
            "wave_from": self.wave_from,
            "noise": self.noise,
            "noise_from": self.noise_from,
            "notes": list(self.notes),
            "parts": [vars(part) for part in self.parts],
            "smoothing_px": self.smoothing_px,
            "left_out": self.left_out,
            "narrowest_px": self.narrowest_px,
            "specimen": None if self.specimen is None else self.specimen.as_dict(),
            "recommended": self.recommended.as_dict(),
            "front": [each.as_dict() for each in self.front],
            "settings": [each.as_dict() for each in self.best],
        }


def root_of(values: tuple[float, float]) -> float:
    """Return the root mean square of two values."""
    return math.sqrt((values[0] ** 2 + values[1] ** 2) / 2.0)


def _total(noise: tuple[float, float], bias: tuple[float, float]) -> float:
    return math.hypot(root_of(noise), root_of(bias))


def _by_component(x: str, y: str, what: str, values: tuple[float, float]) -> dict[str, float]:
    return {f"{x}_{what}": values[0], f"{y}_{what}": values[1]}
