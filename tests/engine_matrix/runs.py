"""Short runs on the virtual rig, with a fault that strikes at a chosen moment of the engine."""

import threading
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from drivers.lines.stop_deadline import StopTimes
from drivers.load_frames.modbus.load_frame import open_frame
from drivers.registry import DriverSpec
from drivers.stages.zaber.stage import open_stage
from rig.devices import Rig, open_rig
from rig.engine.engine import Engine
from rig.engine.status import Outcome
from rig.protocol.protocol import Protocol, parse_protocol
from rig.recorder import Recorder
from rig.recorder.header import make_header
from rig.rigfile import DeviceEntry, RigFile, read_rig
from simulators.rig.virtual_rig import VirtualRig

STOP_TIMES = StopTimes(deadline_s=0.7, answer_s=0.25)
RIG = """
[rig]
name = "matrix"
[simulation]
driver = "virtual-rig"
patience_s = 0.0
[cameras.front]
driver = "simulated-camera"
width_px = 32
height_px = 32
[cameras.side]
driver = "simulated-camera"
width_px = 32
height_px = 32
[operator]
driver = "simulated-operator"
duration_s = 0.0
"""
LOAD_FRAME = """
[load_frame]
driver = "modbus-frame"
address = "@load_frame"
load_max_n = 14000.0
displacement_max_mm = 6.0
speed_max_mm_s = 2.0
load_rate_max_n_s = 10000.0
reply_timeout_s = 0.5
"""
STAGE = """
[stage]
driver = "zaber-ascii"
port = "@stage_tcp"
angle_min_deg = -5.0
angle_max_deg = 90.0
speed_deg_s = 100.0
acceleration_deg_s2 = 1000.0
reply_timeout_s = 0.5
"""
HEAD = """
title = "matrix"
[sample]
name = "strip"
thickness_mm = 1.0
width_mm = 25.0
gauge_length_mm = 50.0
[images]
per_step = 1
timeout_s = 2.0
"""
TENSION = (
    'kind = "tension"\n'
    + HEAD
    + """
[loading]
increment_n = 5100.0
increments_max = 2
rate_n_s = 10000.0
tare_max_n = 50.0
[loading.plastic]
stiffness_fraction = 0.8
judged_above_n = 4000.0
[stretching]
increment_mm = 0.5
total_mm = 3.4
speed_mm_s = 2.0
[settle]
load_tolerance_n = 50.0
displacement_tolerance_mm = 0.01
dwell_s = 0.05
timeout_s = 30.0
[limits]
load_max_n = 13000.0
displacement_max_mm = 5.0
break_load_drop = 0.3
"""
)
ROTATION = (
    'kind = "rotation"\n'
    + HEAD
    + """
[rotation]
increment_deg = 20.0
total_deg = 40.0
[settle]
angle_tolerance_deg = 0.05
dwell_s = 0.05
timeout_s = 30.0
"""
)


@dataclass(frozen=True)
class Moment:
    """A call of a device's method during a run; a fault occurs just before or just after this call.

    Attributes
    ----------
    state : str
        What the engine does at this moment, as text for the table.
    kind : str
        The kind of the protocol.
    device, method : str
    number : int
        Number of the call among the calls of this method, from 1.
    before : bool
        True if the fault occurs before the call, False if it occurs after the call.
    aborted : bool
        True if a person aborts the run in its second motion. The call then belongs to the safe state.
    """

    state: str
    kind: str
    device: str
    method: str
    number: int
    before: bool = False
    aborted: bool = False


MOMENTS = (
    Moment("asking the operator", "tension", "operator", "perform", 1, before=True),
    Moment("imaging the grid", "tension", "front", "grab", 1, before=True),
    Moment("zeroing the load frame", "tension", "load_frame", "tare", 1),
    Moment("loading for the first time", "tension", "load_frame", "go_to_load", 1),
    Moment("loading again", "tension", "load_frame", "go_to_load", 2),
    Moment("imaging under load", "tension", "front", "grab", 3, before=True),
    Moment("stretching", "tension", "load_frame", "go_to_displacement", 1),
    Moment("making safe", "tension", "load_frame", "hold", 3, before=True, aborted=True),
    Moment("homing the stage", "rotation", "stage", "home", 1),
    Moment("asking the operator", "rotation", "operator", "perform", 1, before=True),
    Moment("imaging the reference", "rotation", "front", "grab", 2, before=True),
    Moment("turning", "rotation", "stage", "move_to", 3),
    Moment("imaging after a turn", "rotation", "side", "grab", 4, before=True),
    Moment("making safe", "rotation", "stage", "stop", 1, before=True, aborted=True),
)


