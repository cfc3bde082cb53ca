"""Grid points in images of simulated cameras, computed by exact geometry."""

import numpy as np

from dic.calibration.pinhole.camera import Pinhole
from dic.targets.points import GridPoints
from simulators.scene.optics import PinholeCamera

CAMERA = Pinhole.swung(pan_deg=30, principal_px=(450, 450))


def exact_grid(lines: tuple[int, int] = (21, 21), missing: tuple[tuple[int, int], ...] = ()) -> GridPoints:
    index = np.array([(i, j) for j in range(lines[1]) for i in range(lines[0]) if (i, j) not in missing])
    lattice = GridPoints.on_lattice(index, np.empty((len(index), 2)), lines, 0.5)
    return GridPoints.on_lattice(index, CAMERA.project(lattice.xy_mm), lines, 0.5, ("look out",))


def bent_grid(noise_px: float = 0.0) -> GridPoints:
    """Return grid points of a camera whose lens distortion is too strong for the bicubic map."""
    camera = PinholeCamera(900, 900, pan_deg=25, tilt_deg=25, k1_per_px2=1e-7)
    xy = exact_grid().xy_mm
    uv = camera.project(np.column_stack([xy, np.zeros(len(xy))]))
    uv += np.random.default_rng(0).normal(0, 1, uv.shape) * noise_px
    return GridPoints.on_lattice(exact_grid().index, uv, (21, 21), 0.5)
