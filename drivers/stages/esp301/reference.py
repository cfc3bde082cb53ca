"""Record of the reference position, because an ESP301 does not report whether a stage has a reference.

A stage has a reference only after a home search by this program, and only while the motor stays on. A reset,
a power cut and an emergency stop all switch the motor off.
"""

import threading

MOTOR_OFF = "motor off"


class HomeReference:
    """Record of the home searches and failed motions of a stage. Any thread may use this object."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._found = False
        self._seeking = False
        self._on = False
        self._failure = ""

    def acknowledge(self) -> None:
        """Delete the recorded failures and the reference, before a new home search."""
        with self._lock:
            self._failure = ""
            self._found = self._seeking = False

    def motor_is_on(self) -> None:
        """Record that the motor was switched on. If it is found off later, this counts as a failure."""
        with self._lock:
            self._on = True

    @property
    def seeking(self) -> bool:
        """True if a home search was started and its end was not yet observed."""
        return self._seeking

    def seek(self) -> None:
        """Record that a home search has begun."""
        with self._lock:
            self._seeking = True

    def break_off(self) -> None:
        """Record that a home search was interrupted, so that it gives no valid reference position."""
        with self._lock:
            self._seeking = False

    def forget(self) -> None:
        """Record that the stage has no valid reference any more."""
        with self._lock:
            self._found = self._seeking = False

    def fail(self, failure: str) -> None:
        """Record that a motion failed, and the cause of the failure."""
        with self._lock:
            self._fail(failure)

    def see(self, *, on: bool, ended: bool) -> tuple[bool, str]:
        """Record a reading of the stage, and return whether the stage has a reference.

        `on` is True if the motor is on. `ended` is True if a home search was under way before the reading,
        and the stage now stands still. The returned text has the causes of all failed motions since the last
        call of `acknowledge`. It is empty without a failure.
        """
        with self._lock:
            if self._on and not on:
                self._fail(f"{MOTOR_OFF}: a reset, a power cut or an emergency stop")
            self._on = on
            if not on:
                self._found = self._seeking = False
            elif self._seeking and ended:
                self._found, self._seeking = True, False
            return self._found, self._failure

    def _fail(self, failure: str) -> None:
        self._failure = f"{self._failure}; {failure}" if self._failure else failure
        self._found = self._seeking = False
