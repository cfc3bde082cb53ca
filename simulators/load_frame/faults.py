"""Faults of the load frame itself, as opposed to faults of its line."""

from simulators.load_frame.device import LoadFrameDevice
from simulators.wire.faults import FaultPanel


def load_frame_faults(panel: FaultPanel, device: LoadFrameDevice) -> FaultPanel:
    """Connect the faults of a load frame to `device`; return the panel."""
    panel.when("e-stop", device.press_estop, device.release_estop)
    panel.when("limit", device.hit_limit_switch)
    panel.when("reset", device.power_cycle)
    panel.when("stall", device.jam, device.free)
    panel.when("nan-load", lambda: device.break_load_cell(True), lambda: device.break_load_cell(False))
    panel.when("frozen-counter", device.freeze, device.thaw)
    panel.when("broken-specimen", device.break_specimen)
    panel.when("watchdog-off", lambda: device.lose_watchdog(True), lambda: device.lose_watchdog(False))
    return panel
