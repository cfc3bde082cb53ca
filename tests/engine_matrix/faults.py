"""Faults at a moment of a run: of devices, lines, drivers and the disk, and the abort by a person."""

import resource
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from drivers.errors import DeviceError
from rig.recorder.space import CLOSING_BYTES
from simulators.wire.faults import CAMERA, FAULTS as SIMULATED, LOAD_FRAME, STAGE, names
from tests.engine_matrix.runs import Moment, Run
from tests.fault_matrix.matrix import LIES, rows

FOREVER_S = 1e6


@dataclass(frozen=True)
class RunFault:
    """A fault, and the required result of a run with this fault.

    Attributes
    ----------
    name : str
    devices : tuple of str
        The fault can occur on a rig with one of these devices. If empty, it can occur on every rig.
    strike : callable
    ends : bool
        True if the run must not be completed, because later readings cannot be trusted.
    borne : bool
        True if the run must be completed, because nothing is lost.
    only : tuple of str
        The states in which the fault is tried. If empty, it is tried in all states. A fault that takes 15 s
        of real time is tried in a few states only.
    """

    name: str
    devices: tuple[str, ...]
    strike: Callable[[Run], None]
    ends: bool = False
    borne: bool = False
    only: tuple[str, ...] = ()

    def can_strike(self, moment: Moment) -> bool:
        """Return True if the fault can occur on the rig at this moment."""
        device = {"tension": "load_frame", "rotation": "stage"}[moment.kind]
        return (not self.devices or device in self.devices) and (not self.only or moment.state in self.only)


_ENDS = {
    "lose-request", "drop", "corrupt", "late", "wrong-unit", "exception:6", "reject:STATUSBUSY", "unplug",
    "e-stop", "nan-load", "frozen-counter",
}  # fmt: skip
"""Permanent faults after which no reading is possible or reliable."""
_LATE_ENOUGH = {"stage.late"}
"""Permanent faults that do not end a run at some moments.

If a question is repeated, the late answer to the first question arrives. For a stage at rest, this answer is
true. While the stage moves, the run ends.
"""
_BORNE = {"split:1", "delay:0.02:1", "duplicate:1"}


def _switched_on(form: str) -> Callable[[Run], None]:
    return lambda run: run.virtual.faults.switch_on(form)


_QUICK = {"delay": "delay:0.02:1", "delay:0.5:1": "delay:0.8:1"}
"""Replaced delays in real time: the shorter one is far below the reply timeout, the longer one above."""
_AS_FAST = {"drifting-load": "drifting-load:500"}
"""Replaced rate of the load's drift, because a run of the matrix is ten times as fast as a usual run."""
_UNSEEN = {"drifting-load:500"}
"""Wrong load readings that no check can detect while a plastic specimen is stretched."""
_LASTING = {"split", "duplicate"}
"""Permanent faults that are left out, because they only slow down every message of a run."""


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
    """Return a fault: readings hang, so that the run ends, and the stop hangs in real time."""

    def strike(run: Run) -> None:
        def instead(call: Callable[..., Any], *arguments: Any) -> Any:
            run.over.wait(60.0)

        _hangs(device, "read")(run)
        run.interfere[device, stop] = instead

    return strike


def _disk_full(run: Run) -> None:
    """Limit the run file to its present size and the space that the recorder has reserved for closing it."""
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
