"""Rendered frames of two large cameras for the benchmark of live gauges, and the declared gauges."""

from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import CameraInfo, Frame
from rig.live.job import LiveJob
from rig.mounting import Mounting
from rig.protocol.grid import Grid
from rig.protocol.live_table import LiveTable
from simulators.scene.optics import PinholeCamera
from simulators.scene.pose import Pose
from simulators.scene.render import render
from simulators.scene.scene import Surface
from simulators.scene.sensor import Sensor
from simulators.scene.texture import LineGrid, Speckle

SCALE_PX_MM, DISTANCE_MM, STEP_PX = 70.0, 150.0, 10
STRAIN, FRAMES = 2e-4, 6
_SENSOR = Sensor(bits=8, full_well_e=32_500.0, read_noise_e=20.0, saturation_exposure_us=12_000.0)
_START = datetime(2026, 1, 1, tzinfo=UTC)
PAN_DEG = {"aside": 30.0, "straight": 0.0}


@dataclass(frozen=True)
class LiveScene:
    """What two cameras, one of them at 30°, see of a grid and of a specimen that is pulled.

    `side_px`: width and height of the images. `shape`: shape function of the subsets.
    """

    side_px: int
    shape: str

    @property
    def job(self) -> LiveJob:
        """Two gauges of 25 subsets of 31 px in the oblique camera; the other camera sees some more."""
        # Five points along each side. The oblique camera sees the width shortened.
        height = (5 * STEP_PX - 1.0) / SCALE_PX_MM
        width = height / np.cos(np.radians(PAN_DEG["aside"]))
        gauges = [
            f"{name}=area unit=mm centre=0.05,{y} size={width:.4f},{height:.4f} direction_deg=90"
            for name, y in (("upper", 3.0), ("lower", -3.0))
        ]
        table = LiveTable(gauges=gauges, subset_px=31, step_px=STEP_PX, shape=self.shape)
        return LiveJob(table, self._grid, Mounting(shift_std_um=20.0), 1.0)

    @property
    def infos(self) -> dict[str, CameraInfo]:
        """The cameras."""
        info = CameraInfo("v", "m", "s", width_px=self.side_px, height_px=self.side_px, bits=8)
        return dict.fromkeys(PAN_DEG, info)

    @cached_property
    def grids(self) -> dict[str, NDArray[np.uint8]]:
        """The image of the grid by each camera."""
        grid = self._grid
        return self._seen(Surface(LineGrid(grid.lines_x, grid.pitch_mm, plate_half_mm=100.0), Pose()), 0)

    @cached_property
    def references(self) -> dict[str, NDArray[np.uint8]]:
        """The image of the specimen at rest by each camera."""
        return self._pulled(0.0, 1)

    @cached_property
    def frames(self) -> list[dict[str, NDArray[np.uint8]]]:
        """Images of each camera while the specimen is pulled."""
        return [self._pulled(STRAIN * k, 2 + k) for k in range(FRAMES)]

    @property
    def _grid(self) -> Grid:
        pitch_mm = round(0.9 * self.side_px / SCALE_PX_MM / 20, 3)
        return Grid(lines_x=21, lines_y=21, pitch_mm=pitch_mm, grid_made="exact")

    def _pulled(self, strain: float, seed: int) -> dict[str, NDArray[np.uint8]]:
        return self._seen(Surface(Speckle.sprayed(3), Pose(), np.diag([1 - 0.3 * strain, 1 + strain])), seed)

    def _seen(self, surface: Surface, seed: int) -> dict[str, NDArray[np.uint8]]:
        found = {}
        for name, pan_deg in PAN_DEG.items():
            camera = PinholeCamera(
                self.side_px, self.side_px, SCALE_PX_MM * DISTANCE_MM, DISTANCE_MM, pan_deg=pan_deg
            )
            rng = np.random.default_rng([seed, int(pan_deg)])
            found[name] = _SENSOR.expose(render(camera, surface), 10_000.0, 1.0, rng)
        return found


def frame_of(image: NDArray[np.uint8], number: int, time_s: float) -> Frame:
    """Return a frame with this number, whose exposure had its middle at a time."""
    return Frame(image, time_s, time_s, _START, number, 0, 1000.0, 1.0, time_s, 1e-4)


def place_of(number: int) -> int:
    """Return the image of a frame: forwards and backwards, so that no frame repeats the one before."""
    turn = number % (2 * FRAMES - 2)
    return turn if turn < FRAMES else 2 * FRAMES - 2 - turn
