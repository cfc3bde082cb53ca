"""Faults inside the load frame, in contrast to faults of its communication line."""

from functools import partial

from simulators.load_frame.device import LoadFrameDevice, SpeedFault
from simulators.load_frame.load_cell import Lie
from simulators.wire.faults import FaultPanel

LIES = {
    "zero-load": Lie.ZERO,
    "tenth-load": Lie.TENTH,
    "reversed-load": Lie.REVERSED,
    "stuck-load": Lie.STUCK,
}
SPEED_FAULTS = {"stuck-speed": SpeedFault.STUCK, "wrong-speed": SpeedFault.WRONG}


def load_frame_faults(panel: FaultPanel, device: LoadFrameDevice) -> FaultPanel:
    """Return a panel with the faults of a load frame; switching a fault on changes `device`."""
    panel.when("e-stop", device.press_estop, device.release_estop)
    panel.when("limit", device.hit_limit_switch)
    panel.when("reset", device.power_cycle)
    panel.when("stall", device.jam, device.free)
    panel.when("nan-load", lambda: device.break_load_cell(True), lambda: device.break_load_cell(False))
    panel.when("frozen-counter", device.freeze, device.thaw)
    panel.when("broken-specimen", device.break_specimen)
    panel.when("watchdog-off", lambda: device.lose_watchdog(True), lambda: device.lose_watchdog(False))
    for name, lie in LIES.items():
        panel.when(name, partial(device.lie, lie), partial(device.lie, Lie.NONE))
    for name, fault in SPEED_FAULTS.items():
        panel.when(name, partial(device.spoil_speed, fault), partial(device.spoil_speed, SpeedFault.NONE))
    panel.when(
        "drifting-load",
        lambda: device.lie(Lie.DRIFTING, float(panel.take("drifting-load") or 0.0)),
        partial(device.lie, Lie.NONE),
    )
    return panel
