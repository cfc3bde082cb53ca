"""Two rendered cameras with the declaration of live gauges, images of grid and reference, and frames."""

from datetime import UTC, datetime
from functools import cached_property

from drivers.interfaces import CameraInfo, Frame
from rig.live.job import LiveJob
from rig.mounting import Mounting
from rig.protocol.grid import Grid
from rig.protocol.live_table import LiveTable
from simulators.scene.pose import Pose
from simulators.scene.render import render
from simulators.scene.scene import Surface
from simulators.scene.texture import LineGrid
from tests.dic.live.rendered_frames import SENSOR, SIDE_PX, RenderedCamera, stretched

PITCH_MM, LINES = 0.36, 15
INFO = CameraInfo("v", "m", "s", width_px=SIDE_PX, height_px=SIDE_PX, bits=8)
GAUGES = [
    "axial=extensometer unit=mm start=-0.6,-1.2 end=-0.6,1.2 patch=0.6",
    "area=area unit=mm centre=0.5,0.4 size=0.9,0.9 direction_deg=90",
]
UTC_NOW = datetime(2026, 1, 1, tzinfo=UTC)


def frame_of(image, sequence, time_s):
    """Return a frame whose exposure had its middle at a time."""
    return Frame(image, time_s, time_s, UTC_NOW, sequence, 0, 1000.0, 1.0, time_s, 1e-4)


class RenderedRig:
    """Cameras "aside", at 30°, and "straight", or some of them, and what they see of one specimen."""

    def __init__(self, *names, **table):
        tilts = {"aside": 30.0, "straight": -20.0}
        self.cameras = {name: RenderedCamera(k, tilts[name]) for k, name in enumerate(names or tilts)}
        values = {"gauges": GAUGES, "subset_px": 31, "field_every_s": 0.2} | table
        self.table = LiveTable.model_validate(values)
        mounting = Mounting(shift_std_um=20.0)
        grid = Grid(pitch_mm=PITCH_MM, lines_x=LINES, lines_y=LINES, grid_made="exact")
        self.job = LiveJob(self.table, grid, mounting, 1.0)
        self.infos = dict.fromkeys(self.cameras, INFO)

    @cached_property
    def grids(self):
        lines = LineGrid(lines=LINES, pitch_mm=PITCH_MM)
        return {
            name: SENSOR.expose(render(camera.optics, Surface(lines, Pose())), 10_000.0, 1.0, camera._rng)
            for name, camera in self.cameras.items()
        }

    @cached_property
    def references(self):
        return {name: camera.frame() for name, camera in self.cameras.items()}

    def images(self, strain=0.0, pose=None):
        """Return an image of each camera of a specimen that is stretched."""
        return {name: camera.frame(pose, stretched(strain)) for name, camera in self.cameras.items()}

    @cached_property
    def pulled(self):
        """Images of some strains in equal steps."""
        return [self.images(5e-4 * k) for k in range(6)]


def to_and_fro(count):
    """Return places in a list of `count` images, forwards and backwards without a repetition."""
    k = 0
    while True:
        turn = k % (2 * count - 2)
        yield turn if turn < count else 2 * count - 2 - turn
        k += 1
