"""Whether the position of a stage on an ESP301 has a reference: it does not say so, it must be remembered.

Only a home search of this program's own counts, and only as long as the motor stays on: a reset, a power cut
and an emergency stop all switch it off.
"""

import threading

MOTOR_OFF = "motor off"


class Reference:
    """What was seen of the stage so far; may be used from any thread."""

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
        """From now on, a motor that is off was switched off by something."""
        with self._lock:
            self._on = True

    @property
    def seeking(self) -> bool:
        """Whether a home search is under way, as far as was seen."""
        return self._seeking

    def seek(self) -> None:
        """Say that a home search has begun."""
        with self._lock:
            self._seeking = True

    def break_off(self) -> None:
        """Say that a home search under way, if there is one, finds nothing that can be believed."""
        with self._lock:
            self._seeking = False

    def forget(self) -> None:
        """Say that the position cannot be trusted."""
        with self._lock:
            self._found = self._seeking = False

    def fail(self, failure: str) -> None:
        """Say what made motion fail."""
        with self._lock:
            self._fail(failure)

    def see(self, *, on: bool, ended: bool) -> tuple[bool, str]:
        """Take in a reading.

        Parameters
        ----------
        on : bool
            Whether the motor is on.
        ended : bool
            Whether a home search was under way before the stage was asked, and it stood then.

        Returns
        -------
        referenced : bool
        failure : str
            What made motion fail since the last acknowledgement; empty if nothing did.
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
