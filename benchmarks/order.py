"""Compare two orders for a rotated specimen seen off-axis: correlate and map the points, or rectify first.

    python -m benchmarks.order [--seeds N] [--json FILE]

With the first order, the images are correlated as they are, and the points are mapped to the grid's plane by
the bicubic map or by the pinhole model. With the second order, both images are first resampled to the grid's
plane by a quintic spline, and then correlated. Both orders are measured with affine and quadratic shape
functions, three subset widths and four directions of view. The specimen lies in the grid's plane and turns
about the plane's normal without deformation, so every measured strain is an error. The images are rendered
with 800 × 800 px, 70 px/mm and one grey level of noise. The camera is calibrated from an image of the grid
that is rendered in the same way.
"""

import argparse
import json
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path

import cv2
import numpy as np
from scipy.ndimage import map_coordinates

from dic.calibration.calibration import Calibration, Model
from dic.correlation.correlator import Correlator
from dic.correlation.field import Field
from dic.correlation.settings import SHAPES, CorrelationSettings
from dic.strain.displacement import Displacement, calibrated_displacement, raw_displacement
from dic.strain.settings import StrainSettings
from dic.strain.strain import mean_strain, strain_field
from dic.targets.line_grid.find import find_grid
from dic.typing import Float, Grey
from simulators.scene.optics import PinholeCamera
from simulators.scene.pose import Pose
from simulators.scene.render import render
from simulators.scene.scene import Surface
from simulators.scene.sensor import Sensor
from simulators.scene.texture import LineGrid, Speckle

OFF_AXIS_DEG = (30.0, 20.0, 10.0, 0.0)
TURNS_DEG = (45.0, 90.0, 180.0, 360.0)
SUBSETS_PX = (21, 31, 61)
WAYS = ("map, bicubic", "map, pinhole", "rectify, bicubic", "rectify, pinhole")
_SIDE_PX, _PX_PER_MM = 800, 70.0
_RECTIFIED_PX = 661
_RADIUS_MM = 3.6
_SENSOR = Sensor(bits=8, full_well_e=32_500.0, read_noise_e=20.0, saturation_exposure_us=12_000.0)


@dataclass(frozen=True)
class Errors:
    """Errors over all rotation angles and specimens: strain in µε, displacement in px of 1/70 mm.

    Attributes
    ----------
    mean : float
        Largest absolute error of a component of the mean strain.
    mean_bias : float
        The same largest error after averaging over the specimens, which have different noise and patterns.
    local : float
        Mean standard deviation of the components of local strain, for windows of 5 × 5 points.
    displacement_px : float
        Mean standard deviation of the displacement errors along one axis.
    displacement_bias_px : float
        Largest absolute mean, over all points of an image, of the displacement errors along one axis.
    """

    mean: float
    mean_bias: float
    local: float
    displacement_px: float
    displacement_bias_px: float


class Specimen:
    """Images of one specimen at several rotation angles from one camera, and the calibration of this camera.

    Parameters
    ----------
    seed : int
    off_axis_deg : float
    """

    def __init__(self, seed: int, off_axis_deg: float) -> None:
        self._camera = PinholeCamera(_SIDE_PX, _SIDE_PX, pan_deg=off_axis_deg)
        self._rng = np.random.default_rng([seed, int(off_axis_deg)])
        self._rectified: dict[Model, list[Grey]] = {}
        self.calibration = Calibration.fit(
            find_grid(self._picture(Surface(LineGrid()))), (_SIDE_PX, _SIDE_PX)
        )
        speckle, normal = Speckle.sprayed(seed), np.array([0.0, 0.0, 1.0])
        self.reference = self._picture(Surface(speckle))
        self.turned = [
            self._picture(Surface(speckle, Pose.turned(normal, turn_deg, np.zeros(3))))
            for turn_deg in TURNS_DEG
        ]

    def _picture(self, surface: Surface) -> Grey:
        light = render(self._camera, surface)
        return _SENSOR.expose(light, 10_000.0, 1.0, self._rng).astype(np.float32)

    def rectified(self, model: Model) -> list[Grey]:
        """Return the reference and all rotated images, resampled to the grid's plane by a model."""
        if model not in self._rectified:
            calibration = self.calibration.using(model)
            self._rectified[model] = [rectified(p, calibration) for p in (self.reference, *self.turned)]
        return self._rectified[model]

    def homography(self) -> Float:
        """Return the approximate homography (3, 3) from image px to grid mm, for hints of the correlation."""
        grid = self.calibration.grid
        return np.asarray(cv2.findHomography(grid.uv_px, grid.xy_mm)[0], np.float64)


def rectified_homography() -> Float:
    """Return the homography (3, 3) from px of a rectified image to mm on the grid's plane."""
    middle, scale = (_RECTIFIED_PX - 1) / 2, 1.0 / _PX_PER_MM
    return np.array([[scale, 0.0, -middle * scale], [0.0, -scale, middle * scale], [0.0, 0.0, 1.0]])


