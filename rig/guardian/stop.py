"""The guardian's stop: all machines at the same time, each again until it confirms that it stands still."""

import threading
from collections.abc import Mapping
from dataclasses import dataclass

from drivers.clock import Clock, SystemClock
from drivers.registry import GUARD_STOP_MAX_S, Guard

TRIES_S = 60.0
"""Time in s for which an unconfirmed stop is repeated, because a cable may be plugged in again."""
PAUSE_S = 0.1


@dataclass
class _Machine:
    guard: Guard
    begun_s: float
    left: str = "it did not confirm"
    tried: bool = False
    ended_s: float | None = None


class Stop:
    """A stop of several machines. The constructor begins it, on a thread for each machine."""

    def __init__(self, guards: Mapping[str, Guard], clock: Clock | None = None) -> None:
        self._clock = clock or SystemClock()
        self._begun_s = self._clock.now_s()
        self._end_s = self._begun_s + TRIES_S
        self._machines = {name: _Machine(guard, self._begun_s) for name, guard in guards.items()}
        for machine in self._machines.values():
            threading.Thread(target=self._repeat, args=(machine,), daemon=True).start()

    def _repeat(self, machine: _Machine) -> None:
        while machine.ended_s is None:
            machine.begun_s = self._clock.now_s()
            try:
                machine.guard.stop()
                machine.left = ""
            # catch every exception, because a third party's guard may raise any type
            except Exception as error:
                machine.left = str(error) or type(error).__name__
            if not machine.left or self._clock.now_s() >= self._end_s:
                machine.ended_s = self._clock.now_s()
            machine.tried = True
            if machine.ended_s is None:
                self._clock.sleep(PAUSE_S)

    def ages_s(self) -> dict[str, float]:
        """Return the age in s of the present attempt to stop each machine that has not confirmed its stop."""
        now_s = self._clock.now_s()
        return {
            name: now_s - machine.begun_s
            for name, machine in self._machines.items()
            if machine.ended_s is None
        }

    @property
    def tried(self) -> bool:
        """True if the first attempt to stop each machine has ended, or hangs."""
        return all(
            machine.tried or self._clock.now_s() - machine.begun_s > GUARD_STOP_MAX_S
            for machine in self._machines.values()
        )

    @property
    def ended(self) -> bool:
        """True if each machine stands, or the time for its repeated stop is over."""
        late = self._clock.now_s() >= self._end_s + GUARD_STOP_MAX_S
        return late or all(machine.ended_s is not None for machine in self._machines.values())

    @property
    def confirmed(self) -> bool:
        """True if each machine has confirmed that it stands still."""
        return not any(machine.left for machine in self._machines.values())

    def describe(self) -> str:
        """Return which machines stand still, after which time, and which have not confirmed their stop."""
        stood = {name: machine for name, machine in self._machines.items() if not machine.left}
        parts = []
        if stood:
            took_s = max((machine.ended_s or self._begun_s) - self._begun_s for machine in stood.values())
            parts.append(f"{' and '.join(stood)} stopped, confirmed after {1000 * took_s:.0f} ms")
        moving = [f"{name}: {machine.left}" for name, machine in self._machines.items() if machine.left]
        if moving:
            parts.append(f"STOP NOT CONFIRMED, use the emergency stop ({'; '.join(moving)})")
        return "; ".join(parts)
