"""Plan, run and record experiments.

This package exports all public names. The module that defines a name is loaded when the name is first used:

>>> import rig
>>> outcome = rig.run_protocol("tension.toml", "rig.toml", "run.h5")
>>> with rig.RunFile("run.h5") as run:
...     image = run.image("off_axis", run.steps[-1])

An experiment that cannot start raises `RigError`, a failing device raises `drivers.errors.DeviceError`, and
a file with mistakes raises `drivers.errors.ConfigurationError`. Each error message is one sentence whose
last part tells the user what to do. After the start of a run, an error of the experiment or of a device ends
the run, and `run_protocol` returns an `Outcome` with the error message.
"""

import warnings
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dic.errors import RunFileError
    from dic.runfile.interlocks import RunInterlock
    from dic.runfile.reader import RunFile, RunInfo, RunStep
    from rig.commands.repair import Repair, repair_run
    from rig.commands.verify import CameraCheck, InterlockCheck, Verification, verify_run
    from rig.devices import Rig, open_rig
    from rig.engine.engine import Engine
    from rig.engine.signals import aborting_on_signals
    from rig.engine.status import AtRest, EngineStatus, Outcome, State
    from rig.errors import (
        Aborted,
        BadImage,
        LimitViolation,
        ProtocolError,
        RecordingError,
        RigError,
        SettleTimeout,
        SpecimenBroken,
    )
    from rig.facts import RigFacts, facts_of_file
    from rig.news.run_news import NewsOptions
    from rig.plan import Plan, PlannedStep, make_plan
    from rig.protocol.phased import PhasesProtocol
    from rig.protocol.protocol import Protocol, read_protocol
    from rig.protocol.rotation import RotationProtocol
    from rig.protocol.step import ProtocolStep, RigReading
    from rig.protocol.tension import TensionProtocol
    from rig.recorder import InterlockRecord, Recorder, RunHeader, StepRecord
    from rig.replay.replay import Replay, replay_run
    from rig.rigfile import DeviceEntry, RigFile, read_rig
    from rig.run import plan_protocol, run_protocol

__all__ = [
    "Aborted",
    "AtRest",
    "BadImage",
    "CameraCheck",
    "DeviceEntry",
    "Engine",
    "EngineStatus",
    "InterlockCheck",
    "InterlockRecord",
    "LimitViolation",
    "NewsOptions",
    "Outcome",
    "PhasesProtocol",
    "Plan",
    "PlannedStep",
    "Protocol",
    "ProtocolError",
    "ProtocolStep",
    "Recorder",
    "RecordingError",
    "Repair",
    "Replay",
    "Rig",
    "RigError",
    "RigFacts",
    "RigFile",
    "RigReading",
    "RotationProtocol",
    "RunFile",
    "RunFileError",
    "RunHeader",
    "RunInfo",
    "RunInterlock",
    "RunStep",
    "SettleTimeout",
    "SpecimenBroken",
    "State",
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
    "repair_run",
    "replay_run",
    "run_protocol",
    "verify_run",
]

_NAMES_OF = {
    "dic.errors": ("RunFileError",),
    "dic.runfile.interlocks": ("RunInterlock",),
    "dic.runfile.reader": ("RunFile", "RunInfo", "RunStep"),
    "rig.commands.repair": ("Repair", "repair_run"),
    "rig.commands.verify": ("CameraCheck", "InterlockCheck", "Verification", "verify_run"),
    "rig.devices": ("Rig", "open_rig"),
    "rig.engine.engine": ("Engine",),
    "rig.engine.signals": ("aborting_on_signals",),
    "rig.engine.status": ("AtRest", "Outcome", "State", "EngineStatus"),
    "rig.errors": (
        "Aborted",
        "BadImage",
        "LimitViolation",
        "ProtocolError",
        "RecordingError",
        "RigError",
        "SettleTimeout",
        "SpecimenBroken",
    ),
    "rig.facts": ("RigFacts", "facts_of_file"),
    "rig.news.run_news": ("NewsOptions",),
    "rig.plan": ("Plan", "PlannedStep", "make_plan"),
    "rig.protocol.phased": ("PhasesProtocol",),
    "rig.protocol.protocol": ("Protocol", "read_protocol"),
    "rig.protocol.rotation": ("RotationProtocol",),
    "rig.protocol.step": ("ProtocolStep", "RigReading"),
    "rig.protocol.tension": ("TensionProtocol",),
    "rig.recorder": ("InterlockRecord", "Recorder", "RunHeader", "StepRecord"),
    "rig.replay.replay": ("Replay", "replay_run"),
    "rig.rigfile": ("DeviceEntry", "RigFile", "read_rig"),
    "rig.run": ("plan_protocol", "run_protocol"),
}
_RENAMED = {"Reading": "RigReading", "Status": "EngineStatus"}
_MODULE_OF = {name: module for module, names in _NAMES_OF.items() for name in names}


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


if not TYPE_CHECKING:  # hide this function from type checkers, because with it they would accept every name

    def __getattr__(name: str) -> Any:
        """Load a public name from its module when it is first used (PEP 562)."""
        if name in _RENAMED:
            warnings.warn(f"rig.{name} is rig.{_RENAMED[name]} now", DeprecationWarning, stacklevel=2)
            name = _RENAMED[name]
        if name not in _MODULE_OF:
            raise AttributeError(f"module 'rig' has no attribute {name!r}")
        value = globals()[name] = getattr(import_module(_MODULE_OF[name]), name)
        return value
