"""The virtual rig: servers for a stage and a load frame, and the specimen that the devices move."""

import sys
from collections.abc import Callable, Mapping
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field

from drivers.clock import Clock, SystemClock, VirtualClock
from drivers.interfaces import OpenContext
from drivers.registry import DriverSpec
from drivers.settings import Settings
from simulators.closed_machine.box import AnalogueBox
from simulators.closed_machine.machine import ClosedMachine
from simulators.closed_machine.modbus import AnalogueBoxServer, box_faults
from simulators.closed_machine.settings import ClosedMachineSettings
from simulators.interlock.module import InputModule, InputModuleServer
from simulators.load_frame.device import LoadFrameDevice
from simulators.load_frame.drive import DriveSettings
from simulators.load_frame.faults import load_frame_faults
from simulators.load_frame.layout import LAYOUTS
from simulators.load_frame.load_cell import LoadCellSettings
from simulators.load_frame.modbus import LoadFrameRtuServer, LoadFrameServer
from simulators.rig.picture_faults import PictureFaults
from simulators.rig.places import Link, ServerAddresses
from simulators.rig.planned_faults import FaultPlan, PlannedFaults
from simulators.rig.surroundings import PreparedSettings, Surroundings
from simulators.scene.exact_properties import exact_properties
from simulators.scene.scene import Misalignment, Scene
from simulators.scene.specimen import SimulatedSpecimen, SpecimenSettings, SpecimenState
from simulators.stage.device import StageDevice
from simulators.stage.faults import stage_faults
from simulators.stage.newport import NewportServer
from simulators.stage.zaber import ZaberServer
from simulators.wire.faults import (
    CAMERA,
    CLOSED_MACHINE,
    INTERLOCK,
    LOAD_FRAME,
    NEWPORT,
    STAGE,
    FaultPanel,
)
from simulators.wire.ports import LOCALHOST
from simulators.wire.rig_faults import RigFaults


class VirtualRigSettings(Settings):
    """Settings of the table [simulation] in a rig file."""

    seed: int = Field(
        default=1, ge=0, description="seed of speckle and noise; the same seed gives identical images"
    )
    real_time: bool = Field(default=False, description="run in real time instead of simulated time")
    load_frame_map: Literal["generic", "scaled-integers", "separate-words"] = "generic"
    patience_s: float = Field(
        default=10.0,
        ge=0,
        le=25,
        description="real time for which a driver waits longer for an answer, as other programs may keep "
        "this computer busy while simulated time stands still; 0 for tests of missing answers",
    )
    prepared: PreparedSettings | None = Field(
        default=None, description="draw frames fast, from pictures that are prepared beforehand"
    )
    faults: list[FaultPlan] = Field(
        default=[], description="tables [[simulation.faults]]: faults that begin at a time or in a state"
    )
    misalignment: Misalignment = Misalignment()
    load_cell: LoadCellSettings = LoadCellSettings()
    drive: DriveSettings = DriveSettings()
    specimen: SpecimenSettings = SpecimenSettings()
    closed_machine: ClosedMachineSettings | None = Field(
        default=None, description="a machine that takes no command pulls the specimen, not the load frame"
    )

    def exact_properties(self) -> dict[str, Any]:
        """Return the exact material properties of the specimen, for comparison with measured values."""
        return exact_properties(self.specimen)


