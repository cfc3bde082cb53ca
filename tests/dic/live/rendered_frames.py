"""Frames of a speckled specimen, rendered by the simulators, with the set-up of their live measurement."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from dic.calibration.calibration import Calibration
from dic.calibration.pinhole.prior import KnownCamera
from dic.correlation.settings import CorrelationSettings
from dic.gauges import Extensometer, LineCut, PointGauge, StrainGauge
from dic.live import LiveSettings, LiveSetup
from dic.out_of_plane.motion import Motion
from dic.strain.measurement import measure
from dic.targets.points import GridPoints
from simulators.scene.optics import PinholeCamera
from simulators.scene.pose import Pose
from simulators.scene.render import render
from simulators.scene.scene import Surface
from simulators.scene.sensor import Sensor
from simulators.scene.texture import Speckle

SIDE_PX = 400
SENSOR = Sensor(bits=8, full_well_e=32_500.0, read_noise_e=20.0, saturation_exposure_us=12_000.0)
LINES, PITCH_MM, GRID_NOISE_PX = 15, 0.4, 0.004

IN_MM = (
    Extensometer(name="axial", unit="mm", start=(-0.7, -1.2), end=(-0.7, 1.2), patch=0.5),
    StrainGauge(name="area", unit="mm", centre=(0.5, 0.4), size=(0.8, 0.8), direction_deg=90.0),
    PointGauge(name="point", unit="mm", at=(0.8, -0.9), width=0.5, direction_deg=90.0),
    LineCut(name="cut", unit="mm", start=(-0.5, 0.0), end=(0.5, -0.2), places=5, width=0.5),
)


@dataclass
class RenderedCamera:
    """A camera that looks at a specimen; `number` gives each camera its own noise."""

    number: int = 0
    tilt_deg: float = 0.0
    seed: int = 5
    settings: CorrelationSettings = field(
        default_factory=lambda: CorrelationSettings(subset_px=31, step_px=10, shape="quadratic")
    )

    def __post_init__(self):
        self.optics = PinholeCamera(SIDE_PX, SIDE_PX, tilt_deg=self.tilt_deg)
        self._speckle = Speckle.sprayed(self.seed)
        self._rng = np.random.default_rng([self.seed, self.number])

    def frame(self, pose=None, F=None, shift_mm=(0.0, 0.0)):
        """Render a frame of the specimen."""
        surface = Surface(
            self._speckle, pose or Pose(), np.eye(2) if F is None else F, np.asarray(shift_mm, float)
        )
        return SENSOR.expose(render(self.optics, surface), 10_000.0, 1.0, self._rng)

    @cached_property
    def calibration(self):
        index = np.stack(np.meshgrid(*2 * [np.arange(LINES)]), axis=-1).reshape(-1, 2).astype(np.int64)
        xy_mm = (index - (LINES - 1) / 2) * PITCH_MM
        seen = self.optics.project(np.column_stack([xy_mm, np.zeros(len(xy_mm))]))
        seen = seen + self._rng.normal(0.0, GRID_NOISE_PX, seen.shape)
        grid = GridPoints.on_lattice(index, seen, (LINES, LINES), PITCH_MM)
        known = KnownCamera(principal_px=self.optics.principal_point_px)
        return Calibration.fit(grid, (SIDE_PX, SIDE_PX), known=known)

    def setup(self, gauges=IN_MM, *, calibrated=True, motion=None, region=None, **live):
        """Return the set-up of the live measurement; the reference is the specimen at rest."""
        if region is None:
            region = np.zeros((SIDE_PX, SIDE_PX), bool)
            region[25:-25, 25:-25] = True
        return LiveSetup(
            self.frame(),
            gauges,
            self.calibration if calibrated else None,
            self.settings,
            region=region,
            clip=False,
            motion=motion,
            live=LiveSettings(**live),
        )


def offline(setup, frame):
    """Return the measurement of a frame by the offline correlation of whole images."""
    return measure(setup.correlator.correlate(frame), setup.calibration, setup.strain)


def stretched(strain, poisson_ratio=0.3):
    """Return the deformation gradient of a tension along Y."""
    return np.diag([1.0 - poisson_ratio * strain, 1.0 + strain])


TENSION = Motion("tension", shift_std_um=20.0)
