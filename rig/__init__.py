"""Plan, run and record experiments.

This package exports all public names. A name is loaded when it is first used:

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
from typing import Any

from lazy_loader import attach_stub

_load, __dir__, __all__ = attach_stub(__name__, __file__)
_RENAMED = {"Reading": "RigReading", "Status": "EngineStatus"}


def __getattr__(name: str) -> Any:
    """Load a public name, also by the name that it had until version 0.1."""
    if name in _RENAMED:
        warnings.warn(f"rig.{name} is rig.{_RENAMED[name]} now", DeprecationWarning, stacklevel=2)
    return _load(_RENAMED.get(name, name))
