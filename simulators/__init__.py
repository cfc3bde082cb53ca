"""Simulators of the rig's devices and of the specimen; their true state is the reference for tests.

This package exports all public names. A name is loaded from its module when the name is first used:

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
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from simulators.load_frame.device import LoadFrameDevice
    from simulators.load_frame.layout import LAYOUTS, RegisterLayout
    from simulators.load_frame.modbus import LoadFrameRtuServer, LoadFrameServer
    from simulators.rig.camera import CameraSettings, SimulatedCamera
    from simulators.rig.simulation import Simulation
    from simulators.rig.virtual_rig import VirtualRig, VirtualRigSettings
    from simulators.scene.exact_properties import exact_properties
    from simulators.scene.optics import PinholeCamera
    from simulators.scene.scene import Misalignment, Scene, Surface
    from simulators.scene.specimen import SimulatedSpecimen, SpecimenSettings, SpecimenState
    from simulators.stage.device import StageDevice
    from simulators.stage.newport import NewportServer
    from simulators.stage.zaber import ZaberServer
    from simulators.wire.faults import FAULTS, Fault, FaultPanel
    from simulators.wire.rig_faults import RigFaults

__all__ = [
    "FAULTS",
    "LAYOUTS",
    "CameraSettings",
    "Fault",
    "FaultPanel",
    "LoadFrameDevice",
    "LoadFrameRtuServer",
    "LoadFrameServer",
    "Misalignment",
    "NewportServer",
    "PinholeCamera",
    "RegisterLayout",
    "RigFaults",
    "Scene",
    "SimulatedCamera",
    "SimulatedSpecimen",
    "Simulation",
    "SpecimenSettings",
    "SpecimenState",
    "StageDevice",
    "Surface",
    "VirtualRig",
    "VirtualRigSettings",
    "ZaberServer",
    "exact_properties",
]

_NAMES_OF = {
    "simulators.load_frame.device": ("LoadFrameDevice",),
    "simulators.load_frame.layout": ("LAYOUTS", "RegisterLayout"),
    "simulators.load_frame.modbus": ("LoadFrameRtuServer", "LoadFrameServer"),
    "simulators.rig.camera": ("CameraSettings", "SimulatedCamera"),
    "simulators.rig.simulation": ("Simulation",),
    "simulators.rig.virtual_rig": ("VirtualRig", "VirtualRigSettings"),
    "simulators.scene.exact_properties": ("exact_properties",),
    "simulators.scene.optics": ("PinholeCamera",),
    "simulators.scene.scene": ("Misalignment", "Scene", "Surface"),
    "simulators.scene.specimen": ("SimulatedSpecimen", "SpecimenSettings", "SpecimenState"),
    "simulators.stage.device": ("StageDevice",),
    "simulators.stage.newport": ("NewportServer",),
    "simulators.stage.zaber": ("ZaberServer",),
    "simulators.wire.faults": ("FAULTS", "Fault", "FaultPanel"),
    "simulators.wire.rig_faults": ("RigFaults",),
}
_RENAMED = {"Layout": "RegisterLayout", "Specimen": "SimulatedSpecimen"}
_MODULE_OF = {name: module for module, names in _NAMES_OF.items() for name in names}


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


if not TYPE_CHECKING:  # with this function visible, type checkers would accept every name

    def __getattr__(name: str) -> Any:
        """Load a public name from its module when it is first used (PEP 562)."""
        if name in _RENAMED:
            warnings.warn(
                f"simulators.{name} is simulators.{_RENAMED[name]} now", DeprecationWarning, stacklevel=2
            )
            name = _RENAMED[name]
        if name not in _MODULE_OF:
            raise AttributeError(f"module 'simulators' has no attribute {name!r}")
        value = globals()[name] = getattr(import_module(_MODULE_OF[name]), name)
        return value
