"""Command the motion or the hold of a protocol step."""

from rig.engine.devices import CalledLoadFrame, CalledStage, Devices
from rig.protocol.step import ProtocolStep


def begin(step: ProtocolStep, devices: Devices) -> None:
    """Command the target of a step, whose device the rig must have; return at once."""
    if step.kind == "relaxation":
        _load_frame(devices).hold()
    elif step.quantity == "load":
        _load_frame(devices).go_to_load(step.target, step.rate)
    elif step.quantity == "displacement":
        _load_frame(devices).go_to_displacement(step.target, step.rate)
    elif step.quantity == "rotation":
        _stage(devices).move_to(step.target)


def _load_frame(devices: Devices) -> CalledLoadFrame:
    assert devices.load_frame is not None  # `require_devices` has checked this
    return devices.load_frame


def _stage(devices: Devices) -> CalledStage:
    assert devices.stage is not None  # `require_devices` has checked this
    return devices.stage
