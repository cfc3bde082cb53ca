"""Study settings: predict the errors of many combinations on the user's own images."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dic.correlation.settings import CorrelationSettings
from dic.correlation.smoothing import chosen_smoothing
from dic.errors import CorrelationError, MeasurementError, require_kind
from dic.image.given import checked_region, grey_image, name_of
from dic.image.read import require_same_size
from dic.quality.noise import noise_of_one
from dic.quality.quality import SPECKLES_PER_SUBSET
from dic.quality.speckle import autocovariance, even_light, speckle_size
from dic.specimen.find import find_specimen
from dic.strain.resolution import strain_resolution_px
from dic.strain.settings import StrainSettings
from dic.study.parts import ImagePart, chosen_parts
from dic.study.pattern import corner_noise
from dic.study.result import StudiedSettings, Study
from dic.study.static import StaticMotion, motion_between, require_rest, wave_of
from dic.study.sweep import Sweep
from dic.study.trials import Trial, TrialImages, rms, trial_images, tried
from dic.study.wave import Wave
from dic.study.windows import noise_factor_per_px
from dic.typing import Grey, ImageLike, Mask, PathLike

_COMPUTED = 50.0
"""Weight of the computed noise of strain, as a number of observed values; it is accurate to about 10 %."""


@dataclass(frozen=True)
class _Companions:
    """The data from the further images: an image at rest, and the strain wave of a deformed image."""

    static: tuple[str, Grey] | None
    wave: tuple[str, Wave] | None
    notes: tuple[str, ...]


def study_settings(
    reference: ImageLike,
    images: Sequence[ImageLike] = (),
    *,
    static: ImageLike | None = None,
    region: Mask | PathLike | None = None,
    wave: Wave | None = None,
    sweep: Sweep | None = None,
    settings: CorrelationSettings | None = None,
    strain: StrainSettings | None = None,
    advance: Callable[[], None] | None = None,
) -> Study:
    """Predict the errors of many combinations of settings on the user's own images.

    `docs/study.md` describes the method.

    Parameters
    ----------
    reference : ndarray, shape (height, width), or path
    images : sequence of ndarray or path
        Further images of the specimen. The first image that shows the specimen at rest gives the noise. If
        `wave` is not given, the first other image gives the assumed strain.
    static : ndarray or path, optional
        An image that must show the specimen at rest. If it does not, an error is raised.
    region : ndarray of bool, shape (height, width), or path, optional
        Region of interest. Default: the specimen, which is found by its speckles.
    wave : Wave, optional
        The assumed strain. Default: the strain of a deformed image if there is one, otherwise ``Wave()``.
    sweep : Sweep, optional
        The combinations of settings, and the number of parts of the region on which they are tried.
    settings : CorrelationSettings, optional
        Spline order, smoothing and smallest ZNCC of all combinations.
    strain : StrainSettings, optional
        Strain measure of all combinations. The source must be "fit".
    advance : callable, optional
        Function that is called after each of `Sweep.trials` trials.

    Raises
    ------
    MeasurementError
        If an image or a setting cannot be used, or if no combination fits into the region.
    """
    require_kind("wave", wave, Wave | None, "give dic.study.Wave(period_px=100)")
    require_kind("sweep", sweep, Sweep | None, "give dic.study.Sweep(subsets_px=(21, 31, 41))")
    require_kind("settings", settings, CorrelationSettings | None, "give dic.CorrelationSettings()")
    require_kind("strain", strain, StrainSettings | None, "give dic.StrainSettings(measure='small')")
    sweep, settings, strain = sweep or Sweep(), settings or CorrelationSettings(), strain or StrainSettings()
    if strain.source != "fit":
        remedy = "give --strain-from fit, for which alone settings can be compared"
        raise CorrelationError("settings", "source of local strain", "fit", strain.source, remedy)
    name = name_of(reference, "reference image")
    grey = grey_image(reference, name)
    specimen = find_specimen(grey, min(sweep.subsets_px)) if region is None else None
    mask = specimen.mask if specimen is not None else checked_region(region, grey.shape)
    asked = settings.smoothing_px
    smoothing_px = chosen_smoothing(grey, mask, settings).width_px
    settings = replace(settings, smoothing_px=smoothing_px)
    given = [*(() if static is None else (static,)), *images]
    companions = _companions(grey, name, given, static is not None, mask, settings, wave is None)
    used = wave or (companions.wave[1] if companions.wave else Wave())
    parts = chosen_parts(mask, sweep.parts)
    corners = [corner_noise(grey[part.pixels]) for part in parts]
    noise = min(noise_of_one(grey, mask), float(np.sqrt(np.mean(np.square(corners)))))
    narrowest_px = SPECKLES_PER_SUBSET * _speckle_px(grey, mask, noise)
    second = companions.static[1] if companions.static else None
    # If there is only one part, try it twice, with waves whose phases differ.
    numbered = enumerate(parts if len(parts) > 1 else (*parts, *parts))
    trials = [trial_images((grey, second), mask, part, used, noise, number) for number, part in numbered]
    studied = [
        replace(each, correlation=replace(each.correlation, smoothing_px=asked))
        for each in _studied(trials, sweep, settings, strain, narrowest_px, advance or (lambda: None))
    ]
    if not studied:
        raise _nothing_fits(sweep, parts, narrowest_px)
    wave_from = "given" if wave is not None else companions.wave[0] if companions.wave else "default"
    noise_from = companions.static[0] if companions.static else "reference"
    left_out = sweep.combinations - len(studied)
    return Study(
        tuple(studied), used, wave_from, noise, noise_from, companions.notes, parts, smoothing_px, left_out,
        narrowest_px, mask, specimen,
    )  # fmt: skip


def _companions(
    grey: Grey,
    name: str,
    images: Sequence[ImageLike],
    first_is_static: bool,
    region: Mask,
    settings: CorrelationSettings,
    wanted_wave: bool,
) -> _Companions:
    """Decide for each further image whether it shows the specimen at rest or deformed."""
    static: tuple[str, Grey] | None = None
    wave: tuple[str, Wave] | None = None
    notes: list[str] = []
    for number, image in enumerate(images):
        label = name_of(image, f"image {number + 1}")
        other = grey_image(image, label)
        require_same_size([grey, other], [name, label])
        try:
            motion = StaticMotion.of(motion_between(grey, other, region, settings))
        except MeasurementError as error:
            raise error.at(label) from error
        named = number == 0 and first_is_static
        if named:
            require_rest(motion, label)
        use, at_rest = "not used", named or motion.at_rest
        if at_rest and static is None:
            static, use = (label, other), "gives the noise"
        elif not at_rest and wanted_wave and wave is None:
            wave, use = (label, wave_of(grey, other, region, settings, label)), "gives the assumed strain"
        notes.append(f"{label}: {'at rest' if at_rest else 'deformed'} ({motion}); {use}")
    return _Companions(static, wave, tuple(notes))


def _studied(
    trials: Sequence[TrialImages],
    sweep: Sweep,
    settings: CorrelationSettings,
    strain: StrainSettings,
    narrowest_px: float,
    advance: Callable[[], None],
) -> Iterator[StudiedSettings]:
    for shape in sweep.shapes:
        for subset_px in sweep.subsets_px:
            for step_px in sweep.measured_steps_px:
                used = replace(settings, subset_px=subset_px, step_px=step_px, shape=shape)
                found = _tried(trials, used) if subset_px >= narrowest_px else []
                steps = [each for each in sweep.steps_px if sweep.measured_with(each) == step_px]
                for wider_px in steps if found else ():
                    for window in sweep.windows_points:
                        row = _row(found, wider_px, replace(strain, window_points=window))
                        if row is not None:
                            yield row
                advance()


def _tried(trials: Sequence[TrialImages], settings: CorrelationSettings) -> list[Trial]:
    """Return the trials of all parts; an empty list if a part cannot be correlated with these settings."""
    try:
        return [tried(each, settings) for each in trials]
    except CorrelationError:
        # Leave these settings out: the subset is too small to find the pattern, or too large for the part.
        return []


def _row(trials: Sequence[Trial], step_px: int, strain: StrainSettings) -> StudiedSettings | None:
    biases = [each.strain_bias(step_px, strain) for each in trials]
    strain_bias = rms(biases)
    noise_px = rms([each.noise_px for each in trials])
    if min(each.shape[1] for each in biases) == 0 or not np.isfinite(noise_px).all():
        return None
    correlation = replace(trials[0].settings, step_px=step_px)
    factor = noise_factor_per_px(correlation, strain)
    lost, points = np.sum([each.lost for each in trials], axis=0)
    return StudiedSettings(
        correlation,
        strain,
        strain_resolution_px(correlation, strain),
        noise_px,
        rms([each.bias_px() for each in trials]),
        _strain_noise(trials, step_px, strain, noise_px, factor),
        strain_bias,
        float(lost / points),
    )


def _strain_noise(
    trials: Sequence[Trial],
    step_px: int,
    strain: StrainSettings,
    noise_px: tuple[float, float],
    factor: float,
) -> tuple[float, float]:
    """Return the noise of exx and eyy: the root of a weighted mean of an observed and a computed variance.

    The computed variance follows from the noise of the displacements, for a uniform texture. The weight of
    the observed variance is the number of virtual strain gauges that fit side by side into the parts. The
    weight of the computed variance is `_COMPUTED`.
    """
    observed = [each.strain_noise(step_px, strain) for each in trials]
    gauge_px = strain.gauge_px(trials[0].settings)
    gauges = 2.0 * sum(each.shape[1] for each in observed) * (step_px / gauge_px) ** 2
    weight = gauges / (gauges + _COMPUTED)
    x, y = (
        float(np.sqrt(weight * seen**2 + (1.0 - weight) * (factor * own) ** 2))
        for seen, own in zip(rms(observed), noise_px, strict=True)
    )
    return x, y


def _speckle_px(grey: Grey, region: Mask, noise: float) -> float:
    """Return the size of the speckles, px: along x or along y, whichever is larger."""
    pattern = even_light(grey, region)
    sizes = [speckle_size(autocovariance(pattern, region, noise, axis)) for axis in (0, 1)]
    return max(size for size in sizes if np.isfinite(size)) if np.isfinite(sizes).any() else 0.0


def _odd(width_px: float) -> int:
    """Return the smallest odd number that is at least `width_px`."""
    return int(np.ceil(width_px)) | 1


def _nothing_fits(sweep: Sweep, parts: Sequence[ImagePart], narrowest_px: float) -> MeasurementError:
    largest = max(parts, key=lambda part: part.height * part.width)
    return CorrelationError(
        "region of interest",
        "try the settings",
        f"a part that holds complete strain windows of subsets of three speckles, {narrowest_px:.0f} px",
        f"{largest.width} x {largest.height} px, and subsets of {', '.join(map(str, sweep.subsets_px))} px",
        f"enlarge the region, or give --subsets {_odd(narrowest_px)},{_odd(1.5 * narrowest_px)} --windows 3",
    )
