"""The scene that the cameras see: the surface, its pose and its deformation at the current time."""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import exp, radians, tan

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from drivers.errors import DeviceError
from drivers.interfaces import OpenContext
from drivers.settings import Settings
from simulators.scene.band import Band
from simulators.scene.jit import compiled
from simulators.scene.pose import Pose
from simulators.scene.specimen import SimulatedSpecimen
from simulators.scene.texture import LineGrid, Speckle, Texture

Array = NDArray[np.float64]

# At this load in N, the grips have removed 63 % of the tilt of a crooked specimen.
STRAIGHTENING_LOAD_N = 2000.0


class Misalignment(Settings):
    """Misalignment of the rig.

    A plane with the slopes a and b is the plane ``z = tan(a) X + tan(b) Y``. An axis with the slopes a and b
    has the direction ``(tan(a), tan(b), 1)``, so a positive slope leans the axis towards +X or +Y.

    The misalignment is the sum of three effects. With an axis slope, the stage's axis differs from the
    specimen's normal, and the specimen wobbles when the stage turns. With a grid slope, the grid and the
    specimen always lie in different planes. With a loading slope or shift, the specimen tips and shifts under
    load, because the grips straighten the specimen. At a given load, the specimen has moved by the fraction 1
    - exp(-load / 2000 N) of the full loading slope and shift.
    """

    axis_slope_x_deg: float = Field(
        default=0.0, ge=-5, le=5, description="slope of the stage's axis against the specimen's normal"
    )
    axis_slope_y_deg: float = Field(default=0.0, ge=-5, le=5)
    axis_x_mm: float = Field(default=0.0, ge=-5, le=5, description="point of the specimen on the axis")
    axis_y_mm: float = Field(default=0.0, ge=-5, le=5)
    grid_slope_x_deg: float = Field(
        default=0.0, ge=-5, le=5, description="slope of the specimen against the grid"
    )
    grid_slope_y_deg: float = Field(default=0.0, ge=-5, le=5)
    grid_gap_mm: float = Field(
        default=0.0, ge=-5, le=5, description="distance of the specimen behind the grid"
    )
    loading_slope_x_deg: float = Field(
        default=0.0, ge=-5, le=5, description="slope of the specimen under full load"
    )
    loading_slope_y_deg: float = Field(default=0.0, ge=-5, le=5)
    loading_shift_mm: float = Field(
        default=0.0, ge=-5, le=5, description="motion towards the camera under full load"
    )

    def mounted(self) -> Pose:
        """Return the pose of the specimen at rest: slopes and shift relative to the grid's plane z = 0."""
        return Pose.sloped(self.grid_slope_x_deg, self.grid_slope_y_deg, -self.grid_gap_mm)

    def loaded(self, load_n: float) -> Pose:
        """Return the out-of-plane motion that a load causes, in the specimen's coordinates."""
        part = 1.0 - exp(-max(0.0, load_n) / STRAIGHTENING_LOAD_N)
        return Pose.sloped(
            part * self.loading_slope_x_deg, part * self.loading_slope_y_deg, part * self.loading_shift_mm
        )

    def turned(self, angle_deg: float) -> Pose:
        """Return the rotation by the stage, in the specimen's coordinates."""
        axis = np.array([tan(radians(self.axis_slope_x_deg)), tan(radians(self.axis_slope_y_deg)), 1.0])
        return Pose.turned(axis, angle_deg, np.array([self.axis_x_mm, self.axis_y_mm, 0.0]))


@dataclass(frozen=True)
class Surface:
    """A plane surface in the world with an in-plane deformation, which is uniform without a band.

    A material point X in mm moves to ``deformation_gradient · X + shift_mm`` in the plane z = 0. `pose` then
    moves the plane z = 0 to its position in the world. With a band, the plastic strain of the band moves X
    first, and `deformation_gradient` is that of the sheet ahead of the front.

    Attributes
    ----------
    texture : Texture
    pose : Pose
    deformation_gradient : ndarray, shape (2, 2)
    shift_mm : ndarray, shape (2,)
    load_n, displacement_mm : float
        The true load and position of the crosshead at the time of the surface.
    band : Band or None
        A Lüders band in the sheet.
    """

    texture: Texture
    pose: Pose = field(default_factory=Pose)
    deformation_gradient: Array = field(default_factory=lambda: np.eye(2))
    shift_mm: Array = field(default_factory=lambda: np.zeros(2))
    load_n: float = 0.0
    displacement_mm: float = 0.0
    band: Band | None = None

    def world(self, material_mm: Array) -> Array:
        """Return the world positions (n, 3) in mm of material points (n, 2) in mm."""
        if self.band is not None:
            material_mm = self.band.stretched(material_mm)
        within = material_mm @ self.deformation_gradient.T + self.shift_mm
        return self.pose.apply(np.column_stack([within, np.zeros(len(within))]))

    def material(self, origin_mm: Array, directions: Array) -> Array:
        """Return the material points (n, 2) in mm at which rays meet the surface.

        The rays start at the point `origin_mm` (3,) and have the directions (n, 3).
        """
        to_surface = self.pose.inverse()
        unstretch = np.asarray(np.linalg.inv(self.deformation_gradient), dtype=np.float64)
        origin = to_surface.apply(origin_mm[None, :])[0]
        met = _meet(origin, directions, to_surface.rotation, unstretch, self.shift_mm)
        return met if self.band is None else self.band.material(met)


