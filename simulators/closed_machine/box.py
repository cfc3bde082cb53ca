"""The analogue and digital box at a closed machine: its registers, contacts and outputs.

Source: MODBUS Application Protocol Specification V1.1b3. No code is shared with drivers.
"""

import struct
import threading
from collections.abc import Mapping
from typing import Protocol, TypeVar

from drivers.clock import Clock

READ_COILS, READ_DISCRETE, READ_HOLDING, READ_INPUT = 1, 2, 3, 4
WRITE_COIL, WRITE_REGISTER, WRITE_COILS, WRITE_REGISTERS = 5, 6, 15, 16
ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE = 1, 2, 3

FLOATS, SWAPPED_FLOATS, COUNTS, TRIGGER, OUTPUTS = 0, 20, 40, 60, 1000
"""First register of each block."""
COUNTS_PER_V = 3000.0
NO_VOLTS, NO_COUNTS = -9999.0, -0x8000
"""What the registers of an input say if it has no value."""
COILS, OUTPUT_REGISTERS = 8, 4

T = TypeVar("T")


class Measured(Protocol):
    """What the box measures at a machine."""

    def volts(self) -> Mapping[str, float]:
        """Return the voltages of the inputs, in the order of the inputs."""

    def trigger(self) -> tuple[int, bool]:
        """Return the number of trigger pulses, and whether the trigger line is high."""

    @property
    def running(self) -> bool:
        """True while the machine runs its program."""


class RefusedError(Exception):
    """The box answers a request with an exception code."""

    def __init__(self, code: int) -> None:
        self.code = code
        super().__init__(f"exception {code}")


class AnalogueBox:
    """A box with voltage inputs, a counter of trigger pulses, two contacts, eight coils and four registers.

    All values of one answer are measured at the same time.

    Attributes
    ----------
    edges : list of (float, int, bool)
        Time on the clock, number and new state of each change of a coil. The registers of outputs count as
        numbers from 1000, and are on if they are not 0.
    executed : list of (float, str)
        Time and name of each of these changes.
    broken, overflown : bool
        True if the inputs have no value, or if their amplifiers are at the end.
    """

    def __init__(self, clock: Clock, measured: Measured) -> None:
        self._clock, self._measured = clock, measured
        self._lock = threading.Lock()
        self._coils = [False] * COILS
        self._outputs = [0] * OUTPUT_REGISTERS
        self.edges: list[tuple[float, int, bool]] = []
        self.executed: list[tuple[float, str]] = []
        self.broken = self.overflown = False

    def coil(self, number: int) -> bool:
        """Return the state of a coil."""
        return self._coils[number]

    def set_coil(self, number: int, on: bool) -> None:
        """Switch a coil, as another program does."""
        with self._lock:
            self._switch(number, on)

    def output(self, place: int) -> int:
        """Return the number in an output register."""
        return self._outputs[place]

    def answer(self, request: bytes) -> bytes:
        """Execute one protocol data unit and return the data unit of the answer."""
        function = request[0]
        try:
            with self._lock:
                return bytes([function]) + self._execute(function, request[1:])
        except RefusedError as refused:
            return bytes([function | 0x80, refused.code])
        except struct.error:
            return bytes([function | 0x80, ILLEGAL_VALUE])

    def _execute(self, function: int, data: bytes) -> bytes:
        if function in (READ_COILS, READ_DISCRETE):
            first, count = struct.unpack(">HH", data)
            bits = (
                self._coils
                if function == READ_COILS
                else [self._measured.trigger()[1], self._measured.running]
            )
            return _packed(_cut({0: bits}, first, count))
        if function in (READ_HOLDING, READ_INPUT):
            first, count = struct.unpack(">HH", data)
            words = _cut(self._registers(), first, count)
            return struct.pack(f">B{count}H", 2 * count, *words)
        if function in (WRITE_COIL, WRITE_REGISTER):
            number, word = struct.unpack(">HH", data)
            self._write(function == WRITE_COIL, number, [word])
            return data
        if function in (WRITE_COILS, WRITE_REGISTERS):
            number, count, size = struct.unpack(">HHB", data[:5])
            body = data[5:]
            if function == WRITE_COILS:
                values = [
                    0xFF00 * (body[place // 8] >> place % 8 & 1) for place in range(min(count, 8 * size))
                ]
            else:
                values = list(struct.unpack(f">{size // 2}H", body))
            if len(values) != count or len(body) != size:
                raise RefusedError(ILLEGAL_VALUE)
            self._write(function == WRITE_COILS, number, values)
            return data[:4]
        raise RefusedError(ILLEGAL_FUNCTION)

    def _write(self, coils: bool, number: int, words: list[int]) -> None:
        first, count = (0, COILS) if coils else (OUTPUTS, OUTPUT_REGISTERS)
        if not first <= number <= number + len(words) <= first + count or not words:
            raise RefusedError(ILLEGAL_ADDRESS)
        if coils and any(word not in (0, 0xFF00) for word in words):
            raise RefusedError(ILLEGAL_VALUE)
        for place, word in enumerate(words, number):
            if coils:
                self._switch(place, word != 0)
            else:
                before, self._outputs[place - OUTPUTS] = self._outputs[place - OUTPUTS], word
                if (before != 0) != (word != 0):
                    self._note(place, word != 0)

    def _switch(self, number: int, on: bool) -> None:
        if self._coils[number] != on:
            self._coils[number] = on
            self._note(number, on)

    def _note(self, number: int, on: bool) -> None:
        now_s = self._clock.now_s()
        self.edges.append((now_s, number, on))
        self.executed.append((now_s, f"output {number} {'on' if on else 'off'}"))

    def _registers(self) -> dict[int, list[int]]:
        """Return all registers now, in blocks by their first address."""
        volts = [_end_of(each) if self.overflown else each for each in self._measured.volts().values()]
        floats, counts = list(volts), [round(each * COUNTS_PER_V) for each in volts]
        if self.broken:
            floats, counts = [NO_VOLTS] * len(volts), [NO_COUNTS] * len(volts)
        pairs = [struct.unpack(">HH", struct.pack(">f", each)) for each in floats]
        pulses, high = self._measured.trigger()
        return {
            FLOATS: [word for pair in pairs for word in pair],
            SWAPPED_FLOATS: [word for pair in pairs for word in reversed(pair)],
            COUNTS: [min(max(each, -0x8000), 0x7FFF) % 2**16 for each in counts],
            TRIGGER: [pulses >> 16 & 0xFFFF, pulses & 0xFFFF, pulses & 0xFFFF, int(high)],
            OUTPUTS: self._outputs,
        }


def _end_of(volts: float) -> float:
    return 10.5 if volts >= 0.0 else -10.5


def _cut(blocks: Mapping[int, list[T]], first: int, count: int) -> list[T]:
    """Return `count` values of one block. Raise `RefusedError` if they do not all belong to it."""
    for start, values in blocks.items():
        if count >= 1 and start <= first and first + count <= start + len(values):
            return values[first - start : first - start + count]
    raise RefusedError(ILLEGAL_ADDRESS)


def _packed(bits: list[bool]) -> bytes:
    size = (len(bits) + 7) // 8
    number = sum(1 << place for place, bit in enumerate(bits) if bit)
    return bytes([size]) + number.to_bytes(size, "little")
