"""Memory of the reference position: an ESP301 does not report whether a stage has a reference.

Only a home search by this program counts, and only as long as the motor stays on. A reset, a power cut and an
emergency stop all switch the motor off.
"""

import threading

MOTOR_OFF = "motor off"


class Reference:
    """Observations of the stage so far; may be used from any thread."""

    def __init__(self) -> None:
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
        """Record that the motor is on; if it is off later, this is a failure."""
        with self._lock:
            self._on = True

    @property
    def seeking(self) -> bool:
        """Whether a home search is under way according to the last observation."""
        return self._seeking

    def seek(self) -> None:
        """Record that a home search has begun."""
        with self._lock:
            self._seeking = True

    def break_off(self) -> None:
        """Record that the result of a running home search cannot be trusted."""
        with self._lock:
            self._seeking = False

    def forget(self) -> None:
        """Record that the position cannot be trusted."""
        with self._lock:
            self._found = self._seeking = False

    def fail(self, failure: str) -> None:
        """Record the cause of a failed motion."""
        with self._lock:
            self._fail(failure)

    def see(self, *, on: bool, ended: bool) -> tuple[bool, str]:
        """Record a reading.

        Parameters
        ----------
        on : bool
            Whether the motor is on.
        ended : bool
            Whether a home search was under way before the reading, and the stage stands in the reading.

        Returns
        -------
        referenced : bool
        failure : str
            Causes of failed motion since the last acknowledgement; empty if there are none.
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