@dataclass
class Run:
    """A run in progress, with all objects that a fault can change.

    Attributes
    ----------
    interfere : dict of (str, str) to callable
        For a device and a method: the function to call instead. Its first argument is the true method.
    struck : bool
        True if the fault has occurred.
    over : Event
        Event that is set at the end, so that calls that hang on purpose can end.
    """

    moment: Moment
    path: Path
    virtual: VirtualRig
    rig: Rig
    recorder: Recorder
    engine: Engine
    interfere: dict[tuple[str, str], Callable[..., Any]] = field(default_factory=dict)
    struck: bool = False
    over: threading.Event = field(default_factory=threading.Event)


class _Watched:
    """A wrapper around a device that counts the calls, so that a fault can occur at one of them."""

    def __init__(
        self, name: str, device: Any, at_call: Callable[[str, str, Any, tuple[Any, ...]], Any]
    ) -> None:
        self._name, self._device, self._at_call = name, device, at_call

    def __getattr__(self, method: str) -> Any:
        found = getattr(self._device, method)
        if not callable(found):
            return found
        return lambda *arguments: self._at_call(self._name, method, found, arguments)


@contextmanager
def run_at(
    moment: Moment, folder: Path, strike: Callable[[Run], None]
) -> Iterator[tuple[Run, Callable[[], Outcome]]]:
    """Open a virtual rig; yield a run and the function that executes it.

    At the given moment of the run, the function `strike` is called, which causes the fault.
    """
    protocol, definition, rig_file = _files(moment.kind)
    virtuals: list[VirtualRig] = []
    rig_file = _quick_to_give_up(_keeping(rig_file, virtuals))
    with open_rig(rig_file) as opened:
        counts: dict[tuple[str, str], int] = {}
        counting = threading.Lock()

        def at_call(name: str, method: str, call: Any, arguments: tuple[Any, ...]) -> Any:
            # The engine and the threads of its safe state may call the same method at the same time.
            with counting:
                number = counts[name, method] = counts.get((name, method), 0) + 1
            if moment.aborted and _is_second_motion(method, number):
                result = call(*arguments)
                run.engine.abort("a person pressed stop")
                return result
            at_moment = (name, method, number) == (moment.device, moment.method, moment.number)
            if at_moment and moment.before:
                _strike()
            instead = run.interfere.get((name, method))
            result = call(*arguments) if instead is None else instead(call, *arguments)
            if at_moment and not moment.before:
                _strike()
            return result

        def _strike() -> None:
            if not run.struck:
                run.struck = True
                strike(run)

        rig = replace(
            opened,
            operator=_Watched("operator", opened.operator, at_call),
            cameras={name: _Watched(name, camera, at_call) for name, camera in opened.cameras.items()},
            stage=opened.stage and _Watched("stage", opened.stage, at_call),
            load_frame=opened.load_frame and _Watched("load_frame", opened.load_frame, at_call),
        )
        recorder = Recorder(
            folder / "run.h5",
            make_header(protocol, definition, rig_file, opened),
            {name: camera.info for name, camera in opened.cameras.items()},
            stage=None if opened.stage is None else opened.stage.info,
            load_frame=None if opened.load_frame is None else opened.load_frame.info,
            settings=rig_file.recording,
        )
        engine = Engine(protocol, rig, recorder)
        run = Run(moment, folder / "run.h5", virtuals[0], rig, recorder, engine)
        try:
            yield run, engine.run
        finally:
            run.over.set()


@cache
def _files(kind: str) -> tuple[Protocol, str, RigFile]:
    """Return the protocol, its text and the rig file; each process reads them only once."""
    definition, machine = (TENSION, LOAD_FRAME) if kind == "tension" else (ROTATION, STAGE)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "rig.toml"
        path.write_text(RIG + machine)
        return parse_protocol(tomllib.loads(definition)), definition, read_rig(path)


def _quick_to_give_up(rig_file: RigFile) -> RigFile:
    """Return the rig file with drivers that give up the stop of a silent device sooner."""

    def quick(entry: DeviceEntry | None, opened: Callable[..., Any]) -> DeviceEntry | None:
        if entry is None:
            return None
        return replace(entry, spec=replace(entry.spec, open=lambda *both: opened(*both, STOP_TIMES)))

    return replace(
        rig_file,
        load_frame=quick(rig_file.load_frame, open_frame),
        stage=quick(rig_file.stage, open_stage),
    )


def _is_second_motion(method: str, number: int) -> bool:
    return (method, number) in (("go_to_load", 2), ("move_to", 3))


def _keeping(rig_file: RigFile, kept: list[VirtualRig]) -> RigFile:
    """Return the rig file with a simulation that is appended to `kept` when it is opened."""
    entry = rig_file.simulation
    assert entry is not None
    spec = entry.spec

    def open_and_keep(settings: Any, context: Any) -> VirtualRig:
        virtual: VirtualRig = spec.open(settings, context)
        kept.append(virtual)
        return virtual

    keeping = DriverSpec(spec.kind, spec.settings, open_and_keep, spec.find)
    return replace(rig_file, simulation=replace(entry, spec=keeping))


__all__ = ["MOMENTS", "Moment", "Run", "run_at"]
