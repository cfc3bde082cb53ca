"""Measurements of a moving specimen, computed by the simulators' exact geometry, with known noise.

No image is rendered. The ray of each reference point is followed to the material, and the moved material
point is projected back into the camera. So the true values are exact except for rounding, and many specimens
take only seconds.
"""

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from dic.calibration.calibration import Calibration
from dic.calibration.grid_making import EXACT, GridAccuracy
from dic.calibration.pinhole.prior import KnownCamera
from dic.correlation.field import Field
from dic.correlation.settings import CorrelationSettings
from dic.correlation.status import Status
from dic.strain.measurement import measure
from dic.targets.points import GridPoints
from simulators.scene.optics import PinholeCamera
from simulators.scene.pose import Pose
from simulators.scene.scene import Surface


class Blank:
    """A texture without a pattern, because no image is rendered."""

    quadrature_order = 1


@dataclass(frozen=True)
class State:
    """The pose of the specimen, and its deformation within its plane."""

    pose: Pose = field(default_factory=Pose)
    F: np.ndarray = field(default_factory=lambda: np.eye(2))
    within: object = None  # further motion within the plane: (n, 2) mm to (n, 2) mm
    curvatures: tuple = (0.0, 0.0, 0.0)  # of the surface: along X, mixed, along Y; 1/mm

    def world(self, material_mm):
        moved = material_mm if self.within is None else self.within(material_mm)
        x, y = (moved @ self.F.T).T
        along_x, mixed, along_y = self.curvatures
        z = along_x * x * x / 2 + mixed * x * y + along_y * y * y / 2
        return self.pose.apply(np.column_stack([x, y, z]))


class OffCentre:
    """A camera whose principal point is not in the middle of the image."""

    def __init__(self, camera, off_px):
        self._camera, self._off_px = camera, np.asarray(off_px, float)
        self.width_px, self.height_px = camera.width_px, camera.height_px
        self.centre_mm = camera.centre_mm
        self.principal_point_px = camera.principal_point_px + self._off_px

    def project(self, world_mm):
        return self._camera.project(world_mm) + self._off_px

    def ray(self, px):
        return self._camera.ray(px - self._off_px)


@dataclass(frozen=True)
class PrintedGrid:
    """A grid of 10 mm × 10 mm that is not quite as it should be."""

    scale_ratio: float
    skew_rad: float
    bow_mm: tuple[float, float, float]
    """Along X, twist, and along Y."""

    @classmethod
    def drawn(cls, rng) -> "PrintedGrid":
        ratio, skew, *bow_mm = rng.normal(0.0, [7e-4, 5e-4, 0.02, 0.02, 0.02]).tolist()
        return cls(ratio, skew, tuple(bow_mm))

    def places_mm(self, xy_mm):
        """The nominal points (n, 2) as they are in space, (n, 3)."""
        x, y = xy_mm.T
        across, up = x / 5.0, y / 5.0
        z = np.column_stack([across**2 - 1 / 3, across * up, up**2 - 1 / 3]) @ self.bow_mm
        sheared = x * (1 + self.scale_ratio / 2) + y * self.skew_rad / 2
        return np.column_stack([sheared, y * (1 - self.scale_ratio / 2) + x * self.skew_rad / 2, z])


