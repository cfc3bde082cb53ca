"""Compare the bicubic map with the pinhole model. Both models are fitted to the same points."""

from dataclasses import dataclass

import numpy as np

from dic.assessment.paper import BASE, FINE
from dic.calibration.bicubic import BicubicMap
from dic.calibration.pinhole.camera import Pinhole
from dic.calibration.pinhole.fit import fit_pinhole
from dic.calibration.pinhole.prior import KnownCamera
from dic.targets.points import GridPoints
from dic.typing import Float

NOISE_PX = 0.01
"""Standard deviation of each image coordinate of the noisy grid points, px."""

_REPETITIONS = 5
_SHAPE = (1200, 1200)


@dataclass(frozen=True)
class ModelRow:
    """Errors of the bicubic map and of the pinhole model for one simulated camera, px."""

    camera: str
    """Description of the camera, such as "pan 10°"."""
    exact_px: dict[str, float]
    noisy_px: dict[str, float]
    """Root mean square error over the calibrated area, for a fit to exact grid points and for a fit to grid
    points with noise. The keys of the dictionaries are "bicubic" and "pinhole".
    """


def compare_models() -> list[ModelRow]:
    """Return the errors of the bicubic map and of the pinhole model for six simulated cameras.

    Three cameras are panned by 10°, 20° and 30°. Three more cameras are panned and tilted by 25°, with the
    distortion coefficients k1 = 0, 1e-7 and -1e-7 px⁻².
    """
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
        # 12 px is 1 % of the image's width, which is the default uncertainty for a real camera.
        pinhole = fit_pinhole(grid, _SHAPE, KnownCamera(principal_px=(0.0, 0.0), principal_std_px=12.0))
        squares["bicubic"].append(_mean_square(camera, bicubic))
        squares["pinhole"].append(_mean_square(camera, pinhole))
    return {model: float(np.sqrt(np.mean(values))) for model, values in squares.items()}


def _mean_square(camera: Pinhole, fitted: BicubicMap | Pinhole) -> float:
    image_px: Float = camera.project(FINE.points_mm())
    error_px: Float = camera.project(fitted.map(image_px)) - image_px
    return float((error_px**2).sum(axis=1).mean())