@compiled
def _meet(origin: Array, directions: Array, rotation: Array, unstretch: Array, shift_mm: Array) -> Array:
    """Intersect rays with the surface's plane z = 0, and return the material points at the intersections."""
    material = np.empty((len(directions), 2))
    for i in range(len(directions)):
        dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
        reach = -origin[2] / (rotation[2, 0] * dx + rotation[2, 1] * dy + rotation[2, 2] * dz)
        x = (
            origin[0]
            + reach * (rotation[0, 0] * dx + rotation[0, 1] * dy + rotation[0, 2] * dz)
            - shift_mm[0]
        )
        y = (
            origin[1]
            + reach * (rotation[1, 0] * dx + rotation[1, 1] * dy + rotation[1, 2] * dz)
            - shift_mm[1]
        )
        material[i, 0] = unstretch[0, 0] * x + unstretch[0, 1] * y
        material[i, 1] = unstretch[1, 0] * x + unstretch[1, 1] * y
    return material


class Scene:
    """The specimen on the stage or in the load frame, and the grid that can be attached to the specimen.

    Parameters
    ----------
    seed : int
        Seed of the speckle pattern and of the cameras' noise.
    misalignment : Misalignment
    specimen : SimulatedSpecimen
    angle_deg : callable
        Returns the true angle of the stage now.
    load_n : callable
        Returns the true load of the load frame now. Calling `load_n` also updates the state of the specimen.
    """

    def __init__(
        self,
        *,
        seed: int,
        misalignment: Misalignment,
        specimen: SimulatedSpecimen,
        angle_deg: Callable[[], float],
        load_n: Callable[[], float],
    ) -> None:
        self.seed = seed
        self.misalignment = misalignment
        self.specimen = specimen
        self.grid_attached = False
        self._angle_deg = angle_deg
        self._load_n = load_n
        self._speckle = Speckle.sprayed(seed)
        self._grid = LineGrid()

    def surface(self) -> Surface:
        """Return the surface that the cameras see now: the specimen, or the grid attached to the specimen."""
        return self.surface_with(grid=self.grid_attached)

    def surface_with(self, *, grid: bool) -> Surface:
        """Return the surface that the cameras would see now with or without the grid."""
        self._load_n()
        state = self.specimen.state
        motion = self.misalignment.loaded(state.load_n).after(self._recession())
        motion = motion.after(self.misalignment.turned(self._angle_deg()))
        mounted = self.misalignment.mounted()
        pose = mounted.after(motion)
        if grid:
            grid_pose = pose.after(mounted.inverse())
            return Surface(self._grid, grid_pose, load_n=state.load_n, displacement_mm=state.displacement_mm)
        band, travel_mm = state.band, self.specimen.settings.centre_travel * state.displacement_mm
        return Surface(
            self._speckle,
            pose,
            state.deformation_gradient() if band is None else band.elastic_gradient,
            np.array([0.0, travel_mm + (0.0 if band is None else band.shift_mm)]),
            state.load_n,
            state.displacement_mm,
            band,
        )

    def _recession(self) -> Pose:
        """Return the motion of the surface away from the camera when the sheet becomes thinner."""
        settings = self.specimen.settings
        change_mm = settings.thickness_mm * self.specimen.state.thickness_strain
        return Pose(translation_mm=np.array([0.0, 0.0, settings.resting_depth * change_mm]))


def scene_of(context: OpenContext) -> Scene:
    """Return the scene of the simulated rig that a device belongs to.

    Raise `DeviceError` if the rig is not simulated.
    """
    scene = getattr(context.environment, "scene", None)
    if not isinstance(scene, Scene):
        raise DeviceError(
            context.name,
            "open",
            "the scene of a virtual rig",
            "a rig without one",
            'add [simulation] with driver = "virtual-rig" to the rig file, or name a real driver',
        )
    return scene
