"""Compare the accuracy of the correlation with the limits of theory.

    python -m benchmarks.accuracy [--star FOLDER] [--json FILE]

The program makes three experiments. The first measures the interpolation bias on noiseless images with
sub-pixel shifts. The second compares the noise of displacements with the Cramér-Rao bound, and with the
standard deviation that the correlation states for each point. The third measures the spatial resolution on
the star images of the DIC Challenge 2.0 (P. Reu et al., Experimental Mechanics 62 (2022) 639-654), if the
folder of these images exists.
"""

import argparse
import json
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.speckle import Speckle, noisy, shift
from benchmarks.theory import cramer_rao_px, resolution_px, slopes
from dic.correlation.correlator import Correlator
from dic.correlation.field import Field
from dic.correlation.settings import CorrelationSettings
from dic.image.read import read_image
from dic.typing import Float, Grey

STAR = Path(__file__).parents[1].parent / "shared" / "data" / "star2"
SHIFTS_PX = np.linspace(0.0, 1.0, 11)
_STAR_MIDDLE_PX, _STAR_WIDTH_PX, _STAR_AMPLITUDE_PX = 250.0, 4000.0, 0.5
_STAR_PERIODS_PX = (10.0, 290.0)
_STAR_CALM_PX = 240.0
"""Period in the star images above which the true strain hardly adds to the measured noise."""


@dataclass(frozen=True)
class Bias:
    """Errors of noiseless shifts: the largest mean error of all points, and their largest scatter."""

    bias_px: float
    scatter_px: float


def interpolation_bias(speckle: Speckle, settings: CorrelationSettings) -> Bias:
    """Shift a noiseless pattern by u = 0 … 1 px along x and 1 px - u along y; return the largest errors."""
    correlator = Correlator(speckle.draw().astype(np.float32), settings=settings)
    biases, scatters = [], []
    for u in SHIFTS_PX:
        v = 1.0 - u
        field = correlator.correlate(speckle.draw(shift(u, v)).astype(np.float32))
        error = np.stack([field.u_px - u, field.v_px - v])[:, field.converged]
        biases.append(np.abs(error.mean(axis=1)).max())
        scatters.append(error.std(axis=1).max())
    return Bias(float(max(biases)), float(max(scatters)))


@dataclass(frozen=True)
class Noise:
    """Standard deviation of displacements (Cramér-Rao bound, observed, stated), and the mean error."""

    bound_px: float
    observed_px: float
    predicted_px: float
    bias_px: float


def noise(
    speckle: Speckle, settings: CorrelationSettings, grey_levels: float, pairs: int = 4, u_px: float = 0.2
) -> Noise:
    """Shift a pattern by (`u_px`, -`u_px`), add noise to both images, and measure the scatter of all points.

    The scatter of a point is its standard deviation over several pairs of images with different noise. It
    does not contain the errors that all pairs share.
    """
    pictures = speckle.draw(), speckle.draw(shift(u_px, -u_px))
    truth = np.array([u_px, -u_px])
    errors, variances = [], []
    for k in range(pairs):
        reference, deformed = (noisy(a, grey_levels, 2 * k + j) for j, a in enumerate(pictures))
        field = _whole(reference, settings).correlate(deformed)
        errors.append(np.stack([field.u_px, field.v_px], axis=-1) - truth)
        variances.append(np.stack([field.std_u_px, field.std_v_px], axis=-1) ** 2)
    points = field.points.astype(int).reshape(*field.active.shape, 2)
    good = np.isfinite(errors).all(axis=(0, 3))
    inside = (points > 40).all(axis=2) & (points < np.array(speckle.shape[::-1]) - 41).all(axis=2)
    error = np.array(errors)[:, good & inside]
    bound = cramer_rao_px(
        pictures[0], slopes(speckle), points[good & inside], settings.subset_px, settings.shape
    )
    return Noise(
        grey_levels * float(np.sqrt((bound**2).mean())),
        float(np.sqrt(error.var(axis=0, ddof=1).mean())),
        float(np.sqrt(np.array(variances)[:, good & inside].mean())),
        float(np.abs(error.mean(axis=(0, 1))).max()),
    )


def _whole(reference: Grey, settings: CorrelationSettings) -> Correlator:
    """Return a correlator with points in the whole image, so that all pairs have the same points."""
    return Correlator(reference, np.ones(reference.shape, np.bool_), settings)


@dataclass(frozen=True)
class Resolution:
    """Results of the star images: the period that keeps 90 % of its amplitude, and the noise of u."""

    theory_px: float
    measured_px: float
    noise_px: float

    @property
    def product_px2(self) -> float:
        """Resolution times noise. This product hardly depends on the width of the subset."""
        return self.measured_px * self.noise_px


