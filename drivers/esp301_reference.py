"""Whether the position of a stage on an ESP301 has a reference: it does not say so, it must be remembered.

Only a home search of this program's own counts, and only as long as the motor stays on: a reset, a power cut
and an emergency stop all switch it off.
"""

import threading

MOTOR_OFF = "motor off"


class Reference:
    """What was seen of the stage so far; may be used from any thread.

    Attributes
    ----------
    stops : int
        How often the stage was stopped.
    """

    def __init__(self) -> None:
        self.stops = 0
        self._lock = threading.Lock()
        self._found = False
        self._seeking = False
        self._on = False
        self._failure = ""

    def acknowledge(self) -> None:
        """Forget the failure, and the reference."""
        with self._lock:
            self._failure = ""
            self._found = self._seeking = False

    def motor_is_on(self) -> None:
        """From now on, a motor that is off was switched off by something."""
        with self._lock:
            self._on = True

    def seek(self, stops: int) -> None:
        """Say that a home search has begun, unless the stage was stopped since `stops`."""
        with self._lock:
            self._seeking = self.stops == stops

    def stop(self) -> None:
        """Say that the stage is being stopped: a home search under way finds nothing any more."""
        with self._lock:
            self.stops += 1
            self._seeking = False

    def forget(self) -> None:
        """Say that the position cannot be trusted."""
        with self._lock:
            self._found = False

    def see(self, *, on: bool, moving: bool, failures: list[str]) -> tuple[bool, str]:
        """Take in a reading.

        Returns
        -------
        referenced : bool
        failure : str
            What made motion fail since the last acknowledgement; empty if nothing did.
        """
        with self._lock:
            if self._on and not on:
                failures = [*failures, f"{MOTOR_OFF}: a reset, a power cut or an emergency stop"]
            self._on = on
            if failures:
                self._failure = "; ".join(failures)
            if failures or not on:
                self._found = self._seeking = False
            elif self._seeking and not moving:
                self._found, self._seeking = True, False
            return self._found, self._failure
