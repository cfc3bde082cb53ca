"""Run the virtual rig in real time, with servers for other programs, for the command `rig simulate`."""

import threading
from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

from drivers.clock import SystemClock
from drivers.interfaces import OpenContext, OperatorAction
from simulators.rig.camera import SPEC as CAMERA_SPEC
from simulators.rig.operator import Asked, SimulatedOperator, notice
from simulators.rig.places import ServerAddresses, served
from simulators.rig.planned_faults import FaultPlan
from simulators.rig.rig_tables import RigTables
from simulators.rig.scene_wire import SceneServer
from simulators.rig.truth_log import TruthLog
from simulators.rig.virtual_rig import VirtualRig
from simulators.wire.faults import FAULTS, NOT_IN_RIG

HELP = (
    "fault DEVICE.FAULT   switch a fault on, such as stage.drop:2 or picture.cover@off_axis",
    "fault FAULT after SECONDS   switch it on later",
    "fault FAULT when QUANTITY above NUMBER   switch it on in a state, such as axial_strain; or below",
    "clear [DEVICE[.FAULT]]   switch off one fault, all faults of a device, or all faults",
    "faults   list the faults that are on",
    "truth   print the current true state",
    "quit   end the simulation; so does Ctrl-C",
)


class StoppableClock(SystemClock):
    """The system's clock, with a method that wakes all sleeping threads when the simulation ends."""

    def __init__(self) -> None:
        self._stopped = threading.Event()

    def sleep(self, duration_s: float) -> None:
        """Block for `duration_s` seconds, or until a call of `stop`."""
        self._stopped.wait(max(0.0, duration_s))

    def stop(self) -> None:
        """Wake all sleeping threads."""
        self._stopped.set()


class Simulation:
    """All servers of a virtual rig, with its cameras, its operator and a log of the true state.

    Parameters
    ----------
    tables : mapping, optional
        The content of a rig file. Default: a rig with a stage, a load frame and two cameras.
    source : str
        The name of the rig file, for error messages.
    log : Path, optional
        File for the log of the true state.
    places : iterable of str
        Addresses of servers in the form that `simulators.rig.places.ServerAddresses.read` accepts.
    say : callable, optional
        Called on another thread, with a line about each action of the operator. May be set later.

    Raises
    ------
    ConfigurationError
        If the tables have mistakes.
    ValueError
        If an address is malformed, or belongs to a server that this simulation does not have.
    OSError
        If the log cannot be written, or an address is in use.
    """

    def __init__(
        self,
        tables: Mapping[str, Any] | None = None,
        source: str = "simulation",
        log: Path | None = None,
        places: Iterable[str] = (),
        say: Callable[[str], None] = lambda line: None,
    ) -> None:
        self.say = say
        self._tables = RigTables.read(tables or {}, source)
        wanted = ServerAddresses.read(places)
        servers = served(closed_machine=self._tables.simulation.closed_machine is not None)
        for name in (*wanted.ports, *wanted.links):
            if name not in servers:
                raise ValueError(f"a place for {name}, which this simulation does not have")
        self._clock = StoppableClock()
        with ExitStack() as started:
            self.rig = started.enter_context(
                closing(VirtualRig(self._tables.simulation, self._clock, wanted))
            )
            self.log = started.enter_context(closing(TruthLog(log, self.rig)))
            self._scene = SceneServer(
                {
                    name: CAMERA_SPEC.open(each, OpenContext(f"cameras.{name}", self._clock, self.rig))
                    for name, each in self._tables.cameras.items()
                },
                SimulatedOperator(
                    self.rig.scene, self._clock, self._tables.operator.duration_s, self._on_action
                ),
                self.log.frame,
                port=wanted.ports.get("scene", 0),
            )
            started.pop_all()

    @property
    def addresses(self) -> dict[str, str]:
        """Address of each server, by name. The server ``scene`` is that of the cameras and the operator."""
        return {**self.rig.addresses, "scene": self._scene.address}

    def rig_file(self) -> str:
        """Return a rig file with which another program uses this simulation."""
        return self._tables.rig_file(self.addresses)

    def command(self, line: str) -> list[str]:
        """Execute one typed command of the simulation, and return the lines to print."""
        verb, _, rest = line.strip().partition(" ")
        faults = self.rig.faults
        try:
            match verb:
                case "fault":
                    self.switch_on(rest)
                case "clear":
                    self._clear(rest)
                case "truth":
                    return [f"{name}: {value:.6g}" for name, value in self.rig.truth().items()]
                case "faults":
                    pass
                case _:
                    return list(HELP)
        except (ValueError, OSError) as error:
            return [str(error)]
        planned = "".join(f"; planned: {plan}" for plan in self.rig.plan.plans)
        return [f"on: {', '.join(faults.active) or 'nothing'}{planned}"]

    def switch_on(self, fault: str) -> None:
        """Switch a fault on, or plan it; raise `ValueError` if the text of the fault has a mistake.

        ``picture.cover after 3`` begins 3 s from now, and ``picture.tear when axial_strain above 0.01`` in a
        state.
        """
        if len(fault.split()) > 1:
            plan = FaultPlan.read(fault)
            if plan.after_s is not None:
                opened_ago_s = self._clock.now_s() - self.rig.plan.opened_s
                plan = plan.model_copy(update={"after_s": plan.after_s + opened_ago_s})
            self.rig.plan.add(plan)
            return
        self.rig.faults.switch_on(fault)
        self.log.write("fault", fault=fault.strip(), on=True)

    def _on_action(self, action: Asked, done: bool) -> None:
        name = action.name if isinstance(action, OperatorAction) else "ASK"
        self.log.write("operator", action=name, done=done)
        duration_s = self._tables.operator.duration_s
        self.say("simulated operator: done" if done else notice(action, duration_s))

    def _clear(self, faults: str) -> None:
        before = self.rig.faults.active
        try:
            self.rig.faults.clear(faults)
        finally:
            still = self.rig.faults.active
            for fault in before:
                if fault not in still:
                    self.log.write("fault", fault=fault, on=False)

    @staticmethod
    def list_faults() -> list[str]:
        """Return a line for each fault: its syntax, its devices and its effect."""
        width = max(len(fault.usage) for fault in FAULTS.values())
        devices = {
            name: ", ".join(each for each in fault.devices if each not in NOT_IN_RIG)
            for name, fault in FAULTS.items()
        }
        return [f"{fault.usage:{width}}  {fault.summary} ({devices[name]})" for name, fault in FAULTS.items()]

    def close(self) -> None:
        """Stop every server; a repeated call does nothing."""
        self._clock.stop()
        self._scene.close()
        self.rig.close()
        self.log.close()
