"""Check every reading against the limits of the run, and check that load and displacement agree."""

import math

from rig.errors import LimitViolation, SpecimenBroken
from rig.limits.agreement import Agreement
from rig.limits.in_force import commanded
from rig.limits.run_limits import RunLimits
from rig.limits.speed import SpeedCheck
from rig.protocol.live_table import LiveTable
from rig.protocol.protocol import Protocol, live_table_of
from rig.protocol.step import LoadDrop, ProtocolStep, RigReading
from rig.protocol.tables import Limits
from rig.samples import GAUGE_PREFIX

POLL_MIN_S = 0.02
"""Shortest time between two readings in s. A load frame has a new sample every 10 to 20 ms."""
_LOAD_POLL_SHARE, _POLL_SHARE = 0.003, 0.01
_REST_READINGS = 20


class Watch:
    """Checks each reading of a run, and determines how often the devices must be read.

    `limits` are the limits of the run, merged from protocol, rig file and devices.
    """

    def __init__(self, protocol: Protocol, limits: RunLimits) -> None:
        self._settle = protocol.settle
        self._conditions = protocol.conditions
        self._load_drop: LoadDrop = "break"
        self._sense = 1.0
        self._table = limits.table
        self._step: ProtocolStep | None = None
        self._last: RigReading | None = None
        self._highest_n = 0.0
        self._agreement: Agreement | None = None
        self._speed = SpeedCheck(limits)
        self._strains = _strain_limits(live_table_of(protocol))
        conditions = self._conditions
        # A test that begins in compression is checked with opposite signs, as one in tension.
        self._mirrors = conditions.pull is not None and conditions.pull.sense < 0.0
        if limits.string is not None and conditions.pull is not None and conditions.zeroing is not None:
            self._agreement = Agreement(limits.string, conditions.pull, conditions.zeroing)

    def expect(self, load_drop: LoadDrop) -> None:
        """Set the meaning of a falling load for the next readings.

        During a hold the load may fall slowly, so each reading is compared with the reading before. During
        unloading, a falling load does not mean a break. After unloading, the highest load is determined again
        from new readings. A motion that lowers the load also pushes a specimen in compression, whose load
        must not go back to zero by itself.
        """
        self._load_drop = load_drop
        sense = {"break": 1.0, "commanded": -1.0}.get(load_drop)
        if sense is not None and sense != self._sense:
            self._sense = sense
            self._highest_n = 0.0 if self._last is None else sense * self._last.load_n

    def begin(self, step: ProtocolStep) -> None:
        """Check the target and the rate of a step before its motion is commanded.

        Raise `LimitViolation` if the target or the rate is beyond a limit, or if the load drifts.
        """
        for quantity, value in commanded(step):
            self._table.check(quantity, value, f"{step}, before the motion")
        if self._agreement is not None:
            self._agreement.begin(step.mirrored() if self._mirrors else step)
        self._speed.begin(step)
        self._step = step

    def change_speed(self, speed_mm_s: float) -> None:
        """Note a new speed of the crosshead, before or after it was commanded during the present motion."""
        self._table.check("speed", speed_mm_s, f"{self._step}, a change of speed")
        self._speed.change(speed_mm_s)

    def tared(self) -> None:
        """Record that load and displacement were set to zero."""
        self._highest_n = 0.0
        if self._agreement is not None:
            self._agreement.tared()

    def poll_s(self, poll_s: float) -> float:
        """Return the time between two readings in s, at most `poll_s`.

        During an increment of load, the load rises by a few thousandths of the increment from one reading to
        the next. So the load frame is stopped before the crosshead moves far beyond a plausible displacement.
        """
        step, last = self._step, self._last
        if self._agreement is None:
            return poll_s
        if step is not None and step.holds:
            return poll_s
        if step is None or last is None or not step.pulls:
            wanted_s = self._settle.dwell_s / _REST_READINGS
        else:
            share = _LOAD_POLL_SHARE if step.quantity == "load" else _POLL_SHARE
            wanted_s = share * abs(step.target - step.value(last)) / step.rate
        return min(poll_s, max(POLL_MIN_S, wanted_s))

    def check(self, reading: RigReading, step: str) -> None:
        """Check one reading.

        Raise `LimitViolation` if a value is beyond its limit, in tension or in compression, or if load and
        displacement do not agree, and `SpecimenBroken` if the load fell by more than the declared fraction of
        the highest load.
        """
        if self._step is not None and self._step.kind == "rotation":
            self._table.check("angle", reading.angle_deg, step)
        for name, most, least in self._strains:
            self._check_strain(reading, name, most, least, step)
        if self._conditions.limits is not None:
            self._table.check("load", reading.load_n, step)
            self._table.check("displacement", reading.displacement_mm, step)
            self._check_break(reading, step, self._conditions.limits)
        if self._agreement is not None and self._mirrors:
            self._agreement.check(reading.mirrored(), f"{step}, in compression (here shown positive)")
        elif self._agreement is not None:
            self._agreement.check(reading, step)
        if self._agreement is not None:
            self._speed.check(reading, step)
        self._last = reading

    def _check_strain(self, reading: RigReading, name: str, most: float, least: float, step: str) -> None:
        found = reading.signals.get(name)
        if found is None or not found.is_new:
            return
        for strain in found.values.tolist():
            if not least <= strain <= most:
                bound = f"at most {most:g}" if strain > most else f"at least {least:g}"
                raise LimitViolation(
                    step,
                    f"a strain of {name} of {bound}",
                    f"{strain:.5g}",
                    "the limit is that of the table [live]; look at the specimen",
                )

    def _check_break(self, reading: RigReading, step: str, limits: Limits) -> None:
        """Check that the specimen has not broken, unless a stage of a pull ends with a drop of the load."""
        if self._load_drop == "slow":
            # The specimen is in tension or in compression, as it was at the reading before.
            before_n = 0.0 if self._last is None else self._last.load_n
            self._sense = -1.0 if before_n < 0.0 else 1.0
            self._highest_n = abs(before_n)
        if self._sense < 0.0 and limits.load_min_n is None:
            return  # the protocol only pulls
        load_n, drop = self._sense * reading.load_n, limits.drop(self._sense)
        self._highest_n = max(self._highest_n, load_n)
        carried_n = self._conditions.carried_n if self._sense > 0.0 else limits.carried_n(self._sense)
        least_n = (1.0 - drop) * self._highest_n
        step_ends_so = self._step is not None and self._step.acquisition is not None and self._step.event
        if self._highest_n >= carried_n and load_n < least_n and not step_ends_so:
            raise self._broken(reading, step, least_n, limits)
        if self._load_drop == "slow":
            self._highest_n = load_n

    def _broken(self, reading: RigReading, step: str, least_n: float, limits: Limits) -> SpecimenBroken:
        in_compression, drop = self._sense < 0.0, limits.drop(self._sense)
        buckled = "buckled, broke" if in_compression else "broke"
        key = "buckling" if in_compression and limits.buckling_load_drop is not None else "break"
        return SpecimenBroken(
            step,
            f"a load {'below' if in_compression else 'above'} {self._sense * least_n:.0f} N after "
            f"{self._sense * self._highest_n:.0f} N",
            f"{reading.load_n:.0f} N",
            f"the specimen {buckled} or slipped out of the grips, or the load cell failed: the images up to "
            f"here are on file; if neither did, raise limits.{key}_load_drop above {drop:g}",
        )


def _strain_limits(table: LiveTable | None) -> list[tuple[str, float, float]]:
    """Return the signal of each live gauge that is limited, its largest and its smallest strain."""
    if table is None or (table.strain_max is None and table.strain_min is None):
        return []
    most = math.inf if table.strain_max is None else table.strain_max
    least = -math.inf if table.strain_min is None else table.strain_min
    return [(f"{GAUGE_PREFIX}{name}", most, least) for name in table.names]
