"""Faults of the stage itself, as opposed to faults of its line."""

from simulators.stage.device import StageDevice
from simulators.wire.faults import FaultPanel


def stage_faults(panel: FaultPanel, device: StageDevice) -> FaultPanel:
    """Connect the faults of a rotation stage to `device`; return the panel."""
    panel.when("e-stop", device.press_estop, device.release_estop)
    panel.when("limit", lambda: device.fail("FE"))
    panel.when("reset", device.power_cycle)
    panel.when("stall", device.jam, device.free)
    return panel
