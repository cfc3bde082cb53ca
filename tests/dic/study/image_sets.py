"""Sets of images with known motion, drawn without code of the study, and the true errors of settings."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.accuracy import read_star
from benchmarks.speckle import Speckle, noisy
from dic import CorrelationSettings, Correlator, StrainSettings
from dic.strain.displacement import raw_displacement
from dic.strain.strain import strain_field
from dic.study import StudiedSettings, Study, Sweep
from simulators.scene.sensor import Sensor
from simulators.scene.texture import Speckle as Sprayed
from tests.conftest import SpecklePattern

Field = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, ...]]
"""Type of a function of places (x, y) in the reference that returns u, v, u_x, u_y, v_x, v_y."""

STAR_PERIOD_PX, STAR_HALF_WIDTH_PX = 100.0, 150


@dataclass(frozen=True)
class ImageSet:
    """Pairs of noisy images, the true displacement field, and the arguments of a study of these images.

    `told` are arguments of `dic.study_settings`. `components` selects the errors that count: 0 for u and exx,
    1 for v and eyy.
    """

    name: str
    pairs: list[tuple[np.ndarray, np.ndarray]]
    truth: Field
    told: dict[str, Any]
    images: list[np.ndarray] = field(default_factory=list)
    components: tuple[int, ...] = (0, 1)
    used: Callable[[np.ndarray, np.ndarray], np.ndarray] = lambda x, y: np.ones(x.shape, bool)

    def true_errors(self, sweep: Sweep) -> dict[tuple[object, ...], tuple[float, float]]:
        """Return for all settings the root mean square errors of displacement and strain, over all pairs.

        Only points whose subset and strain window are complete count, at least 6 px from the image's edge.
        """
        found: dict[tuple[object, ...], list[np.ndarray]] = {}
        for shape, subset, step in product(sweep.shapes, sweep.subsets_px, sweep.steps_px):
            settings = CorrelationSettings(subset, step, shape)
            for reference, deformed in self.pairs:
                whole = np.ones(reference.shape, bool)
                measured = Correlator(reference, whole, settings).correlate(deformed)
                for window in sweep.windows_points:
                    errors = self._errors(measured, StrainSettings(window_points=window))
                    found.setdefault((shape, subset, step, window), []).append(errors)
        return {
            key: tuple(np.sqrt(np.nanmean(np.concatenate(each, axis=1) ** 2, axis=1)))
            for key, each in found.items()
        }

    def _errors(self, measured: Any, strain: StrainSettings) -> np.ndarray:
        """Return the errors of displacement and strain of one pair, shape (2, n)."""
        x, y = np.meshgrid(measured.x_px.astype(float), measured.y_px.astype(float))
        u, v, u_x, u_y, v_x, v_y = self.truth(x, y)
        points = replace(raw_displacement(measured, gradients=False), noise=None)
        local = strain_field(points, strain)
        # Green-Lagrange strain of the true gradient
        exx, eyy = u_x + (u_x**2 + v_x**2) / 2, v_y + (u_y**2 + v_y**2) / 2
        height, width = measured.region.shape
        reach = measured.settings.subset_px // 2 + 6
        half = reach + strain.window_points // 2 * measured.settings.step_px
        inner, deep = (
            (x >= far) & (x < width - far) & (y >= far) & (y < height - far) & self.used(x, y)
            for far in (reach, half)
        )
        displacement = np.stack([measured.u_px - u, measured.v_px - v])[list(self.components)]
        strains = np.stack([local.exx - exx, local.eyy - eyy])[list(self.components)]
        return np.stack(
            [np.where(inner, displacement, np.nan).ravel(), np.where(deep, strains, np.nan).ravel()]
        )


def key_of(each: StudiedSettings) -> tuple[object, ...]:
    """Return the values of the four settings that a study varies."""
    own = each.correlation
    return own.shape, own.subset_px, own.step_px, each.strain.window_points


def predicted(study: Study, components: tuple[int, ...]) -> dict[tuple[object, ...], tuple[float, float]]:
    """Return for all settings the predicted errors of displacement and strain, over some components."""
    return {
        key_of(each): (
            _total(each.noise_px, each.bias_px, components),
            _total(each.strain_noise, each.strain_bias, components),
        )
        for each in study.settings
    }


def _total(noise: tuple[float, float], bias: tuple[float, float], components: tuple[int, ...]) -> float:
    squares = [noise[k] ** 2 + bias[k] ** 2 for k in components]
    return float(np.sqrt(np.mean(squares)))


def wave(period_px: float, amplitude: float, phase: float = 0.7) -> Field:
    """Return the field of a strain wave along each axis."""
    k = 2 * np.pi / period_px

    def at(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, ...]:
        none = np.zeros_like(x)
        u, v = (amplitude / k * np.sin(k * each + phase) for each in (x, y))
        u_x, v_y = (amplitude * np.cos(k * each + phase) for each in (x, y))
        return u, v, u_x, none, none, v_y

    return at


def cells(period_px: float, amplitude: float, stretch: float) -> Field:
    """Return the field of a strain that varies along both axes, plus a uniform strain along y."""
    k = 2 * np.pi / period_px

    def at(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, ...]:
        a, (sx, cx), (sy, cy) = amplitude / k, (np.sin(k * x), np.cos(k * x)), (np.sin(k * y), np.cos(k * y))
        u, v = a * sx * cy, a * cx * sy + stretch * y
        return (
            u,
            v,
            amplitude * cx * cy,
            -amplitude * sx * sy,
            -amplitude * sx * sy,
            (amplitude * cx * cy + stretch),
        )

    return at


def origin(truth: Field, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the reference positions of the material that a deformed image shows at (x, y)."""
    X, Y = x, y
    for _ in range(40):
        u, v = truth(X, Y)[:2]
        X, Y = x - u, y - v
    return X, Y


