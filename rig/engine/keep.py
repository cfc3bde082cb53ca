"""Wait for the time of the next images during a motion or a hold."""

from collections.abc import Callable

from rig.engine.context import RunContext
from rig.errors import SettleTimeout
from rig.protocol.step import ProtocolStep, Reading

_PAUSE_MIN_S = 0.001


class Keeper:
    """Waits for the image times of one motion or hold, which are counted from its beginning.

    Parameters
    ----------
    run : RunContext
    begun_s : float
        The time of the reading at which the motion or the hold began.
    """

    def __init__(self, run: RunContext, begun_s: float) -> None:
        self._run = run
        self._begun_s = self._kept_s = begun_s
        self._poll_s = run.watch.poll_s(run.settle.poll_s)

    def wait(self, step: ProtocolStep, correct: Callable[[], None]) -> Reading:
        """Read until the image time of a step, and return the last reading. The wait ends early with the
        motion.

        Parameters
        ----------
        step : ProtocolStep
            A step with `at_s`.
        correct : callable
            Function that commands the target of a hold again. The function is called if the held value is
            outside its tolerance although nothing moves.

        Raises
        ------
        SettleTimeout
            If the held value is outside its tolerance for longer than `settle.timeout_s`.
        """
        due_s = self._begun_s + step.at_s
        while True:
            reading = self._run.read()
            if self._run.phase_ended:
                return reading
            if step.is_reached(reading):
                self._kept_s = reading.time_s
                if not (step.holds or reading.moving):
                    return reading
            elif step.holds:
                self._require_kept(step, reading)
                if not reading.moving:
                    correct()
            left_s = due_s - reading.time_s
            if left_s <= 0.0:
                return reading
            # Wait at least a short time, because a remainder from rounding would let no time pass.
            self._run.calls.pause(min(self._poll_s, max(left_s, _PAUSE_MIN_S)))

    def _require_kept(self, step: ProtocolStep, reading: Reading) -> None:
        timeout_s = self._run.settle.timeout_s
        if reading.time_s - self._kept_s > timeout_s:
            raise SettleTimeout(
                f"{step}, holding",
                f"{step.target:.6g} ± {step.tolerance:g}",
                f"{step.value(reading):.6g} for {timeout_s:g} s",
                "look at the specimen and the load frame; if both are sound, raise the tolerance or "
                f"settle.timeout_s above {timeout_s:g}",
            )
