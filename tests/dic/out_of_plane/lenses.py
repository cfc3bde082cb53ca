"""Cameras with lenses that radial distortion of low order does not describe, without code of `dic`."""

from dataclasses import dataclass, replace

import numpy as np

from dic.calibration.calibration import Calibration
from dic.targets.points import GridPoints
from tests.dic.out_of_plane.exact_views import View

_LINES = 21
_PITCH_MM = 0.5
_PX_PER_MM = 70.0


@dataclass(frozen=True)
class LensCamera:
    """A camera that looks at the grid's middle, 70 px/mm there, from the angle `off_axis_deg`.

    The lens moves an image point by `radial_px` @ (ρ², ρ⁴, ρ⁶) along the radius, by decentring distortion of
    `decentring_px` at ρ = 1, by terms (along x, along y, power of x, power of y) of a polynomial `rest_px`,
    and by waves `waves_px` (along x, along y, turns along x, turns along y, phase). ρ is the distance from
    the principal point, divided by `half_px`.
    """

    focal_px: float
    off_axis_deg: float
    around_deg: float
    off_px: tuple[float, float] = (0.0, 0.0)
    radial_px: tuple[float, float, float] = (0.0, 0.0, 0.0)
    decentring_px: tuple[float, float] = (0.0, 0.0)
    rest_px: tuple[tuple[float, float, int, int], ...] = ()
    waves_px: tuple[tuple[float, ...], ...] = ()
    half_px: float = 500.0
    width_px: int = 800
    height_px: int = 800

    @property
    def distance_mm(self):
        return self.focal_px / _PX_PER_MM

    @property
    def principal_point_px(self):
        return (np.array([self.width_px, self.height_px]) - 1) / 2 + self.off_px

    @property
    def axes(self):
        off, around = np.radians([self.off_axis_deg, self.around_deg])
        back = np.array([np.sin(off) * np.cos(around), np.sin(off) * np.sin(around), np.cos(off)])
        right = np.cross([0.0, 1.0, 0.0], back)
        right /= np.linalg.norm(right)
        return np.array([right, np.cross(back, right), back])

    @property
    def centre_mm(self):
        return self.distance_mm * self.axes[2]

    def project(self, world_mm):
        x, y, depth = ((world_mm - self.centre_mm) @ self.axes.T * [1.0, -1.0, -1.0]).T
        return self._bent(self.focal_px * np.stack([x, y], axis=1) / depth[:, None]) + self.principal_point_px

    def ray(self, px):
        wanted = px - self.principal_point_px
        ideal = wanted.copy()
        for _ in range(60):
            ideal += wanted - self._bent(ideal)
        x, y = ideal.T / self.focal_px
        return self.centre_mm, np.column_stack([x, -y, -np.ones(len(x))]) @ self.axes

    def _bent(self, ideal):
        at = ideal / self.half_px
        x, y = at.T
        square = x * x + y * y
        outward = np.polyval([*self.radial_px[::-1], 0.0], square)
        p1, p2 = self.decentring_px
        moved = [
            x * outward + (2 * p1 * x * y + p2 * (square + 2 * x * x)) / 3,
            y * outward + (p1 * (square + 2 * y * y) + 2 * p2 * x * y) / 3,
        ]
        for right, down, i, j in self.rest_px:
            moved[0] += right * x**i * y**j
            moved[1] += down * x**i * y**j
        for right, down, i, j, phase in self.waves_px:
            wave = np.sin(2 * np.pi * (i * x + j * y) + phase)
            moved[0] += right * wave
            moved[1] += down * wave
        return ideal + np.stack(moved, axis=1)


@dataclass(frozen=True)
class LensView(View):
    """A view that is calibrated from the points of the grid inside the image."""

    def calibration(self, *, principal_known: bool = False) -> Calibration:
        rng = np.random.default_rng([self.seed, 1])
        index = np.stack(np.meshgrid(np.arange(_LINES), np.arange(_LINES)), axis=-1).reshape(-1, 2)
        xyz = np.column_stack([(index - (_LINES - 1) / 2) * _PITCH_MM, np.zeros(len(index))])
        px = self.camera.project(xyz) + rng.normal(0.0, self.grid_noise_px, (len(index), 2))
        seen = ((px > 5) & (px < np.array([self.camera.width_px, self.camera.height_px]) - 6)).all(axis=1)
        grid = GridPoints.on_lattice(index[seen].astype(np.int64), px[seen], (_LINES, _LINES), _PITCH_MM)
        return Calibration.fit(grid, (self.camera.height_px, self.camera.width_px))


def drawn_camera(rng, off_axis_deg, kind):
    """Return a camera with a lens of a kind: clean, moustache, tangential, both, rest, rough, short."""
    focal_px = 800 * (1.0 if kind == "short" else rng.uniform(1.0, 4.0))
    off_px = tuple(rng.normal(0, 8, 2))
    camera = LensCamera(focal_px, off_axis_deg, np.degrees(rng.uniform(0, 2 * np.pi)), off_px)
    if kind in ("moustache", "both", "rest", "rough", "short"):
        barrel = -rng.uniform(1, 6)
        last = rng.uniform(0, 0.6)
        fourth = -barrel * rng.uniform(0.8, 2.0)
        camera = replace(camera, radial_px=(barrel, fourth * (1 - last), fourth * last))
    if kind in ("tangential", "both", "short"):
        camera = replace(camera, decentring_px=tuple(rng.uniform(-2, 2, 2)))
    if kind == "rest":
        terms = [(d - k, k) for d in range(2, 7) for k in range(d + 1)]
        size = 10 ** rng.uniform(-2, -0.5)
        camera = replace(
            camera, rest_px=tuple((*rng.normal(0, size / np.sqrt(i + j + 1), 2), i, j) for i, j in terms)
        )
    if kind == "rough":
        size = 10 ** rng.uniform(-2, -0.5)
        waves = [(*rng.normal(0, size / 2, 2), *rng.normal(0, 1, 2), rng.uniform(0, 7)) for _ in range(4)]
        camera = replace(camera, waves_px=tuple(waves))
    return camera
