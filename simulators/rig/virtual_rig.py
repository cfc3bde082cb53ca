"""The virtual rig: stage and load frame as servers, and the specimen that they move."""

from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field

from drivers.clock import Clock, SystemClock, VirtualClock
from drivers.interfaces import OpenContext
from drivers.registry import DriverSpec
from drivers.settings import Settings
from simulators.load_frame.device import LoadFrameDevice
from simulators.load_frame.faults import load_frame_faults
from simulators.load_frame.layout import LAYOUTS
from simulators.load_frame.modbus import LoadFrameRtuServer, LoadFrameServer
from simulators.rig.places import Link, Places
from simulators.scene.scene import Misalignment, Scene
from simulators.scene.specimen import Specimen, SpecimenSettings
from simulators.stage.device import StageDevice
from simulators.stage.faults import stage_faults
from simulators.stage.newport import NewportServer
from simulators.stage.zaber import ZaberServer
from simulators.wire.faults import CAMERA, LOAD_FRAME, NEWPORT, STAGE, FaultPanel
from simulators.wire.ports import LOCALHOST
from simulators.wire.rig_faults import RigFaults


class VirtualRigSettings(Settings):
    """The table [simulation] of a rig file."""

    seed: int = Field(
        default=1, ge=0, description="of speckle and noise; the same seed repeats a run bit by bit"
    )
    real_time: bool = Field(
        default=False, description="run on the machine's own time, instead of as fast as it can"
    )
    load_frame_map: Literal["generic", "scaled-integers", "separate-words"] = "generic"
    misalignment: Misalignment = Misalignment()
    specimen: SpecimenSettings = SpecimenSettings()


class VirtualRig:
    """One specimen on a rotation stage and in a load frame; a rig file uses either or both.

    Parameters
    ----------
    settings : VirtualRigSettings, optional
    clock : Clock, optional
        A clock to use instead of the one that the settings ask for.
    places : Places, optional
        Addresses of the rig's servers. Default: any free addresses.

    Raises
    ------
    OSError
        If an address is taken.

    Attributes
    ----------
    clock : Clock
        The clock of the simulated devices; a rig that opens them uses the same clock.
    addresses : mapping of str to str
        ``stage``, ``stage_tcp``: Zaber ASCII on a pty and on TCP; ``newport``: a Newport ESP301 on a pty that
        turns the same shaft; ``load_frame``, ``load_frame_rtu``, ``load_frame_rtu_tcp``: one load frame on
        Modbus TCP, on Modbus RTU on a pty, and on RTU over TCP. Written as the drivers' settings expect them.
    faults : RigFaults
        Faults that can be switched on while the rig runs.
    scene : Scene
        The scene that the cameras see.
    stage : StageDevice
    load_frame : LoadFrameDevice
    """

    def __init__(
        self,
        settings: VirtualRigSettings | None = None,
        clock: Clock | None = None,
        places: Places | None = None,
    ) -> None:
        settings = settings or VirtualRigSettings()
        self.clock: Clock = clock or (SystemClock() if settings.real_time else VirtualClock())
        specimen = Specimen(settings.specimen)
        self.stage = StageDevice(self.clock)
        self.load_frame = LoadFrameDevice(self.clock, specimen, rng=np.random.default_rng(settings.seed))
        self.scene = Scene(
            seed=settings.seed,
            misalignment=settings.misalignment,
            specimen=specimen,
            angle_deg=self.stage.angle_deg,
            load_n=self.load_frame.load_n,
        )
        self.faults = RigFaults(
            stage_faults(FaultPanel(STAGE), self.stage),
            stage_faults(FaultPanel(NEWPORT), self.stage),
            load_frame_faults(FaultPanel(LOAD_FRAME), self.load_frame),
            FaultPanel(CAMERA),
        )
        with ExitStack() as started:
            self.addresses: Mapping[str, str] = self._start(settings, places or Places(), started)
            self._started = started.pop_all()

    def _start(self, settings: VirtualRigSettings, places: Places, started: ExitStack) -> dict[str, str]:
        """Start every server, register its `close` with `started`, and return the addresses."""
        addresses: dict[str, str] = {}

        def serve(name: str, server: Any, prefix: str = "") -> None:
            started.callback(server.close)
            addresses[name] = prefix + server.address
            if name in places.links:
                started.callback(Link(places.links[name], Path(server.address)).close)
                addresses[name] = str(places.links[name])

        def port(name: str) -> int:
            return places.ports.get(name, 0)

        stage, of_stage = self.stage, self.faults[STAGE]
        serve("stage", ZaberServer(stage, faults=of_stage))
        serve(
            "stage_tcp",
            ZaberServer(stage, host=LOCALHOST, port=port("stage_tcp"), faults=of_stage),
            "socket://",
        )
        serve("newport", NewportServer(stage, self.clock, faults=self.faults[NEWPORT]))

        frame, of_frame = self.load_frame, self.faults[LOAD_FRAME]
        layout = LAYOUTS[settings.load_frame_map]
        tcp = LoadFrameServer(frame, port=port("load_frame"), layout=layout, faults=of_frame)
        serve("load_frame", tcp)
        serve("load_frame_rtu", LoadFrameRtuServer(frame, faults=of_frame, registers=tcp.registers))
        rtu_port = port("load_frame_rtu_tcp")
        rtu_tcp = LoadFrameRtuServer(frame, LOCALHOST, rtu_port, faults=of_frame, registers=tcp.registers)
        serve("load_frame_rtu_tcp", rtu_tcp, "rtu://")
        return addresses

    def truth(self) -> dict[str, float | bool]:
        """Return the current true state: shaft angle, crosshead, load and the specimen's strains."""
        load_n = self.load_frame.load_n()
        state = self.scene.specimen.state
        return {
            "time_s": self.clock.now_s(),
            "angle_deg": self.stage.angle_deg(),
            "displacement_mm": self.load_frame.displacement_mm(),
            "load_n": load_n,
            "axial_strain": state.axial_strain,
            "transverse_strain": state.transverse_strain,
            "broken": state.broken,
            "grid_attached": self.scene.grid_attached,
        }

    def close(self) -> None:
        """Stop every server; harmless when repeated."""
        self._started.close()


def _open(settings: VirtualRigSettings, context: OpenContext) -> VirtualRig:
    return VirtualRig(settings)


SPEC = DriverSpec("environment", VirtualRigSettings, _open)