@dataclass(frozen=True)
class View:
    """One camera, which is calibrated from one noisy image of the grid."""

    camera: PinholeCamera
    noise_px: float = 0.004
    grid_noise_px: float = 0.004
    subset_px: int = 31
    half_mm: float = 4.2
    seed: int = 0
    shape: str = "quadratic"  # whose subsets follow perspective, as exact geometry does
    grid: "PrintedGrid | None" = None

    @property
    def settings(self):
        # Subsets side by side: their errors are independent.
        return CorrelationSettings(subset_px=self.subset_px, step_px=self.subset_px, shape=self.shape)

    def calibration(self, *, principal_known: bool = False) -> Calibration:
        """Return the calibration from one image of the grid, if wanted with the true principal point."""
        return _calibrated(self, principal_known)

    def measurements(self, states, calibration, reference=None):
        """Return a measurement for each state; all measurements have the same noisy reference image."""
        rng = np.random.default_rng([self.seed, 2])
        reference = reference or State()
        step = self.subset_px
        x_px = np.arange(step, self.camera.width_px - step, step)
        y_px = np.arange(step, self.camera.height_px - step, step)
        shape = (len(y_px), len(x_px))
        px = np.stack(np.meshgrid(x_px, y_px), axis=-1).reshape(-1, 2).astype(float)
        # Each image has half of the variance. The reference's misplaces the material that is followed, for
        # all steps alike.
        seen = px + rng.normal(0.0, self.noise_px / np.sqrt(2), px.shape)
        plane = Surface(Blank(), reference.pose, reference.F)
        material = plane.material(*self.camera.ray(seen))
        for _ in range(3 if any(reference.curvatures) else 0):
            # The ray meets the curved surface where the point that it shows is.
            shown = self.camera.project(reference.world(material))
            material = (
                material + plane.material(*self.camera.ray(seen)) - plane.material(*self.camera.ray(shown))
            )
        active = (np.abs(calibration.map(px)).max(axis=1) < self.half_mm).reshape(shape)
        results = []
        for number, state in enumerate(states):
            own = rng.normal(0.0, self.noise_px / np.sqrt(2), px.shape)
            moved = self.camera.project(state.world(material)) - px + own
            warps = np.full((*shape, 6), 0.0)
            warps[..., 0], warps[..., 3] = (moved[:, k].reshape(shape) for k in (0, 1))
            result = Field(
                x_px=x_px,
                y_px=y_px,
                warps=np.where(active[..., None], warps, np.nan),
                std=np.full((*shape, 6), self.noise_px),
                zncc=np.ones(shape),
                iterations=np.ones(shape, np.int16),
                status=np.where(active, Status.CONVERGED, Status.NOT_REACHED).astype(np.int8),
                active=active,
                start="search",
                settings=self.settings,
            )
            results.append(measure(result, calibration, label=f"state {number}"))
        return results

    def seen_by(self, other, state, seed=0):
        """Return the displacement field from this camera's image of a specimen to another camera's image."""
        rng = np.random.default_rng([seed, 3])
        step = self.subset_px
        x_px = np.arange(step, self.camera.width_px - step, step)
        y_px = np.arange(step, self.camera.height_px - step, step)
        shape = (len(y_px), len(x_px))
        px = np.stack(np.meshgrid(x_px, y_px), axis=-1).reshape(-1, 2).astype(float)
        material = Surface(Blank(), state.pose, state.F).material(*self.camera.ray(px))
        seen = other.camera.project(state.world(material)) + rng.normal(0.0, self.noise_px, px.shape)
        warps = np.zeros((*shape, 6))
        warps[..., 0], warps[..., 3] = ((seen - px)[:, k].reshape(shape) for k in (0, 1))
        return Field(
            x_px=x_px,
            y_px=y_px,
            warps=warps,
            std=np.full((*shape, 6), self.noise_px),
            zncc=np.ones(shape),
            iterations=np.ones(shape, np.int16),
            status=np.full(shape, Status.CONVERGED, np.int8),
            active=np.ones(shape, bool),
            start="search",
            settings=self.settings,
        )

    def true_strain(self, measurement, state, use=None, reference=None):
        """Return the true exx, eyy, exy, µε, from the affine motion that best fits the points in use."""
        reference = reference or State()
        use = measurement.calibrated.valid if use is None else use
        px = np.stack(np.meshgrid(measurement.field.x_px, measurement.field.y_px), axis=-1)[use]
        surface = Surface(Blank(), reference.pose, reference.F)
        material = surface.material(*self.camera.ray(px.astype(float)))
        within = (material if state.within is None else state.within(material)) @ state.F.T
        centred = np.column_stack([material, np.ones(len(material))])
        return green_lagrange(np.linalg.lstsq(centred, within, rcond=None)[0][:2].T)


@lru_cache(maxsize=16)
def _calibrated(view: View, principal_known: bool) -> Calibration:
    rng = np.random.default_rng([view.seed, 1])
    index = np.stack(np.meshgrid(np.arange(21), np.arange(21)), axis=-1).reshape(-1, 2)
    xy = (index - 10) * 0.5
    xyz = np.column_stack([xy, np.zeros(len(index))]) if view.grid is None else view.grid.places_mm(xy)
    seen = view.camera.project(xyz) + rng.normal(0.0, view.grid_noise_px, (len(index), 2))
    grid = GridPoints.on_lattice(index.astype(np.int64), seen, (21, 21), 0.5)
    known = KnownCamera(principal_px=view.camera.principal_point_px) if principal_known else None
    shape = view.camera.height_px, view.camera.width_px
    return Calibration.fit(grid, shape, known=known, accuracy=EXACT if view.grid is None else GridAccuracy())


def strains(correction):
    """Return exx, eyy, exy of a correction in µε."""
    mean = correction.mean
    return 1e6 * np.array([mean.exx, mean.eyy, mean.exy])


def deviations(correction):
    mean = correction.mean
    return 1e6 * np.array([mean.exx_std, mean.eyy_std, mean.exy_std])


def green_lagrange(F):
    E = (F.T @ F - np.eye(2)) / 2
    return 1e6 * np.array([E[0, 0], E[1, 1], E[0, 1]])
