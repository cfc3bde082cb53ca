"""Faults that are in the device itself, not on its line: what switching them on and off does to it."""

from simulators.load_frame.device import LoadFrameDevice
from simulators.stage.device import StageDevice
from simulators.wire.faults import FaultPanel


def stage_faults(panel: FaultPanel, device: StageDevice) -> FaultPanel:
    """Let the faults of a rotation stage act on `device`; return the panel."""
    panel.when("e-stop", device.press_estop, device.release_estop)
    panel.when("limit", lambda: device.fail("FE"))
    panel.when("reset", device.power_cycle)
    panel.when("stall", device.jam, device.free)
    return panel


def frame_faults(panel: FaultPanel, device: LoadFrameDevice) -> FaultPanel:
    """Let the faults of a load frame act on `device`; return the panel."""
    panel.when("e-stop", device.press_estop, device.release_estop)
    panel.when("limit", device.hit_limit_switch)
    panel.when("reset", device.power_cycle)
    panel.when("stall", device.jam, device.free)
    panel.when("nan-load", lambda: device.break_load_cell(True), lambda: device.break_load_cell(False))
    panel.when("frozen-counter", device.freeze, device.thaw)
    panel.when("broken-specimen", device.break_specimen)
    panel.when("watchdog-off", lambda: device.lose_watchdog(True), lambda: device.lose_watchdog(False))
    return panel
