"""Cost and accuracy of combinations of settings, for the table "Choice of settings" of docs/correlation.md.

    OMP_NUM_THREADS=1 python -m benchmarks.choice [--star FOLDER] [--json FILE]

The variable OMP_NUM_THREADS is set because idle threads of linear algebra would count as processor time.

With wider subsets and windows, local strain has less noise but a coarser spatial resolution. The product σ R²
measures the quality of a combination of settings; a smaller product is better. Here σ is the standard
deviation of local strain, and R is the period of a strain wave that keeps 90 % of its amplitude. Noise and
resolution are measured on the star images of the DIC Challenge 2.0 (P. Reu et al., Experimental Mechanics 62
(2022) 639-654). Times and mean strain are measured on drawn images.
"""

import argparse
import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.accuracy import STAR, read_star
from benchmarks.speckle import Motion, Speckle, noisy
from benchmarks.theory import cramer_rao_px, slopes
from dic.correlation.correlator import Correlator
from dic.correlation.settings import CorrelationSettings
from dic.strain.measurement import Measurement, measure
from dic.strain.settings import StrainSettings
from dic.typing import Float, Grey

STAR_NOISE_PX = 0.0051
"""Noise of u on the star images, for affine subsets of 31 px (docs/correlation.md, "Resolution")."""

_CALM_PX = 200.0
"""Period in the star images above which the true strain hardly adds to the measured noise."""
_LOSS_PX = 100.0
_PAIRS = 40

Images = tuple[Grey, Grey]


@dataclass(frozen=True)
class Choice:
    """One combination of settings."""

    shape: str
    subset_px: int
    step_px: int
    window_points: int

    @classmethod
    def default(cls) -> "Choice":
        """Return the default settings."""
        correlation, strain = CorrelationSettings(), StrainSettings()
        return cls(correlation.shape, correlation.subset_px, correlation.step_px, strain.window_points)

    @property
    def correlation(self) -> CorrelationSettings:
        return CorrelationSettings(self.subset_px, self.step_px, self.shape)

    def measure(self, images: Images) -> Measurement:
        """Measure the strain of the second image, with points in the whole image."""
        reference, deformed = images
        field = Correlator(reference, np.ones(reference.shape, np.bool_), self.correlation).correlate(
            deformed
        )
        return measure(field, strain=StrainSettings("small", self.window_points))


CHOICES = (
    Choice("affine", 31, 10, 5),
    Choice("affine", 21, 10, 3),
    Choice("quadratic", 31, 10, 3),
    Choice("quadratic", 31, 8, 3),
    Choice("quadratic", 41, 10, 3),
    Choice("quadratic", 51, 10, 3),
    Choice("quadratic", 41, 10, 5),
    Choice("quadratic", 61, 10, 5),
)


@dataclass(frozen=True)
class Wave:
    """The displacement u = 0, v = ½ cos(2π (y - middle) / p) px, whose period p grows along x.

    Parameters
    ----------
    period_px : float
        Period at x = 0.
    growth : float
        Growth of the period, px per px.
    middle_px : float
    """

    period_px: float
    growth: float
    middle_px: float

    def periods(self, measured: Measurement) -> Float:
        """Return the period, px, at each column of points."""
        return self.period_px + self.growth * measured.field.x_px.astype(np.float64)

    def motion(self, x: Float, y: Float) -> tuple[Float, Float]:
        """Return the displacement u, v at (x, y), with which an image can be drawn."""
        phase = 2 * np.pi * (y - self.middle_px) / (self.period_px + self.growth * x)
        return np.zeros_like(x), 0.5 * np.cos(phase)

    def kept(self, measured: Measurement) -> Float:
        """Return the share of the true amplitude of eyy that each column of points measures, (columns,)."""
        periods = self.periods(measured)
        waves = (measured.field.y_px[:, None] - self.middle_px) / periods
        found = measured.strain.eyy
        # Farther from the middle the waves run obliquely, with a shorter period than p.
        use = np.isfinite(found) & (np.abs(waves) <= 1.0)
        true = np.where(use, -np.pi / periods * np.sin(2 * np.pi * waves), 0.0)
        kept: Float = (np.where(use, found, 0.0) * true).sum(axis=0) / (true * true).sum(axis=0)
        return kept

    def resolution_px(self, measured: Measurement) -> float:
        """Return the period, px, of the strain wave that keeps 90 % of its amplitude.

        A parabola of the period is fitted to the columns with shares from 80 to 97 %.
        """
        periods, kept = self.periods(measured), self.kept(measured)
        near = (kept > 0.8) & (kept < 0.97)
        parabola = np.polynomial.Polynomial.fit(periods[near], kept[near], 2)
        roots = np.asarray((parabola - 0.9).roots(), complex)
        low, high = periods[near].min(), periods[near].max()
        (found,) = (r.real for r in roots if abs(r.imag) < 1e-9 and low < r.real < high)
        return float(found)


STAR_WAVE = Wave(10.0, 290.0 / 4000.0, 250.0)


