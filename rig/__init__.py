"""The experiment: protocols, plans, runs, and the files that runs leave.

This package exports every public name and loads each one when it is first used:

>>> import rig
>>> outcome = rig.run_protocol("tension.toml", "rig.toml", "run.h5")
>>> with rig.RunFile("run.h5") as run:
...     image = run.image("off_axis", run.steps[-1])

An experiment that cannot go on raises `RigError`, a failing device `drivers.errors.DeviceError`, and a file
with mistakes `drivers.errors.ConfigurationError`. Each message is one sentence that ends with the remedy.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dic.errors import RunFileError
    from dic.runfile.reader import RunFile, RunInfo, RunStep
    from rig.commands.verify import CameraCheck, Verification, verify_run
    from rig.devices import Rig, open_rig
    from rig.engine.engine import Engine
    from rig.engine.signals import aborting_on_signals
    from rig.engine.status import Outcome, State, Status
    from rig.errors import (
        Aborted,
        LimitViolation,
        ProtocolError,
        RecordingError,
        RigError,
        SettleTimeout,
        SpecimenBroken,
    )
    from rig.facts import RigFacts, facts_of_file
    from rig.plan import Plan, PlannedStep, make_plan
    from rig.protocol.protocol import Protocol, RotationProtocol, TensionProtocol, read_protocol
    from rig.protocol.step import ProtocolStep, Reading
    from rig.recorder import Recorder, RunHeader, StepRecord
    from rig.rigfile import DeviceEntry, RigFile, read_rig
    from rig.run import plan_protocol, run_protocol

__all__ = [
    "Aborted",
    "CameraCheck",
    "DeviceEntry",
    "Engine",
    "LimitViolation",
    "Outcome",
    "Plan",
    "PlannedStep",
    "Protocol",
    "ProtocolError",
    "ProtocolStep",
    "Reading",
    "Recorder",
    "RecordingError",
    "Rig",
    "RigError",
    "RigFacts",
    "RigFile",
    "RotationProtocol",
    "RunFile",
    "RunFileError",
    "RunHeader",
    "RunInfo",
    "RunStep",
    "SettleTimeout",
    "SpecimenBroken",
    "State",
    "Status",
    "StepRecord",
    "TensionProtocol",
    "Verification",
    "aborting_on_signals",
    "facts_of_file",
    "make_plan",
    "open_rig",
    "plan_protocol",
    "read_protocol",
    "read_rig",
    "run_protocol",
    "verify_run",
]

_NAMES_OF = {
    "dic.errors": ("RunFileError",),
    "dic.runfile.reader": ("RunFile", "RunInfo", "RunStep"),
    "rig.commands.verify": ("CameraCheck", "Verification", "verify_run"),
    "rig.devices": ("Rig", "open_rig"),
    "rig.engine.engine": ("Engine",),
    "rig.engine.signals": ("aborting_on_signals",),
    "rig.engine.status": ("Outcome", "State", "Status"),
    "rig.errors": (
        "Aborted",
        "LimitViolation",
        "ProtocolError",
        "RecordingError",
        "RigError",
        "SettleTimeout",
        "SpecimenBroken",
    ),
    "rig.facts": ("RigFacts", "facts_of_file"),
    "rig.plan": ("Plan", "PlannedStep", "make_plan"),
    "rig.protocol.protocol": ("Protocol", "RotationProtocol", "TensionProtocol", "read_protocol"),
    "rig.protocol.step": ("ProtocolStep", "Reading"),
    "rig.recorder": ("Recorder", "RunHeader", "StepRecord"),
    "rig.rigfile": ("DeviceEntry", "RigFile", "read_rig"),
    "rig.run": ("plan_protocol", "run_protocol"),
}
_MODULE_OF = {name: module for module, names in _NAMES_OF.items() for name in names}


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


if not TYPE_CHECKING:  # type checkers would otherwise allow any name

    def __getattr__(name: str) -> Any:
        """Load a public name from its module when it is first used (PEP 562)."""
        if name not in _MODULE_OF:
            raise AttributeError(f"module 'rig' has no attribute {name!r}")
        value = globals()[name] = getattr(import_module(_MODULE_OF[name]), name)
        return value
