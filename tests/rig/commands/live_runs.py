"""Statuses of a tensile test with live gauges, for the tests of what a person sees."""

import math

import numpy as np

from rig.engine.status import EngineStatus, State
from rig.live.values import GaugeValue, LiveNow, LiveReading
from rig.protocol.step import ProtocolStep, RigReading

PULL = ProtocolStep(2, "displacement", 3.0)
REASON = "too many saturated pixels"
MODULUS_MPA = 70_000.0
AREA_MM2 = 25.0


def live_now(strain: float, *, lost: int = 0, time_s: float = 10.0) -> LiveNow:
    """Return an elastic test up to a strain, with an extensometer and an invalid transverse gauge."""
    strains = np.linspace(0.0, strain, 50)
    axial = GaugeValue(strain, 2e-5, True, "", "corrected", "off_axis")
    across = GaugeValue(-0.3 * strain, 3e-5, False, REASON, "calibrated", "on_axis")
    reading = LiveReading(time_s, 0.001, time_s + 0.004, {"off_axis": 7}, {"axial": axial, "across": across})
    curves = {
        "axial": [(float(each), MODULUS_MPA * float(each)) for each in strains],
        "across": [(-0.3 * float(each), MODULUS_MPA * float(each)) for each in strains],
    }
    return LiveNow(reading, 10.0, 98.7, 1234, lost, 5, curves, "MPa")


def live_status(live: LiveNow | None, *, time_s: float = 10.0) -> EngineStatus:
    """Return the status of a run that pulls."""
    load_n = math.nan if live is None else MODULUS_MPA * AREA_MM2 * live.curves["axial"][-1][0]
    reading = RigReading(time_s, load_n, 0.4567, moving=True)
    return EngineStatus(State.MOVING, PULL, 4, 2, reading, simulated=True, live=live)
