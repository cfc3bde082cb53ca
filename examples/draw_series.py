"""Draws the images of `dic example`: a narrow specimen pulled step by step, seen by a camera 30° off-axis.

    python examples/draw_series.py [FOLDER]

The virtual rig's specimen (2024-T3 sheet, 10 mm × 1 mm), misalignment, camera and sensor make the images, so
their strain is known exactly: `truth.json` holds it. As the grips straighten the specimen, it tips by up to
0.08°, which the camera takes for a strain of up to 850 µε (the slope times tan 30°).
"""

import csv
import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from simulators.scene.exact_properties import exact_properties
from simulators.scene.optics import PinholeCamera
from simulators.scene.render import render
from simulators.scene.scene import Misalignment, Surface
from simulators.scene.sensor import Sensor
from simulators.scene.specimen import SimulatedSpecimen, SpecimenSettings
from simulators.scene.texture import DARK, LineGrid, Speckle

Array = NDArray[np.float64]

WIDTH_MM = 10.0
LOADS_N = (*range(200, 2401, 200), 2800, 3200, 3500, 3700)
SECONDS_PER_STEP = 20.0
LOAD_NOISE_N = 2.0
CAMERA = PinholeCamera(432, 432, 1300.0, 40.0, 0.0, 30.0, 0.0)
SENSOR = Sensor(bits=8, full_well_e=32_500.0, read_noise_e=20.0, saturation_exposure_us=12_000.0)
FOLDER = Path(__file__).parents[1] / "dic" / "example" / "files"


class CoarseSpeckle(Speckle):
    """Speckles that are 5 px wide at 33 px/mm."""

    CELL_MM: ClassVar[float] = 0.15


@dataclass(frozen=True)
class Strip:
    """Speckles on a strip along Y, and darkness beside it."""

    speckle: Speckle
    quadrature_order: ClassVar[int] = 3

    def reflectance(self, points_mm: Array) -> Array:
        """Return the reflectance (n,) at material points (n, 2), mm."""
        inside = np.abs(points_mm[:, 0]) < WIDTH_MM / 2
        return np.where(inside, self.speckle.reflectance(points_mm), DARK)


@dataclass(frozen=True)
class White:
    """A white strip on black, which is the mask of the specimen."""

    quadrature_order: ClassVar[int] = 1

    def reflectance(self, points_mm: Array) -> Array:
        """Return 1 (n,) at points (n, 2) on the strip, 0 beside it."""
        return (np.abs(points_mm[:, 0]) < WIDTH_MM / 2).astype(float)


def main() -> None:
    """Write the images, the mask, the machine's record, the true strains and properties."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER
    rng = np.random.default_rng(7)
    strip = Strip(CoarseSpeckle.sprayed(3))
    specimen = SimulatedSpecimen(
        SpecimenSettings(width_mm=WIDTH_MM, parallel_length_mm=40.0, grip_slip_mm=0.2)
    )
    misalignment = Misalignment(loading_slope_y_deg=-0.1)

    def expose(name: str, surface: Surface) -> None:
        image = SENSOR.expose(render(CAMERA, surface), 10_000.0, 1.0, rng)
        Image.fromarray(image).save(folder / name, optimize=True)

    expose("grid.png", Surface(LineGrid(line_width_mm=0.12, edge_mm=0.08)))
    expose("reference.png", Surface(strip))
    mask = np.where(render(CAMERA, Surface(White())) > 0.5, 255, 0).astype(np.uint8)
    Image.fromarray(mask).save(folder / "mask.png", optimize=True)
    rows, truth = [(0.0, 0.0, 0.0, "reference.png")], []
    for number, load_n in enumerate(LOADS_N, 1):
        while specimen.stretch_to(specimen.state.displacement_mm + 1e-4) < load_n:
            pass
        state, name = specimen.state, f"step-{number:02}.png"
        gradient = state.deformation_gradient()
        expose(name, Surface(strip, misalignment.loaded(state.load_n), gradient))
        shown_n = state.load_n + LOAD_NOISE_N * rng.standard_normal()
        rows.append((number * SECONDS_PER_STEP, round(shown_n, 1), round(state.displacement_mm, 4), name))
        green = (gradient.T @ gradient - np.eye(2)) / 2
        truth.append(
            {
                "image": name,
                "load_n": round(state.load_n, 4),
                "exx": green[0, 0],
                "eyy": green[1, 1],
                "exy": green[0, 1],
            }
        )
    with (folder / "machine.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["time_s", "load_n", "crosshead_mm", "image"])
        writer.writerows(rows)
    settings = specimen.settings
    about = {
        "measure": "Green-Lagrange",
        "width_mm": WIDTH_MM,
        "thickness_mm": settings.thickness_mm,
        "youngs_modulus_mpa": settings.youngs_modulus_mpa,
        "poisson_ratio": settings.poisson_ratio,
        "images": truth,
    }
    # The test ends before the largest load, so these are the properties that it can give.
    exact = {name: exact_properties(settings)[name] for name in ("E_gpa", "nu", "Rp02_mpa")}
    (folder / "known.json").write_text(json.dumps(exact, indent=1) + "\n", encoding="utf-8")
    (folder / "truth.json").write_text(json.dumps(about, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