def of_dots(pairs: int = 3, shape: tuple[int, int] = (360, 380)) -> ImageSet:
    """Return images of `SpecklePattern`: noise 2 grey levels, strain wave of ±0.5 % with a period of 100."""
    truth, pattern = wave(100.0, 0.005), SpecklePattern(seed=11, shape=shape)
    clean = pattern.draw(), pattern.draw(lambda x, y: origin(truth, x, y))
    drawn = _noisy(clean, 2.0, pairs)
    return ImageSet("dots", drawn, truth, {"period_px": 100.0, "strain_amplitude": 0.005})


def of_short_waves(pairs: int = 3) -> ImageSet:
    """Return images of blobs: noise 1 grey level, strain wave of ±1 % with a period of 60 px."""
    truth = wave(60.0, 0.01)
    clean = _blobs(Speckle(21, (400, 400)), truth)
    drawn = _noisy(clean, 1.0, pairs)
    return ImageSet("short waves", drawn, truth, {"period_px": 60.0, "strain_amplitude": 0.01})


def of_coarse_speckles(pairs: int = 3) -> ImageSet:
    """Return images of coarse blobs: noise 4 grey levels, wave of ±0.2 % and 220 px, and an image at rest."""
    truth, speckle = wave(220.0, 0.002), Speckle(22, (480, 480), (2.4, 3.6), 0.012)
    clean = _blobs(speckle, truth)
    rest = noisy(speckle.draw(lambda x, y: (0 * x + 0.06, 0 * y - 0.04)), 4.0, 99)
    drawn = _noisy(clean, 4.0, pairs)
    told = {"period_px": 220.0, "strain_amplitude": 0.002}
    return ImageSet("coarse speckles, image at rest", drawn, truth, told, [rest])


