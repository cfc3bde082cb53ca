"""The scene before the cameras: which surface, its pose and its deformation at a moment."""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import exp, radians, tan

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from drivers.errors import DeviceError
from drivers.interfaces import OpenContext
from drivers.settings import Settings
from simulators.scene.jit import compiled
from simulators.scene.pose import Pose
from simulators.scene.specimen import Specimen
from simulators.scene.texture import LineGrid, Speckle, Texture

Array = NDArray[np.float64]

# The grips have straightened a tilted specimen to 63 % at this load.
STRAIGHTENING_LOAD_N = 2000.0


class Misalignment(Settings):
    """Misalignment of the rig.

    Slopes a, b of a plane mean ``z = tan(a) X + tan(b) Y``; slopes of the axis mean that it runs along
    ``(tan(a), tan(b), 1)``, so a positive slope leans it to +X or +Y.
    Three causes, which add up: the stage's axis against the specimen's normal makes the specimen wobble as it
    turns; the grid against the specimen lets them lie in two planes all the time; loading tips and shifts the
    specimen as the grips straighten it, approaching the full amount as 1 - exp(-load / 2000 N).
    """

    axis_slope_x_deg: float = Field(
        default=0.0, ge=-5, le=5, description="of the stage's axis against the specimen's normal"
    )
    axis_slope_y_deg: float = Field(default=0.0, ge=-5, le=5)
    axis_x_mm: float = Field(default=0.0, ge=-5, le=5, description="where the axis meets the specimen")
    axis_y_mm: float = Field(default=0.0, ge=-5, le=5)
    grid_slope_x_deg: float = Field(
        default=0.0, ge=-5, le=5, description="slope of the specimen against the grid"
    )
    grid_slope_y_deg: float = Field(default=0.0, ge=-5, le=5)
    grid_gap_mm: float = Field(
        default=0.0, ge=-5, le=5, description="how far the specimen lies behind the grid"
    )
    loading_slope_x_deg: float = Field(
        default=0.0, ge=-5, le=5, description="slope of the specimen under full load"
    )
    loading_slope_y_deg: float = Field(default=0.0, ge=-5, le=5)
    loading_shift_mm: float = Field(
        default=0.0, ge=-5, le=5, description="motion towards the camera under full load"
    )

    def mounted(self) -> Pose:
        """Pose of the specimen at rest: its slopes and shift relative to the grid's plane z = 0."""
        return Pose.sloped(self.grid_slope_x_deg, self.grid_slope_y_deg, -self.grid_gap_mm)

    def loaded(self, load_n: float) -> Pose:
        """Out-of-plane motion caused by a load, in the specimen's coordinates."""
        part = 1.0 - exp(-max(0.0, load_n) / STRAIGHTENING_LOAD_N)
        return Pose.sloped(
            part * self.loading_slope_x_deg, part * self.loading_slope_y_deg, part * self.loading_shift_mm
        )

    def turned(self, angle_deg: float) -> Pose:
        """Rotation by the stage, in the specimen's coordinates."""
        axis = np.array([tan(radians(self.axis_slope_x_deg)), tan(radians(self.axis_slope_y_deg)), 1.0])
        return Pose.turned(axis, angle_deg, np.array([self.axis_x_mm, self.axis_y_mm, 0.0]))


@dataclass(frozen=True)
class Surface:
    """A plane surface somewhere in the world, stretched uniformly within itself.

    A material point X (mm) lies in the surface at ``deformation_gradient · X + shift_mm`` and in the world
    where `pose` brings that point of the plane z = 0.

    Attributes
    ----------
    texture : Texture
    pose : Pose
    deformation_gradient : ndarray, shape (2, 2)
    shift_mm : ndarray, shape (2,)
    """

    texture: Texture
    pose: Pose = field(default_factory=Pose)
    deformation_gradient: Array = field(default_factory=lambda: np.eye(2))
    shift_mm: Array = field(default_factory=lambda: np.zeros(2))

    def world(self, material_mm: Array) -> Array:
        """Return where material points (n, 2) are in the world, (n, 3) mm."""
        within = material_mm @ self.deformation_gradient.T + self.shift_mm
        return self.pose.apply(np.column_stack([within, np.zeros(len(within))]))

    def material(self, origin_mm: Array, directions: Array) -> Array:
        """Return the material points (n, 2) in mm met by rays from a point (3,) along directions (n, 3)."""
        to_surface = self.pose.inverse()
        unstretch = np.asarray(np.linalg.inv(self.deformation_gradient), dtype=np.float64)
        origin = to_surface.apply(origin_mm[None, :])[0]
        return _meet(origin, directions, to_surface.rotation, unstretch, self.shift_mm)


@compiled
def _meet(origin: Array, directions: Array, rotation: Array, unstretch: Array, shift_mm: Array) -> Array:
    """Intersect rays with the plane z = 0 of the surface, and return the material points there."""
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
    """The specimen on its stage or in its load frame, and the grid that can be attached to it.

    Parameters
    ----------
    seed : int
        Of the speckle pattern, and of the noise of the cameras that look at it.
    misalignment : Misalignment
    specimen : Specimen
    angle_deg : callable
        The stage's true angle now.
    load_n : callable
        The load frame's load now; the call also updates the specimen.
    """

    def __init__(
        self,
        *,
        seed: int,
        misalignment: Misalignment,
        specimen: Specimen,
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
        """Return the surface that the cameras see now; an attached grid moves with the specimen."""
        self._load_n()
        state = self.specimen.state
        motion = self.misalignment.loaded(state.load_n)
        motion = motion.after(self.misalignment.turned(self._angle_deg()))
        mounted = self.misalignment.mounted()
        pose = mounted.after(motion)
        if self.grid_attached:
            return Surface(self._grid, pose.after(mounted.inverse()))
        travel_mm = self.specimen.settings.centre_travel * state.displacement_mm
        return Surface(self._speckle, pose, state.deformation_gradient(), np.array([0.0, travel_mm]))


def scene_of(context: OpenContext) -> Scene:
    """Return the scene of the simulated rig that a device belongs to.

    Raises
    ------
    DeviceError
        If the rig is not simulated.
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
