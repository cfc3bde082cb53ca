"""The safe state: the load frame holds and the stage stands; both are commanded at once, with a deadline."""

import threading
from collections.abc import Callable

from rig.devices import Rig

STOP_DEADLINE_S = 15.0
"""Real time; longer than a driver repeats a command on a silent line before it gives up."""


class SafeState:
    """Commands the safe state of a rig, each device on a thread of its own.

    A device that never answers then delays neither the stop of the other device nor the end of the run. A
    signal handler can command the safe state even if it interrupted a call that holds a device's lock.

    Parameters
    ----------
    rig : Rig
    deadline_s : float
        Real time that each device has to confirm.
    """

    def __init__(self, rig: Rig, deadline_s: float = STOP_DEADLINE_S) -> None:
        self._deadline_s = deadline_s
        self._commands: dict[str, Callable[[], None]] = {}
        if rig.load_frame is not None:
            self._commands["load_frame"] = rig.load_frame.hold
        if rig.stage is not None:
            self._commands["stage"] = rig.stage.stop
        self._commanded: list[_Attempt] = []

    def command(self) -> None:
        """Command the safe state without waiting; skip a device whose previous command still runs."""
        for device, command in self._commands.items():
            if not any(attempt.device == device and attempt.is_alive() for attempt in self._commanded):
                attempt = _Attempt(device, command, self._deadline_s)
                self._commanded.append(attempt)
                attempt.start()

    def confirm(self, meanwhile: Callable[[], None] = lambda: None) -> list[str]:
        """Command the safe state again and wait; return one sentence for each device that did not confirm.

        Parameters
        ----------
        meanwhile : callable
            Called once everything is commanded, before the wait. It must not raise.
        """
        attempts = [_Attempt(device, command, self._deadline_s) for device, command in self._commands.items()]
        for attempt in attempts:
            try:
                attempt.start()
            except RuntimeError:
                # The system allows no more threads: command one device after the other.
                attempt.run()
        meanwhile()
        for attempt in attempts + self._commanded:
            if attempt.is_alive():
                attempt.join(self._deadline_s)
        return [attempt.failure for attempt in attempts if attempt.failure]


class _Attempt(threading.Thread):
    """One command to one device; `failure` says why it is not confirmed, and is empty once it is."""

    def __init__(self, device: str, command: Callable[[], None], deadline_s: float) -> None:
        super().__init__(name=f"safe state of {device}", daemon=True)
        self.device = device
        self.failure = f"{device}: no confirmation within {deadline_s:g} s"
        self._command = command

    def run(self) -> None:
        try:
            self._command()
        except BaseException as error:
            self.failure = str(error) or type(error).__name__
        else:
            self.failure = ""
