"""Simulators of the rig's devices and of the specimen; their true state is the reference for tests.

This package exports all public names. A name is loaded when it is first used:

>>> from contextlib import closing
>>> import simulators
>>> with closing(simulators.VirtualRig()) as rig:
...     sorted(rig.addresses)
['interlocks', 'load_frame', 'load_frame_rtu', 'load_frame_rtu_tcp', 'newport', 'stage', 'stage_tcp']

A `VirtualRig` runs inside the program, usually on simulated time. A `Simulation` runs in real time for other
programs. Each device can also be used alone: a `StageDevice` with a `ZaberServer` or a `NewportServer`, a
`LoadFrameDevice` with a `LoadFrameServer`, and a `SimulatedCamera` with a `Scene`.
"""

import warnings
from typing import Any

from lazy_loader import attach_stub

_load, __dir__, __all__ = attach_stub(__name__, __file__)
_RENAMED = {"Layout": "RegisterLayout", "Specimen": "SimulatedSpecimen"}


def __getattr__(name: str) -> Any:
    """Load a public name, also by the name that it had until version 0.1."""
    if name in _RENAMED:
        now = _RENAMED[name]
        warnings.warn(f"simulators.{name} is simulators.{now} now", DeprecationWarning, stacklevel=2)
    return _load(_RENAMED.get(name, name))
