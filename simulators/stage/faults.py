"""Faults inside the rotation stage, in contrast to faults of its communication line."""

from simulators.stage.device import StageDevice
from simulators.wire.faults import FaultPanel


def stage_faults(panel: FaultPanel, device: StageDevice) -> FaultPanel:
    """Return a panel with the faults of a rotation stage; switching a fault on changes `device`."""
    panel.when("e-stop", device.press_estop, device.release_estop)
    panel.when("limit", lambda: device.fail("FE"))
    panel.when("reset", device.power_cycle)
    panel.when("stall", device.jam, device.free)
    return panel