def star_row(choice: Choice, images: Images) -> dict[str, float]:
    """Measure noise, resolution and loss of amplitude on the star images.

    The noise is the scatter of exx, because the true exx of these images is 0.
    """
    measured = choice.measure(images)
    periods, kept = STAR_WAVE.periods(measured), STAR_WAVE.kept(measured)
    noise = float(np.nanstd(measured.strain.exx[:, periods > _CALM_PX]))
    resolution = STAR_WAVE.resolution_px(measured)
    return {
        "noise": noise,
        "resolution_px": resolution,
        "product_px2": noise * resolution**2,
        "lost_at_100_px": 1.0 - float(np.interp(_LOSS_PX, periods, kept)),
        "points_lost": 1.0 - float(measured.field.converged.mean()),
    }


def star_noise() -> float:
    """Return the noise, grey levels, with which drawn patterns have in theory the noise `STAR_NOISE_PX`."""
    speckle = Speckle(4, (320, 320))
    points = np.stack(np.meshgrid(np.arange(30, 290, 10), np.arange(30, 290, 10)), axis=-1).reshape(-1, 2)
    bound_px = cramer_rao_px(speckle.draw(), slopes(speckle), points, 31, "affine")
    return STAR_NOISE_PX / float(np.sqrt((bound_px**2).mean()))


def stretch(strain: float) -> Motion:
    """Return the motion of a uniform strain along x, with lateral contraction by Poisson's ratio 0.3."""
    return lambda x, y: (0.2 + strain * (x - 250), -0.1 - 0.3 * strain * (y - 250))


@dataclass(frozen=True)
class Drawn:
    """Results of one combination of settings for a drawn pair of images; times are processor times."""

    points: int
    correlation_s: float
    image_s: float
    exx: float
    eyy: float
    exx_std: float
    eyy_std: float

    @classmethod
    def of(cls, choice: Choice, images: Images) -> "Drawn":
        """Correlate the second image twice, and time the second run.

        The second run takes as long as a further image of a series.
        """
        reference, deformed = images
        everywhere = np.ones(reference.shape, np.bool_)
        correlator = Correlator(reference, everywhere, choice.correlation, threads=1)
        correlator.correlate(deformed)
        start = time.process_time()
        field = correlator.correlate(deformed)
        correlated = time.process_time()
        measured = measure(field, strain=StrainSettings("small", choice.window_points))
        _ = measured.strain
        image_s, mean = time.process_time() - start, measured.mean
        strains = mean.exx, mean.eyy, mean.exx_std, mean.eyy_std
        return cls(int(field.converged.sum()), correlated - start, image_s, *strains)


def drawn_rows(choices: tuple[Choice, ...], pairs: int) -> list[dict[str, float]]:
    """Measure processor time and scatter of the mean strain on noisy pairs, each pair with all choices."""
    speckle = Speckle(5, (512, 512))
    pictures, grey_levels = (speckle.draw(), speckle.draw(stretch(1e-3))), star_noise()
    found: list[list[Drawn]] = []
    for k in range(pairs + 1):
        reference, deformed = (noisy(a, grey_levels, 2 * k + j) for j, a in enumerate(pictures))
        found.append([Drawn.of(choice, (reference, deformed)) for choice in choices])
    # Leave out the first pair, because its time includes the loading of the compiled kernel.
    return [_summary(list(of_choice)) for of_choice in zip(*found[1:], strict=True)]


def _summary(found: list[Drawn]) -> dict[str, float]:
    strains = [(each.exx, each.eyy) for each in found]
    stated = [(each.exx_std, each.eyy_std) for each in found]
    return {
        "points_per_s": float(np.median([each.points / each.correlation_s for each in found])),
        "image_s": float(np.median([each.image_s for each in found])),
        "mean_std": float(np.sqrt(np.var(strains, axis=0, ddof=1).mean())),
        "stated_mean_std": float(np.sqrt(np.square(stated).mean())),
    }


def rows(choices: tuple[Choice, ...], images: Images | None, pairs: int = _PAIRS) -> list[dict[str, Any]]:
    """Measure all choices; each row also gives speed, time and mean strain relative to the first choice."""
    drawn = drawn_rows(choices, pairs)
    result = []
    for choice, row in zip(choices, drawn, strict=True):
        relative = {f"relative_{name}": row[name] / drawn[0][name] for name in row}
        star = {} if images is None else star_row(choice, images)
        result.append({**vars(choice), **star, **row, **relative})
    return result


def main() -> None:
    parser = argparse.ArgumentParser(
        description="Cost and benefit of the settings of correlation and strain."
    )
    parser.add_argument("--star", type=Path, default=STAR, help="folder with the star images")
    parser.add_argument("--json", type=Path, help="also write what was measured to this file")
    options = parser.parse_args()
    images = read_star(options.star) if options.star.is_dir() else None
    if images is None:
        print(f"noise and resolution: skipped, no folder {options.star}")
    result = rows(CHOICES, images)
    print("".join(f"{name:>23}" for name in result[0]))
    for row in result:
        print("".join(f"{v:>23.4g}" if isinstance(v, float) else f"{v:>23}" for v in row.values()))
    if options.json:
        options.json.write_text(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()
