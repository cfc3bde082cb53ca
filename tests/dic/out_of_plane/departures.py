"""Forty kinds of specimens that differ from a flat specimen with uniform strain, by exact geometry.

For each specimen, random values are drawn for all that one camera cannot determine: the principal point, the
direction of view, the noise, the strain, the tilt under load, the tilt and the distance relative to the grid
in the reference, and the shift towards the camera. Tilt, distance and shift have the distributions that the
corrections expect (`dic.out_of_plane.expectations`). The kinds and sizes of the departures do not have the
expected distributions.
"""

from dataclasses import dataclass

import numpy as np

from simulators.scene.optics import PinholeCamera
from simulators.scene.pose import Pose
from tests.dic.out_of_plane.exact_views import OffCentre, State, View

NU = 0.33
SHIFT_STD_UM = 1.0
HALF_MM = 4.2

SIZES = {
    "aligned": (0.0,),
    "tilt, °": (0.03, 0.1, 0.3),
    "bent out of plane, 1/m": (1 / 100, 1 / 30, 1 / 10),
    "saddle, 1/m": (1 / 100, 1 / 30, 1 / 10),
    "gradient of strain, %": (2.0, 5.0, 10.0),
    "gradient and taper, %": (2.0, 5.0, 10.0),
    "bent in the plane, 1/m": (0.01, 0.03, 0.1),
    "plastic strain, %": (3.0, 6.0, 10.0),
    "sliding, mm": (0.2, 0.4, 0.8),
    "turned in the grips, °": (0.3, 0.7, 1.5),
    "shift, µm": (5.0, 15.0, 50.0),
    "surface away from the grid, mm": (0.1, 0.3, 0.6),
    "bent out of plane with gradient, 1/m": (1 / 100, 1 / 30, 1 / 10),
    "plastic strain and sliding, %": (3.0, 6.0, 10.0),
}
KINDS = [(name, size) for name, sizes in SIZES.items() for size in sizes]


@dataclass(frozen=True)
class Departure:
    """A random specimen and its camera: the reference state, the loaded state, and the declared shift."""

    view: View
    reference: State
    state: State
    shift_std_um: float


def drawn(name, size, seed):
    """Return a random specimen of the kind `name`, whose departure has the given size."""
    rng = np.random.default_rng([seed, KINDS.index((name, size))])
    pan_deg, tilt_deg = 30 * _direction(rng)
    camera = OffCentre(PinholeCamera(800, 800, pan_deg=pan_deg, tilt_deg=tilt_deg), rng.normal(0.0, 8.0, 2))
    view = View(
        camera, noise_px=rng.choice([0.0015, 0.004]), half_mm=HALF_MM, seed=int(rng.integers(1 << 30))
    )
    strain = rng.uniform(0.0005, 0.0033)
    tilt_deg = rng.normal(0.0, 0.1) * _direction(rng)
    mounted_deg, gap_mm = rng.normal(0.0, 0.1, 2), rng.normal(0.0, 0.3)
    shift_um, declared_um = rng.normal(0.0, SHIFT_STD_UM), SHIFT_STD_UM
    within, curvatures, F = None, (0.0, 0.0, 0.0), np.diag([1 - NU * strain, 1 + strain])
    sign = rng.choice([-1, 1])
    if name == "aligned":
        tilt_deg, mounted_deg, gap_mm = np.zeros(2), np.zeros(2), 0.0
    if name == "tilt, °":
        tilt_deg = size * _direction(rng)
    if name.startswith("bent out"):
        curvatures = _cylinder(1e-3 * sign * size, _direction(rng))
    if name.startswith("saddle"):
        along, across = _cylinder(1e-3 * sign * size, (0, 1)), _cylinder(1e-3 * sign * size, (1, 0))
        curvatures = tuple(a - NU * b for a, b in zip(along, across, strict=True))
    if "gradient" in name:
        share = 0.01 * size if "%" in name else 0.05
        within, F = _graded(strain, sign * share / HALF_MM, taper="taper" in name), np.eye(2)
    if name.startswith("bent in"):
        within = _bent(1e-3 * size * _direction(rng))
    if name.startswith("plastic"):
        plastic = 0.01 * size
        F = np.diag([(1 + plastic) ** -0.5, 1 + plastic])
    if "sliding" in name:
        way_mm = (0.5 if "strain" in name else size) * _direction(rng)

        def within(p):
            return p + way_mm

    if name.startswith("turned"):
        c, s = np.cos(np.radians(sign * size)), np.sin(np.radians(sign * size))
        F = np.array([[c, -s], [s, c]]) @ F
    if name.startswith("shift"):
        shift_um, declared_um = rng.normal(0.0, size), size
    if name.startswith("surface"):
        gap_mm = sign * size
    reference = Pose.sloped(*mounted_deg, gap_mm)
    loaded = Pose.sloped(*(mounted_deg + tilt_deg), gap_mm + 1e-3 * shift_um)
    return Departure(view, State(reference), State(loaded, F, within, curvatures), declared_um)


def _direction(rng):
    angle = rng.uniform(0.0, 2 * np.pi)
    return np.array([np.cos(angle), np.sin(angle)])


def _cylinder(per_mm, along):
    x, y = along
    return per_mm * x * x, per_mm * x * y, per_mm * y * y


def _graded(strain, per_mm, *, taper):
    """Return a motion with an axial strain that changes by `per_mm` per mm; with `taper`, also with shear."""
    shear = -(2 + NU) / 2 if taper else 0.0

    def within(p):
        x, y = p.T
        along = strain * (y + per_mm * (y * y / 2 + shear * x * x))
        return np.column_stack([x - NU * strain * (x + per_mm * x * y), y + along])

    return within


def _bent(per_mm):
    first, second = per_mm

    def within(p):
        x, y = p.T
        moved = first * np.column_stack([-(y * y + NU * x * x) / 2, x * y])
        return p + moved + second * np.column_stack([x * y, -(x * x + NU * y * y) / 2])

    return within