def rectified(picture: Grey, calibration: Calibration) -> Grey:
    """Resample an image to the grid's plane by a quintic spline: 70 px/mm, X to the right and Y up."""
    px = np.stack(np.meshgrid(*[np.arange(_RECTIFIED_PX)] * 2), axis=-1).reshape(-1, 2)
    to_mm = rectified_homography()
    points_mm = px @ to_mm[:2, :2].T + to_mm[:2, 2]
    if calibration.pinhole is None:
        raise ValueError("this grid gives no pinhole")
    seen = calibration.pinhole.project(points_mm)
    for _ in range(3):
        wrong = points_mm - calibration.map(seen)
        seen = seen + np.linalg.solve(calibration.jacobian(seen), wrong[:, :, None])[:, :, 0]
    grey = map_coordinates(picture.astype(np.float64), seen.T[::-1], order=5, mode="nearest")
    return np.asarray(grey.reshape(_RECTIFIED_PX, _RECTIFIED_PX), np.float32)


def correlated(
    reference: Grey, turned: list[Grey], to_mm: Float, settings: CorrelationSettings
) -> list[Field]:
    """Correlate all rotated images, with the known rotation as hint, in the circle that stays in view."""
    height, width = reference.shape
    y, x = np.mgrid[:height, :width]
    flat = np.column_stack([x.ravel(), y.ravel(), np.ones(x.size)]) @ to_mm.T
    region = np.hypot(*(flat[:, :2] / flat[:, 2:]).T).reshape(height, width) < _RADIUS_MM
    correlator = Correlator(reference, region, settings, clip=False)
    fields = []
    for picture, turn_deg in zip(turned, TURNS_DEG, strict=True):
        c, s = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        hint = np.linalg.inv(to_mm) @ turn @ to_mm
        fields.append(correlator.correlate(picture, hint=hint / hint[2, 2]))
    return fields


def displacements(specimen: Specimen, settings: CorrelationSettings) -> dict[str, list[Displacement]]:
    """Return the displacements of all rotated images in mm, for each of `WAYS`."""
    models: tuple[Model, ...] = ("bicubic", "pinhole")
    fields = correlated(specimen.reference, specimen.turned, specimen.homography(), settings)
    found = {}
    for model in models:
        calibration = specimen.calibration.using(model)
        found[f"map, {model}"] = [calibrated_displacement(f, calibration) for f in fields]
        reference, *turned = specimen.rectified(model)
        flat = correlated(reference, turned, rectified_homography(), settings)
        found[f"rectify, {model}"] = [_in_mm(raw_displacement(f)) for f in flat]
    return found


def _in_mm(raw: Displacement) -> Displacement:
    middle = np.array([1.0, -1.0]) * (_RECTIFIED_PX - 1) / 2
    return Displacement((raw.position - middle) / _PX_PER_MM, raw.vector / _PX_PER_MM, raw.valid, "mm")


def errors(found: list[list[Displacement]]) -> Errors:
    """Return the errors of displacements; `found` has a list of rotated images for each specimen."""
    means = 1e6 * np.array([[_mean(d) for d in turns] for turns in found])
    locals_, moves = [], []
    for turns in found:
        for displacement, turn_deg in zip(turns, TURNS_DEG, strict=True):
            strain = strain_field(displacement, StrainSettings(window_points=5))
            locals_ += [np.nanstd(part) for part in (strain.exx, strain.eyy, strain.exy)]
            c, s = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
            true = displacement.position @ np.array([[c, s], [-s, c]]) - displacement.position
            moves.append(_PX_PER_MM * (displacement.vector - true)[displacement.valid])
    return Errors(
        mean=float(np.abs(means).max()),
        mean_bias=float(np.abs(means.mean(axis=0)).max()),
        local=float(1e6 * np.mean(locals_)),
        displacement_px=float(np.mean([m.std(axis=0) for m in moves])),
        displacement_bias_px=float(max(np.abs(m.mean(axis=0)).max() for m in moves)),
    )


def _mean(displacement: Displacement) -> list[float]:
    mean = mean_strain(displacement)
    return [mean.exx, mean.eyy, mean.exy]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=2, help="specimens")
    parser.add_argument("--json", type=Path, help="write the figures there as well")
    arguments = parser.parse_args()
    print("µε: largest error of a mean strain / the same, averaged over specimens / scatter of local strain;")
    print("mpx: scatter / bias of displacements")
    print(f"{'view':>5} {'subset':>6} {'shape':9} " + "".join(f"{way:>37}" for way in WAYS))
    rows = []
    for off_axis_deg in OFF_AXIS_DEG:
        specimens = [Specimen(seed, off_axis_deg) for seed in range(arguments.seeds)]
        for subset_px, shape in product(SUBSETS_PX, SHAPES):
            settings = CorrelationSettings(subset_px=subset_px, step_px=20, shape=shape)
            found = [displacements(specimen, settings) for specimen in specimens]
            cells = ""
            for way in WAYS:
                e = errors([by_way[way] for by_way in found])
                rows.append({"view_deg": off_axis_deg, "subset_px": subset_px, "shape": shape, "way": way})
                rows[-1] |= asdict(e)
                cell = f"{e.mean:.1f} /{e.mean_bias:5.1f} /{e.local:5.0f} µε,"
                cells += f"{cell} {1e3 * e.displacement_px:4.1f} /{1e3 * e.displacement_bias_px:5.2f}".rjust(
                    34
                )
            print(f"{off_axis_deg:4.0f}° {subset_px:6d} {shape:9} {cells}", flush=True)
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(rows, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
