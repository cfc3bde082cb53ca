"""A simulated analogue box whose inputs a test sets by hand, and the lines on which it can be reached."""

import struct
from functools import partial
from typing import Any

from drivers.clock import Clock, VirtualClock
from simulators.closed_machine.box import COILS, WRITE_REGISTER, AnalogueBox
from simulators.closed_machine.modbus import AnalogueBoxRtuServer, AnalogueBoxServer
from simulators.wire.ports import LOCALHOST

BOX_LINES: dict[str, tuple[Any, str, dict[str, str]]] = {
    "tcp": (AnalogueBoxServer, "{}", {}),
    # a pseudo-terminal carries no parity bits
    "rtu": (AnalogueBoxRtuServer, "{}", {"parity": "N"}),
    "rtu-over-tcp": (partial(AnalogueBoxRtuServer, host=LOCALHOST), "rtu://{}", {}),
}
READING_FUNCTIONS = {1, 2, 3, 4}


class ByHand:
    """Three voltages, a trigger line and a contact that a test sets."""

    def __init__(self) -> None:
        self.inputs = {"force": 0.0, "crosshead": 0.0, "extensometer": 0.0}
        self.pulses, self.high, self.running = 0, False, False

    def volts(self) -> dict[str, float]:
        return dict(self.inputs)

    def trigger(self) -> tuple[int, bool]:
        return self.pulses, self.high


class WatchedBox(AnalogueBox):
    """A box that counts its requests, and may confirm writes that it does not execute.

    Attributes
    ----------
    hand : ByHand
    requests : list of bytes
    deaf : bool
    raw : dict of int to list of int
        Registers in place of those with the values of `hand`.
    """

    def __init__(self, clock: Clock | None = None) -> None:
        self.hand = ByHand()
        super().__init__(clock or VirtualClock(), self.hand)
        self.requests: list[bytes] = []
        self.deaf = False
        self.raw: dict[int, list[int]] = {}

    @property
    def changes(self) -> int:
        """Number of requests that could change the state of the box."""
        return sum(request[0] not in READING_FUNCTIONS for request in self.requests)

    def answer(self, request: bytes) -> bytes:
        self.requests.append(request)
        if self.deaf and request[0] not in READING_FUNCTIONS:
            return request[:5]
        return super().answer(request)

    def _registers(self) -> dict[int, list[int]]:
        return self.raw or super()._registers()

    def leave_on(self, number: int) -> None:
        """Leave a coil or an output register on, as a program does that is killed during a pulse."""
        if number < COILS:
            self.set_coil(number, True)
        else:
            self.answer(struct.pack(">BHH", WRITE_REGISTER, number, 0x40A0))