def of_simulated_camera(pairs: int = 3) -> ImageSet:
    """Return images of the simulators' pattern and 8-bit sensor with photon noise; wave of ±0.4 %, 150 px."""
    truth, sensor = wave(150.0, 0.004), Sensor(8, 9000.0, 12.0, 1000.0)
    size, per_mm, order = 420, 55.0, 4
    nodes, weights = np.polynomial.legendre.leggauss(order)
    at = (np.arange(size)[:, None] + nodes / 2).ravel()
    x, y = np.meshgrid(at, at)
    pictures = []
    for X, Y in ((x, y), origin(truth, x, y)):
        points_mm = np.stack([X.ravel(), Y.ravel()], axis=1) / per_mm - 4.0
        light = Sprayed.sprayed(5).reflectance(points_mm).reshape(size, order, size, order)
        pictures.append(np.einsum("rjci,j,i->rc", light, weights / 2, weights / 2))
    rng = np.random.default_rng(3)
    drawn = [
        tuple(sensor.expose(each, 900.0, 1.0, rng).astype(np.float32) for each in pictures)
        for _ in range(pairs)
    ]
    return ImageSet("simulated camera", drawn, truth, {"period_px": 150.0, "strain_amplitude": 0.004})


def of_sharp_speckles(pairs: int = 3) -> ImageSet:
    """Return images of sharp blobs, which the correlation smooths: noise 3 grey levels, ±0.3 %, 130 px."""
    truth = wave(130.0, 0.003)
    clean = _blobs(Speckle(77, (360, 360), (0.7, 1.0), 0.08), truth)
    told = {"period_px": 130.0, "strain_amplitude": 0.003}
    return ImageSet("sharp speckles", _noisy(clean, 3.0, pairs), truth, told)


def of_much_noise(pairs: int = 3) -> ImageSet:
    """Return images of blobs: noise 9 grey levels, strain wave of ±2 % with a period of 90 px."""
    truth = wave(90.0, 0.02)
    clean = _blobs(Speckle(78, (360, 360)), truth)
    told = {"period_px": 90.0, "strain_amplitude": 0.02}
    return ImageSet("much noise", _noisy(clean, 9.0, pairs), truth, told)


def of_star(folder: Path) -> ImageSet:
    """Return the part of the star images (DIC Challenge 2.0) with periods near 100 px; the true u is 0."""
    growth, middle = 290.0 / 4000.0, 250.0
    centre = round((STAR_PERIOD_PX - 10.0) / growth)
    left = centre - STAR_HALF_WIDTH_PX
    pair = tuple(
        np.ascontiguousarray(image[:, left : centre + STAR_HALF_WIDTH_PX]) for image in read_star(folder)
    )

    def truth(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, ...]:
        period = 10.0 + growth * (x + left)
        phase = 2 * np.pi * (y - middle) / period
        none = np.zeros_like(x)
        v_x = 0.5 * np.sin(phase) * phase * growth / period
        return none, 0.5 * np.cos(phase), none, none, v_x, -np.pi / period * np.sin(phase)

    # Farther from the middle, the waves run obliquely.
    told = {"period_px": STAR_PERIOD_PX, "strain_amplitude": np.pi / STAR_PERIOD_PX}
    near = lambda x, y: np.abs(y - middle) <= 1.5 * STAR_PERIOD_PX  # noqa: E731
    return ImageSet("star", [pair], truth, told, components=(1,), used=near)


def of_measured_field(pairs: int = 3) -> ImageSet:
    """Return images of `cells`; here the study estimates the strain wave from a deformed image."""
    truth, speckle = cells(180.0, 0.006, 0.004), Speckle(24, (520, 520))
    drawn = _noisy(_blobs(speckle, truth), 2.0, pairs)
    return ImageSet("field of a deformed image", drawn, truth, {}, [drawn[0][1]])


def _blobs(speckle: Speckle, truth: Field) -> tuple[np.ndarray, np.ndarray]:
    def motion(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        X, Y = origin(truth, x, y)
        return x - X, y - Y

    return speckle.draw(), speckle.draw(motion)


def _noisy(
    clean: tuple[np.ndarray, np.ndarray], noise: float, pairs: int
) -> list[tuple[np.ndarray, np.ndarray]]:
    first, second = clean
    return [(noisy(first, noise, 2 * k + 1), noisy(second, noise, 2 * k + 2)) for k in range(pairs)]
