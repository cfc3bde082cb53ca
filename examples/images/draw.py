"""Draws the example images: a plate with a hole in tension, seen by a camera 30° off-axis.

    python examples/images/draw.py [FOLDER]

`grid.png` is the calibration grid in the plate's place, `reference.png` the plate at rest, `loaded.png` the
plate under load. Polycarbonate, 20 MPa along Y, a hole of 3 mm; the displacement is Kirsch's, so that every
strain in the picture is known: the plate stretches by 8333 µε far from the hole, three times as much at
its sides.
"""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from simulators.scene.optics import PinholeCamera
from simulators.scene.render import render
from simulators.scene.scene import Surface
from simulators.scene.sensor import Sensor
from simulators.scene.texture import DARK, LineGrid, Speckle

Array = NDArray[np.float64]

STRESS_MPA = 20.0
YOUNGS_MODULUS_MPA = 2400.0
POISSON_RATIO = 0.37
HOLE_RADIUS_MM = 1.5
CAMERA = PinholeCamera(512, 512, 1600.0, 40.0, 30.0, 0.0, 0.0)


def kirsch_displacement(x_mm: Array, y_mm: Array, stress_mpa: float = STRESS_MPA) -> tuple[Array, Array]:
    """Return the displacement (mm) along X and Y of a wide plate with a hole, pulled along Y.

    Plane stress, after E. G. Kirsch (1898); displacements with Kolosov's constant, as in textbooks.
    """
    a = HOLE_RADIUS_MM
    kappa = (3 - POISSON_RATIO) / (1 + POISSON_RATIO)
    shear_modulus_mpa = YOUNGS_MODULUS_MPA / (2 * (1 + POISSON_RATIO))
    # The angle counts from the direction of the load.
    r, theta = np.hypot(x_mm, y_mm), np.arctan2(-x_mm, y_mm)
    cos, sin, cos3, sin3 = np.cos(theta), np.sin(theta), np.cos(3 * theta), np.sin(3 * theta)
    along = r / a * (kappa + 1) * cos + 2 * a / r * ((1 + kappa) * cos + cos3) - 2 * (a / r) ** 3 * cos3
    across = r / a * (kappa - 3) * sin + 2 * a / r * ((1 - kappa) * sin + sin3) - 2 * (a / r) ** 3 * sin3
    scale = stress_mpa * a / (8 * shear_modulus_mpa)
    return -scale * across, scale * along


class CoarseSpeckle(Speckle):
    """Speckles that are 5 px wide at 40 px/mm."""

    CELL_MM: ClassVar[float] = 0.14


@dataclass(frozen=True)
class PlateWithHole:
    """Speckles around a dark hole; `stress_mpa` has carried each of them to where it is."""

    speckle: Speckle
    stress_mpa: float
    quadrature_order: ClassVar[int] = 3

    def reflectance(self, points_mm: Array) -> Array:
        """Return the reflectance (n,) at points (n, 2) of the loaded plate, mm."""
        material = points_mm.copy()
        for _ in range(12):
            r = np.hypot(*material.T)
            # Inside the hole there is no material; its edge is where it is whatever is said there.
            held = material * (np.maximum(r, 0.8 * HOLE_RADIUS_MM) / np.maximum(r, 1e-9))[:, None]
            held[r < 1e-6] = 0.0, HOLE_RADIUS_MM
            material = points_mm - np.column_stack(kirsch_displacement(*held.T, self.stress_mpa))
        shown = self.speckle.reflectance(material)
        return np.where(np.hypot(*material.T) < HOLE_RADIUS_MM, DARK, shown)


def main() -> None:
    """Write the three images."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent
    speckle = CoarseSpeckle.sprayed(5)
    sensor = Sensor(bits=8, full_well_e=32_500.0, read_noise_e=20.0, saturation_exposure_us=12_000.0)
    rng = np.random.default_rng(1)
    shown = {
        "grid": LineGrid(line_width_mm=0.12, edge_mm=0.08),
        "reference": PlateWithHole(speckle, 0.0),
        "loaded": PlateWithHole(speckle, STRESS_MPA),
    }
    for name, texture in shown.items():
        image = sensor.expose(render(CAMERA, Surface(texture)), 10_000.0, 1.0, rng)
        Image.fromarray(image).save(folder / f"{name}.png", optimize=True)


if __name__ == "__main__":
    main()
