"""The whole rig without hardware: stage and frame as servers on the wire, and the specimen they move."""

from collections.abc import Mapping

import numpy as np
from pydantic import Field

from drivers.clock import VirtualClock
from drivers.interfaces import OpenContext
from drivers.registry import DriverSpec
from drivers.settings import Settings
from simulators.frame_device import FrameDevice
from simulators.frame_wire import FrameServer
from simulators.scene import Misalignment, Scene
from simulators.specimen import Specimen, SpecimenSettings
from simulators.stage_device import StageDevice
from simulators.stage_wire import StageServer


class VirtualRigSettings(Settings):
    """The table [simulation] of a rig file."""

    seed: int = Field(
        default=1, ge=0, description="of speckle and noise; the same seed repeats a run bit by bit"
    )
    misalignment: Misalignment = Misalignment()
    specimen: SpecimenSettings = SpecimenSettings()


class VirtualRig:
    """One specimen, fixed to a rotation stage and gripped by a load frame; a rig uses what it names.

    Attributes
    ----------
    clock : VirtualClock
        The time of everything in it, the rig's engine included.
    addresses : mapping of str to str
        ``stage``: path of a pty that speaks Zaber ASCII; ``load_frame``: host:port that speaks Modbus TCP.
    scene : Scene
        What its cameras see.
    """

    def __init__(self, settings: VirtualRigSettings) -> None:
        self.clock = VirtualClock()
        specimen = Specimen(settings.specimen)
        stage = StageDevice(self.clock)
        frame = FrameDevice(self.clock, specimen, rng=np.random.default_rng(settings.seed))
        self.scene = Scene(
            seed=settings.seed,
            misalignment=settings.misalignment,
            specimen=specimen,
            angle_deg=stage.angle_deg,
            load_n=frame.load_n,
        )
        self._stage_server = StageServer(stage)
        self._frame_server = FrameServer(frame)
        self.addresses: Mapping[str, str] = {
            "stage": self._stage_server.address,
            "load_frame": self._frame_server.address,
        }

    def close(self) -> None:
        """Stop both servers; harmless when repeated."""
        self._stage_server.close()
        self._frame_server.close()


def _open(settings: VirtualRigSettings, context: OpenContext) -> VirtualRig:
    return VirtualRig(settings)


SPEC = DriverSpec("environment", VirtualRigSettings, _open)