class VirtualRig:
    """A simulated rotation stage and load frame with one specimen. A rig file may use one device or both.

    With a closed machine, this machine pulls the specimen that the cameras see, and no program can reach the
    load frame.

    Parameters
    ----------
    settings : VirtualRigSettings, optional
    clock : Clock, optional
        A clock that replaces the clock from the settings.
    places : ServerAddresses, optional
        Addresses of the rig's servers. Default: any free addresses.
    say : callable, optional
        Called with lines about the preparation of pictures. Default: a line on standard error.

    Raises
    ------
    OSError
        If an address is in use.

    Attributes
    ----------
    clock : Clock
        The clock of the simulated devices. A run on this rig uses the same clock.
    addresses : mapping of str to str
        The addresses of the servers, in the form of the drivers' settings. ``stage`` and ``stage_tcp`` are
        Zaber ASCII on a pseudo-terminal and on TCP. ``newport`` is a Newport ESP301 on a pseudo-terminal that
        turns the same shaft. ``load_frame``, ``load_frame_rtu`` and ``load_frame_rtu_tcp`` are one load frame
        on Modbus TCP, on Modbus RTU on a pseudo-terminal, and on Modbus RTU over TCP. ``interlocks`` is a
        module with contacts and analogue inputs on Modbus TCP. ``closed_machine`` is the box at the outputs
        of a closed machine on Modbus TCP.
    patience_s : float
        Additional real time in s that a driver waits for each call, and for each answer while a device is
        opened. The value is 0 if the rig runs in real time, because a late answer is then a fault.
    exact_properties : dict
        The exact material properties of the specimen, for comparison with measured values.
    faults : RigFaults
        Faults that can be switched on while the rig runs.
    picture_faults : PictureFaults
        The effects of the faults ``picture.…`` on all cameras.
    plan : PlannedFaults
        Faults that begin at a time or in a state.
    around_cameras : Surroundings
        The faults of the cameras, and how they draw their pictures.
    scene : Scene
        The scene that the cameras see.
    stage : StageDevice
    load_frame : LoadFrameDevice
    interlocks : InputModule
    closed_machine : ClosedMachine or None
    box : AnalogueBox or None
        The box at the outputs of the closed machine.
    """

    def __init__(
        self,
        settings: VirtualRigSettings | None = None,
        clock: Clock | None = None,
        places: ServerAddresses | None = None,
        say: Callable[[str], None] | None = None,
    ) -> None:
        settings = settings or VirtualRigSettings()
        self.clock: Clock = clock or (SystemClock() if settings.real_time else VirtualClock())
        self.patience_s = settings.patience_s if isinstance(self.clock, VirtualClock) else 0.0
        self.exact_properties = settings.exact_properties()
        specimen = SimulatedSpecimen(settings.specimen)
        self.stage = StageDevice(self.clock)
        self.closed_machine, self.box = self._closed_machine(settings)
        # beside a closed machine, the load frame stands idle with a specimen that no camera sees
        in_frame = specimen if self.closed_machine is None else SimulatedSpecimen(settings.specimen)
        self.load_frame = LoadFrameDevice(self.clock, in_frame, rng=np.random.default_rng(settings.seed))
        self.load_frame.mount_load_cell(settings.load_cell)
        self.load_frame.fit_drive(settings.drive)
        self.interlocks = InputModule()
        self.scene = Scene(
            seed=settings.seed,
            misalignment=settings.misalignment,
            specimen=specimen,
            angle_deg=self.stage.angle_deg,
            load_n=self._load_n,
        )
        self.picture_faults = PictureFaults(self.clock)
        of_cameras = FaultPanel(CAMERA)
        self.faults = RigFaults(
            stage_faults(FaultPanel(STAGE), self.stage),
            stage_faults(FaultPanel(NEWPORT), self.stage),
            load_frame_faults(FaultPanel(LOAD_FRAME), self.load_frame),
            FaultPanel(INTERLOCK),
            box_faults(FaultPanel(CLOSED_MACHINE), self.box),
            of_cameras,
            self.picture_faults.panel,
        )
        self.plan = PlannedFaults(list(settings.faults), self.faults, self.picture_faults, self.clock.now_s())
        self.around_cameras = Surroundings(
            of_cameras, self.picture_faults, self.plan, settings.prepared, say or _say_beside
        )
        with ExitStack() as started:
            self.addresses: Mapping[str, str] = self._start(settings, places or ServerAddresses(), started)
            self._started = started.pop_all()

    def _closed_machine(
        self, settings: VirtualRigSettings
    ) -> tuple[ClosedMachine[SpecimenState] | None, AnalogueBox | None]:
        if settings.closed_machine is None:
            return None, None
        machine = ClosedMachine(
            self.clock, settings.closed_machine, lambda: SimulatedSpecimen(settings.specimen), settings.seed
        )
        return machine, AnalogueBox(self.clock, machine)

    def _load_n(self) -> float:
        """Return the true load of the specimen that the cameras see, and give it its present state."""
        if self.closed_machine is None:
            return self.load_frame.load_n()
        self.scene.specimen.state = self.closed_machine.state()
        return self.scene.specimen.state.load_n

    def _start(
        self, settings: VirtualRigSettings, places: ServerAddresses, started: ExitStack
    ) -> dict[str, str]:
        """Start every server, register each server's `close` with `started`, and return the addresses."""
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

        if self.box is None:
            self._serve_load_frame(settings, serve, port)
        else:
            of_box = self.faults[CLOSED_MACHINE]
            serve("closed_machine", AnalogueBoxServer(self.box, port=port("closed_machine"), faults=of_box))
        interlocks_port, of_interlocks = port("interlocks"), self.faults[INTERLOCK]
        serve("interlocks", InputModuleServer(self.interlocks, port=interlocks_port, faults=of_interlocks))
        return addresses

    def _serve_load_frame(
        self, settings: VirtualRigSettings, serve: Callable[..., None], port: Callable[[str], int]
    ) -> None:
        """Start the three servers of the load frame."""
        frame, of_frame = self.load_frame, self.faults[LOAD_FRAME]
        layout = LAYOUTS[settings.load_frame_map]
        tcp = LoadFrameServer(frame, port=port("load_frame"), layout=layout, faults=of_frame)
        serve("load_frame", tcp)
        serve("load_frame_rtu", LoadFrameRtuServer(frame, faults=of_frame, registers=tcp.registers))
        rtu_port = port("load_frame_rtu_tcp")
        rtu_tcp = LoadFrameRtuServer(frame, LOCALHOST, rtu_port, faults=of_frame, registers=tcp.registers)
        serve("load_frame_rtu_tcp", rtu_tcp, "rtu://")

    def truth(self) -> dict[str, float | bool]:
        """Return the current true state: shaft angle, crosshead, load and the specimen's strains."""
        load_n = self._load_n()
        machine = self.load_frame if self.closed_machine is None else self.closed_machine
        state = self.scene.specimen.state
        return {
            "time_s": self.clock.now_s(),
            "angle_deg": self.stage.angle_deg(),
            "displacement_mm": machine.displacement_mm(),
            "load_n": load_n,
            "axial_strain": state.axial_strain,
            "transverse_strain": state.transverse_strain,
            "thickness_strain": state.thickness_strain,
            "broken": state.broken,
            "grid_attached": self.scene.grid_attached,
            **self._band_truth(),
            **self._program_truth(),
        }

    def _band_truth(self) -> dict[str, float | bool]:
        """Return the true place of a Lüders band's front, and the strain of the middle of the specimen."""
        specimen = self.scene.specimen
        if (point := specimen.settings.yield_point) is None or point.band is None:
            return {}
        band = specimen.state.band
        return {
            "band_travels": band is not None,
            "band_front_mm": specimen.front_mm(),
            "middle_strain": specimen.state.axial_strain if band is None else band.strain_at(0.0),
        }

    def _program_truth(self) -> dict[str, float | bool]:
        """Return the true state of the closed machine's program and trigger output."""
        if self.closed_machine is None:
            return {}
        pulses, high = self.closed_machine.trigger()
        return {
            "program_running": self.closed_machine.running,
            "trigger_pulses": pulses,
            "trigger_high": high,
        }

    def close(self) -> None:
        """Stop every server; a repeated call does nothing."""
        self._started.close()


def _say_beside(line: str) -> None:
    """Write a line to standard error, as the results of a command are written to standard output."""
    with suppress(OSError, ValueError):
        sys.stderr.write(line + "\n")


def _open(settings: VirtualRigSettings, context: OpenContext) -> VirtualRig:
    return VirtualRig(settings)


SPEC = DriverSpec("environment", VirtualRigSettings, _open)
