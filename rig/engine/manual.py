"""Move a rig by hand. Every reading must stay within limits, and a signal stops the motion at once."""

from collections.abc import Callable
from dataclasses import dataclass

from drivers.errors import DeviceError
from rig.devices import Rig
from rig.engine.calls import NEVER, Calls
from rig.engine.devices import called
from rig.engine.look import look
from rig.engine.monitor import Monitor
from rig.engine.safety import SafeState
from rig.engine.settle import settle
from rig.engine.status import AtRest
from rig.errors import Aborted, RigError
from rig.limits.by_hand import HandAgreement, HandMotion
from rig.protocol.step import RigReading

POLL_S, MOVING_POLL_S = 0.1, 0.05
"""Time between two readings, in s, at rest and during a motion."""
DWELL_S = 0.5
REST_READINGS = 8
SPARE_S = 30.0
"""A motion fails if it takes more than twice its planned duration plus this time in s."""


@dataclass(frozen=True)
class Moved:
    """The result of a motion by hand: "completed", "aborted" or "failed", the reason, and the last readings.

    The attribute `begun` is True if the motion was confirmed, so that the machine may have moved.
    """

    status: str
    reason: str
    unsafe: tuple[str, ...]
    at_end: AtRest
    begun: bool = False


class Manual:
    """Executes motions by hand on an opened rig.

    At the end of every motion, also after an error, the load frame must hold and the stage must stop.

    `on_reading` is called with each reading, on the thread of `move`, and must return at once. `on_progress`
    is described for `Engine`.
    """

    def __init__(
        self,
        rig: Rig,
        *,
        on_reading: Callable[[RigReading], None] = lambda _: None,
        on_progress: Callable[[bool], None] = lambda _: None,
    ) -> None:
        self._rig = rig
        self._on_reading = on_reading
        self._on_progress = on_progress
        self._calls = Calls(rig.clock, self._check_abort, rig.lost, meanwhile=self.read, every_s=POLL_S)
        self._devices = called(rig, self._calls)
        # There is no protocol here. The permitted range of each motion replaces the protocol's limits.
        self._monitor = Monitor(self._devices, self._calls, rig.clock)
        self._safe_state = SafeState(rig)
        self._doing = "before the motion"
        self._motion: HandMotion | None = None
        self._agreement: HandAgreement | None = None
        self._abort_reason: str | None = None

    def abort(self, reason: str) -> None:
        """Hold the load frame and stop the stage at once, and end `move`. Any thread may call this method."""
        if self._abort_reason is None:
            self._abort_reason = reason
        self._safe_state.command()
        self._calls.interrupt()

    def read(self) -> RigReading:
        """Read all devices, and check the reading against the permitted range of the motion."""
        self._check_abort()
        reading = self._monitor.read(self._doing)
        if self._agreement is not None:
            self._agreement.check(reading)
        if self._motion is not None:
            self._motion.check(reading)
        self._on_reading(reading)
        self._on_progress(self._motion is not None or reading.moving)
        self._check_abort()
        return reading

    def move(
        self, plan: Callable[[RigReading], HandMotion], confirm: Callable[[HandMotion, RigReading], None]
    ) -> Moved:
        """Plan a motion from the present reading, ask for its confirmation, execute it, then hold.

        `plan` returns the motion for a reading, or raises `RigError` if the motion is beyond a limit.
        `confirm` is called with the motion and the reading, on a separate thread, while the devices are
        monitored. It asks for the confirmation, and raises `RigError` to refuse the motion.
        """
        status, reason = "completed", ""
        with self._rig.clock.activity():
            try:
                reading = self.read()
                motion = plan(reading)
                self._doing = motion.doing
                question = self._calls.begin("operator", "confirm", lambda: confirm(motion, reading), NEVER)
                self._calls.finish(question, watched=True)
                self._execute(motion)
            except (RigError, DeviceError) as error:
                status = "failed" if self._abort_reason is None else "aborted"
                reason = str(error)
                if self._abort_reason is not None and not isinstance(error, Aborted):
                    # Name the abort first, because its hold command may have caused this error of the driver.
                    reason = f"{self._aborted()}; meanwhile: {error}"
            except BaseException:
                self._safe_state.confirm()
                self._calls.close()
                raise
            return self._end(status, reason)

    def hold(self) -> Moved:
        """Hold the load frame and stop the stage."""
        with self._rig.clock.activity():
            return self._end("completed", "")

    def _execute(self, motion: HandMotion) -> None:
        self._check_abort()
        # The motion is confirmed, so it counts as begun from here on.
        self._motion = motion
        if motion.load_max_n is not None:
            self._agreement = HandAgreement(motion, self._rig.limits, self._rest())
        self._devices.go_to(motion.quantity, motion.target, motion.rate)
        settle(
            self.read,
            lambda reading: not reading.moving and motion.step.is_reached(reading),
            dwell_s=DWELL_S,
            timeout_s=2.0 * motion.duration_s + SPARE_S,
            poll_s=MOVING_POLL_S,
            clock=self._rig.clock,
            pause=self._calls.pause,
            step=motion.doing,
            expected=f"{motion.target:.6g} ± {motion.tolerance:g}",
        )

    def _rest(self) -> list[RigReading]:
        """Read the machine several times at rest, to measure the noise of load and displacement."""
        readings = [self.read()]
        for _ in range(REST_READINGS - 1):
            self._calls.pause(POLL_S)
            readings.append(self.read())
        return readings

    def _end(self, status: str, reason: str) -> Moved:
        unsafe = tuple(self._safe_state.confirm())
        if unsafe:
            status = "failed"
            reason = f"SAFE STATE NOT CONFIRMED, use the emergency stop ({'; '.join(unsafe)}). {reason}"
        at_end = look(self._devices, self._calls, self._safe_state.confirmed)
        self._calls.close()
        return Moved(status, reason.strip(), unsafe, at_end, begun=self._motion is not None)

    def _check_abort(self) -> None:
        if self._abort_reason is not None:
            raise self._aborted()

    def _aborted(self) -> Aborted:
        remedy = "start the command again to go on"
        return Aborted(self._doing, "the end of the motion", str(self._abort_reason), remedy)
