"""A testing machine that no program on this computer commands: it pulls the specimen by its own program."""

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Generic, Protocol, TypeVar

from drivers.clock import Clock
from simulators.closed_machine.output import Draws, VoltageOutput
from simulators.closed_machine.program import Program
from simulators.closed_machine.settings import ClosedMachineSettings


class State(Protocol):
    """The parts of a specimen's state that the machine shows."""

    @property
    def load_n(self) -> float:
        """The load in N."""

    @property
    def axial_strain(self) -> float:
        """The strain along the load."""


S = TypeVar("S", bound=State)


class PulledSpecimen(Protocol[S]):
    """Interface of specimen, grips and machine in series, whose load depends on the furthest position."""

    state: S

    def stretch_to(self, displacement_mm: float) -> float:
        """Move the crosshead to a position, counted from the test's start; return the load in N."""


class ClosedMachine(Generic[S]):
    """A machine with a program, three voltage outputs and a trigger output.

    The true state at every time, also in the past, follows exactly from the program. The random parts of the
    voltages depend only on the seed and the time, so that a repeated test gives identical values.

    Parameters
    ----------
    clock : Clock
        The machine is switched on now.
    settings : ClosedMachineSettings
    untouched : callable
        Returns a new specimen. The voltages show states of the past, for which one specimen that is pulled
        further and further could not be asked.
    seed : int
    """

    def __init__(
        self,
        clock: Clock,
        settings: ClosedMachineSettings,
        untouched: Callable[[], PulledSpecimen[S]],
        seed: int = 1,
    ) -> None:
        self.settings = settings
        self.program = Program(settings.program, settings.start_s)
        self._clock = clock
        self._begun_s = clock.now_s()
        self._untouched = untouched
        self._stretched = lru_cache(maxsize=64)(self._stretched_to)
        quantities = {
            "force": (settings.force, lambda time_s: self._state(time_s).load_n),
            "crosshead": (settings.crosshead, self.program.displacement_mm),
            "extensometer": (settings.extensometer, lambda time_s: self._state(time_s).axial_strain),
        }
        self.outputs = {
            name: VoltageOutput(each, quantity, Draws(seed, place))
            for place, (name, (each, quantity)) in enumerate(quantities.items())
        }

    def state(self) -> S:
        """Return the true state of the specimen now."""
        return self.state_at(self._clock.now_s())

    def state_at(self, now_s: float) -> S:
        """Return the true state of the specimen at any time on the rig's clock."""
        return self._state(self.time_s(now_s))

    def displacement_mm(self) -> float:
        """Return the true position of the crosshead now."""
        return self.displacement_at(self._clock.now_s())

    def displacement_at(self, now_s: float) -> float:
        """Return the true position of the crosshead in mm at any time on the rig's clock."""
        return self.program.displacement_mm(self.time_s(now_s))

    def time_s(self, now_s: float) -> float:
        """Return the machine's time, counted from switching on, for a time on the rig's clock."""
        return now_s - self._begun_s

    def volts(self) -> dict[str, float]:
        """Return the present voltage of each output."""
        time_s = self.time_s(self._clock.now_s())
        return {name: output.volts(time_s) for name, output in self.outputs.items()}

    def trigger(self) -> tuple[int, bool]:
        """Return how many trigger pulses have begun, and whether the trigger line is high now.

        The first pulse begins with the program. While the program runs, a pulse follows every
        `trigger_every_s`.
        """
        time_s = self.time_s(self._clock.now_s())
        if time_s < self.program.start_s:
            return 0, False
        every_s = self.settings.trigger_every_s
        last = max(0, math.ceil((self.program.end_s - self.program.start_s) / every_s) - 1)
        number = min(math.floor((time_s - self.program.start_s) / every_s), last)
        since_s = time_s - self.program.start_s - number * every_s
        return number + 1, since_s < self.settings.trigger_width_s

    @property
    def running(self) -> bool:
        """True while the program runs."""
        return self.program.running(self.time_s(self._clock.now_s()))

    def _state(self, time_s: float) -> S:
        return self._stretched(self.program.furthest_mm(time_s), self.program.displacement_mm(time_s))

    def _stretched_to(self, furthest_mm: float, displacement_mm: float) -> S:
        specimen = self._untouched()
        specimen.stretch_to(furthest_mm)
        specimen.stretch_to(displacement_mm)
        return specimen.state