def star_resolution(images: tuple[Grey, Grey], settings: CorrelationSettings) -> Resolution:
    """Measure the star images: v = cos(2π (y - 250) / p) / 2 with a period p that grows along x, and u = 0.

    The share of the amplitude that a column keeps is the projection of the measured v on the true v over two
    periods. Around the expected resolution, a parabola of the period is fitted to this share. The resolution
    is the period at which the parabola has the value 90 %.
    """
    expected = resolution_px(settings.subset_px, settings.shape)
    low, high = 0.8 * expected, 1.25 * expected
    field = _correlate_columns(images, slice(0, int(_column(high)) + settings.subset_px + 8), settings)
    period = _STAR_PERIODS_PX[0] + _STAR_PERIODS_PX[1] * field.x_px.astype(float) / _STAR_WIDTH_PX
    kept = _kept_amplitude(field, period)
    near = (period > low) & (period < high) & np.isfinite(kept)
    parabola = np.polynomial.Polynomial.fit(period[near], kept[near], 2)
    roots = np.asarray((parabola - 0.9).roots(), complex)
    (measured,) = (r.real for r in roots if abs(r.imag) < 1e-9 and low < r.real < high)
    calm = _correlate_columns(images, slice(int(_column(_STAR_CALM_PX)), None), settings)
    return Resolution(expected, float(measured), float(np.nanstd(calm.u_px)))


def _correlate_columns(images: tuple[Grey, Grey], columns: slice, settings: CorrelationSettings) -> Field:
    reference, deformed = (np.ascontiguousarray(image[:, columns]) for image in images)
    return _whole(reference, settings).correlate(deformed)


def _column(period_px: float) -> float:
    return (period_px - _STAR_PERIODS_PX[0]) / _STAR_PERIODS_PX[1] * _STAR_WIDTH_PX


def _kept_amplitude(field: Field, period: Float) -> Float:
    """Return the share of the true amplitude of v that each column of points has measured, (columns,)."""
    waves = (field.y_px[:, None] - _STAR_MIDDLE_PX) / period
    # Farther from the middle the waves run obliquely, with a shorter period than p.
    use = field.converged & (np.abs(waves) <= 1.0)
    true = np.where(use, _STAR_AMPLITUDE_PX * np.cos(2 * np.pi * waves), 0.0)
    measured = np.where(use, field.v_px, 0.0)
    kept: Float = (measured * true).sum(axis=0) / (true * true).sum(axis=0)
    return kept


def read_star(folder: Path) -> tuple[Grey, Grey]:
    """Read the reference and the deformed star image of the DIC Challenge 2.0, the version with noise."""
    reference, deformed = (folder / f"DIC_Challenge_Star_Noise_{which}.tiff" for which in ("Ref", "Def"))
    return read_image(reference), read_image(deformed)


def bias_rows() -> list[dict[str, Any]]:
    """Measure the interpolation bias of both splines for speckle blobs of three sizes."""
    rows = []
    for sigma, order in product(((1.3, 2.2), (0.8, 1.1), (0.6, 0.8)), (3, 5)):
        speckle = Speckle(3, (256, 256), sigma, 0.035 * (1.75 / float(np.mean(sigma))) ** 2)
        found = interpolation_bias(speckle, CorrelationSettings(subset_px=21, step_px=7, order=order))
        rows.append({"sigma": f"{sigma[0]}-{sigma[1]}", "order": order, **vars(found)})
    return rows


def noise_rows() -> list[dict[str, Any]]:
    """Measure noise for both shape functions, both splines, two subset widths and three noise levels."""
    speckle = Speckle(4, (384, 384))
    rows = []
    for shape, order, subset in product(("affine", "quadratic"), (3, 5), (21, 31)):
        for grey_levels in (1.0, 2.0, 8.0):
            settings = CorrelationSettings(
                subset_px=subset, step_px=11, shape=shape, order=order, min_zncc=0.3
            )
            found = noise(speckle, settings, grey_levels)
            rows.append(
                {
                    "shape": shape,
                    "order": order,
                    "subset": subset,
                    "noise": grey_levels,
                    **vars(found),
                    "over_bound": found.observed_px / found.bound_px,
                    "predicted_ratio": found.predicted_px / found.observed_px,
                }
            )
    return rows


def star_rows(folder: Path) -> list[dict[str, Any]]:
    """Measure the resolution of both shape functions with three subset widths; return the table rows."""
    images = read_star(folder)
    rows = []
    for shape, subset in product(("affine", "quadratic"), (17, 21, 31)):
        found = star_resolution(images, CorrelationSettings(subset_px=subset, step_px=3, shape=shape))
        rows.append(
            {
                "shape": shape,
                "subset": subset,
                **vars(found),
                "ratio": found.measured_px / found.theory_px,
                "product_px2": found.product_px2,
            }
        )
    return rows


def _print(title: str, rows: list[dict[str, Any]]) -> None:
    print(f"\n{title}")
    print("".join(f"{name:>16}" for name in rows[0]))
    for row in rows:
        cells = (f"{v:.4g}" if isinstance(v, float) else str(v) for v in row.values())
        print("".join(f"{cell:>16}" for cell in cells))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--star", type=Path, default=STAR, help="folder with the star images")
    parser.add_argument("--json", type=Path, help="also write what was measured to this file")
    options = parser.parse_args()
    result = {"bias": bias_rows()}
    _print("interpolation bias: worst over shifts of 0 to 1 px, no noise, 21 × 21", result["bias"])
    result["noise"] = noise_rows()
    _print("noise: standard deviations of u and v for noise in grey levels, shift 0.2 px", result["noise"])
    if options.star.is_dir():
        result["star"] = star_rows(options.star)
        _print("star: period of which 90 % of the amplitude is kept, quintic", result["star"])
    else:
        print(f"\nstar: skipped, no folder {options.star}")
    if options.json:
        options.json.write_text(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()
