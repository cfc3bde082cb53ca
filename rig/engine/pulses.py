"""Give the pulses of a rig's output lines at the events of a run."""

from rig.devices import Rig
from rig.engine.calls import Call, Calls, Deadline
from rig.rigfile import TriggerEvent


class Pulses:
    """The output lines of a run. The failure of a pulse ends the run.

    The engine waits for a pulse only if the next one of the same line is due before it has begun.
    """

    def __init__(self, rig: Rig, calls: Calls) -> None:
        self._triggers, self._calls = rig.triggers, calls
        self._deadline = Deadline(rig.call_timeout_s, "check the output line and its device")
        self._running: dict[str, Call[None]] = {}

    def lines(self, event: TriggerEvent) -> list[str]:
        """Return the names of the lines that belong to an event."""
        return [name for name, trigger in self._triggers.items() if trigger.at == event]

    def give(self, event: TriggerEvent) -> None:
        """Begin a pulse of each line that belongs to an event. Raise the error of the pulse before."""
        for name, trigger in self._triggers.items():
            if trigger.at == event:
                self._finish(name)
                self._running[name] = self._calls.begin(
                    f"triggers.{name}", "pulse", trigger.device.pulse, self._deadline
                )

    def check(self) -> None:
        """Raise the error of a pulse that has failed or does not begin, without waiting for others."""
        for name, call in list(self._running.items()):
            if call.is_over:
                self._finish(name)

    def finish(self) -> None:
        """Wait for the pulses that were begun, and raise their errors."""
        for name in list(self._running):
            self._finish(name)

    def _finish(self, name: str) -> None:
        if (call := self._running.pop(name, None)) is not None:
            self._calls.finish(call)
