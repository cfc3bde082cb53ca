"""The bicubic map and the pinhole model fitted to the same points, exact ones and noisy ones."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dic.assessment.paper import BASE, FINE
from dic.calibration.bicubic import BicubicMap
from dic.calibration.pinhole.camera import Pinhole
from dic.calibration.pinhole.fit import fit_pinhole
from dic.calibration.pinhole.prior import Known
from dic.targets.points import GridPoints

NOISE_PX = 0.01
"""Standard deviation of a coordinate of the noisy grid points."""

_REPETITIONS = 5
_SHAPE = (1200, 1200)


@dataclass(frozen=True)
class ModelRow:
    """How far from the truth both models put points of the plane, rms over the calibrated area, px.

    Attributes
    ----------
    camera : str
        For people.
    exact_px, noisy_px : dict of str to float
        By model, fitted to exact and to noisy grid points.
    """

    camera: str
    exact_px: dict[str, float]
    noisy_px: dict[str, float]


def compare_models() -> list[ModelRow]:
    """Return both models' errors for the paper's three cameras and where the bicubic map fails."""
    cameras = {f"pan {pan:g}°": Pinhole.swung(pan_deg=pan) for pan in (10.0, 20.0, 30.0)}
    for k1 in (0.0, 1e-7, -1e-7):
        bent = f", k1 = {k1:+g}" if k1 else ""
        cameras[f"pan = tilt = 25°{bent}"] = Pinhole.swung(pan_deg=25.0, tilt_deg=25.0, k1_per_px2=k1)
    return [
        ModelRow(name, _errors(camera, 0.0, 1), _errors(camera, NOISE_PX, _REPETITIONS))
        for name, camera in cameras.items()
    ]


def _errors(camera: Pinhole, noise_px: float, repetitions: int) -> dict[str, float]:
    xy_mm = BASE.points_mm()
    index = np.stack(np.meshgrid(range(BASE.count), range(BASE.count)), axis=-1).reshape(-1, 2)
    rng = np.random.default_rng(0)
    squares: dict[str, list[float]] = {"bicubic": [], "pinhole": []}
    for _ in range(repetitions):
        uv_px = camera.project(xy_mm) + rng.normal(0.0, 1.0, xy_mm.shape) * noise_px
        grid = GridPoints(index, xy_mm, uv_px, (BASE.count, BASE.count), xy_mm[1, 0] - xy_mm[0, 0])
        bicubic = BicubicMap.fit(uv_px, xy_mm)
        # the principal point is uncertain by 1 % of the image's width, as it is for a real camera
        pinhole = fit_pinhole(grid, _SHAPE, Known(principal_px=(0.0, 0.0), principal_std_px=12.0))
        squares["bicubic"].append(_mean_square(camera, bicubic))
        squares["pinhole"].append(_mean_square(camera, pinhole))
    return {model: float(np.sqrt(np.mean(values))) for model, values in squares.items()}


def _mean_square(camera: Pinhole, fitted: BicubicMap | Pinhole) -> float:
    image_px: NDArray[np.float64] = camera.project(FINE.points_mm())
    off_px: NDArray[np.float64] = camera.project(fitted.map(image_px)) - image_px
    return float((off_px**2).sum(axis=1).mean())
