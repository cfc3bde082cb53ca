"""What can go wrong at a moment of a run: faults of devices, lines, drivers and disk, and a person."""

import resource
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from drivers.errors import DeviceError
from rig.recorder.space import CLOSING_BYTES
from simulators.wire.faults import CAMERA, LOAD_FRAME, STAGE, names
from simulators.wire.faults import FAULTS as SIMULATED
from tests.engine_matrix.runs import Moment, Run
from tests.fault_matrix.matrix import LIES, rows

FOREVER_S = 1e6


@dataclass(frozen=True)
class RunFault:
    """A fault, and what must come of it.

    Attributes
    ----------
    name : str
    devices : tuple of str
        The devices of which the rig needs one, so that this fault can happen; empty for any rig.
    strike : callable
    ends : bool
        The run must not be completed: what follows cannot be trusted.
    borne : bool
        The run must be completed: nothing is lost.
    only : tuple of str
        The states in which the fault is tried, if not in all: this fault takes 15 s of real time.
    """

    name: str
    devices: tuple[str, ...]
    strike: Callable[[Run], None]
    ends: bool = False
    borne: bool = False
    only: tuple[str, ...] = ()

    def can_strike(self, moment: Moment) -> bool:
        """Whether the rig of this moment can have the fault."""
        device = {"tension": "load_frame", "rotation": "stage"}[moment.kind]
        return (not self.devices or device in self.devices) and (not self.only or moment.state in self.only)


_ENDS = {
    "lose-request", "drop", "corrupt", "late", "wrong-unit", "exception:6", "reject:STATUSBUSY", "unplug",
    "e-stop", "nan-load", "frozen-counter",
}  # fmt: skip
"""Lasting faults after which no reading can be had or believed."""
_LATE_ENOUGH = {"stage.late"}
"""Lasting faults that a line may bear at some moments: a repeated question brings the late answer to the
first one, which is true of a stage at rest. While the stage moves, the run ends."""
_BORNE = {"split:1", "delay:0.02:1", "duplicate:1"}


def _switched_on(form: str) -> Callable[[Run], None]:
    return lambda run: run.virtual.faults.switch_on(form)


_QUICK = {"delay": "delay:0.02:1", "delay:0.5:1": "delay:0.8:1"}
"""Delays are real time: the shorter one is far below the reply timeout, the longer one beyond it."""
_AS_FAST = {"drifting-load": "drifting-load:500"}
"""The drift of the load within a run that takes a tenth of the usual time."""
_UNSEEN = {"drifting-load:500"}
"""Lies that no check can find while a plastic specimen is stretched, as its load may do anything."""
_LASTING = {"split", "duplicate"}
"""Lasting faults that a line bears, and which would slow down every message of a run."""


def _of_device(device: str) -> list[RunFault]:
    return [
        RunFault(
            f"{device}.{form}",
            (device,),
            _switched_on(f"{device}.{form}"),
            form in _ENDS and f"{device}.{form}" not in _LATE_ENOUGH,
            form in _BORNE,
        )
        for form in (_QUICK.get(form, form) for form in rows(device) if form not in _LASTING)
    ]


def _raises(device: str, method: str, error: BaseException) -> Callable[[Run], None]:
    def strike(run: Run) -> None:
        def instead(call: Callable[..., Any], *arguments: Any) -> Any:
            raise error

        run.interfere[device, method] = instead

    return strike


def _hangs(device: str, method: str) -> Callable[[Run], None]:
    def strike(run: Run) -> None:
        def instead(call: Callable[..., Any], *arguments: Any) -> Any:
            run.virtual.clock.sleep(FOREVER_S)

        run.interfere[device, method] = instead

    return strike


def _cannot_be_stopped(device: str, stop: str) -> Callable[[Run], None]:
    """Hang in readings, so that the run ends, and in the stop, in real time because its deadline is real."""

    def strike(run: Run) -> None:
        def instead(call: Callable[..., Any], *arguments: Any) -> Any:
            run.over.wait(60.0)

        _hangs(device, "read")(run)
        run.interfere[device, stop] = instead

    return strike


def _disk_full(run: Run) -> None:
    """Let the run file have no more space than the recorder has reserved for closing it."""
    _, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (run.path.stat().st_size + CLOSING_BYTES, hard))


def _pressed_twice(run: Run) -> None:
    run.engine.abort("a person pressed stop")
    run.engine.abort("a person pressed stop again")


_BUG = ValueError("a mistake in a driver")
_REFUSED = DeviceError("operator", "attach", "a person", "no", "start again")

FAULTS: tuple[RunFault, ...] = (
    *_of_device(LOAD_FRAME),
    *(
        RunFault(f"load_frame.{form}", (LOAD_FRAME,), _switched_on(f"load_frame.{form}"), form not in _UNSEEN)
        for form in (_AS_FAST.get(name, name) for name in SIMULATED if name in LIES)
    ),
    *_of_device(STAGE),
    *(
        RunFault(f"{CAMERA}.{name}", (), _switched_on(f"{CAMERA}.{name}"), name in ("unplug", "stall"))
        for name in names(CAMERA)
        if name != "delay"
    ),
    RunFault("load_frame driver raises", (LOAD_FRAME,), _raises("load_frame", "read", _BUG), ends=True),
    RunFault("load_frame driver hangs", (LOAD_FRAME,), _hangs("load_frame", "read"), ends=True),
    RunFault(
        "load_frame's hold hangs",
        (LOAD_FRAME,),
        _cannot_be_stopped("load_frame", "hold"),
        ends=True,
        only=("loading again",),
    ),
    RunFault("stage driver raises", (STAGE,), _raises("stage", "read", _BUG), ends=True),
    RunFault("stage driver hangs", (STAGE,), _hangs("stage", "read"), ends=True),
    RunFault(
        "stage's stop hangs",
        (STAGE,),
        _cannot_be_stopped("stage", "stop"),
        ends=True,
        only=("turning",),
    ),
    RunFault("camera driver raises", (), _raises("side", "grab", _BUG)),
    RunFault("camera driver hangs", (), _hangs("side", "grab")),
    RunFault("operator refuses", (), _raises("operator", "perform", _REFUSED)),
    RunFault("disk full", (), _disk_full),
    RunFault("a person aborts", (), lambda run: run.engine.abort("a person pressed stop"), ends=True),
    RunFault("a person aborts twice", (), _pressed_twice, ends=True),
)
