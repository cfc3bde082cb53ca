"""Modbus messages on TCP and on a serial line: one request, then its answer.

Sources: MODBUS Messaging on TCP/IP Implementation Guide V1.0b, chapter 3.1.3; MODBUS over Serial Line V1.02,
chapters 2.5.1 (frames, silent intervals) and 6.2.2 (CRC).
"""

import struct
from typing import Protocol

from drivers.clock import Clock, SystemClock
from drivers.lines.channel import Channel
from drivers.load_frames.modbus.bus.pdu import (
    EXCEPTION_BIT,
    READ_HOLDING,
    READ_INPUT,
    WRITE_MANY,
    WRITE_ONE,
    ForeignAnswerError,
    crc,
    shown,
)

# A character on the line: start, eight data, parity and stop, or two stops.
BITS_PER_CHARACTER = 11
GAP_CHARACTERS = 3.5
# Above 19 200 baud the specification fixes the gap.
GAP_MIN_S = 0.00175
PDU_MAX = 253
# A line that is not quiet after this multiple of the required silence has traffic of other devices.
QUIET_ATTEMPTS = 10


class SilenceError(Exception):
    """No complete answer came in time; the text says what came instead."""


class DamagedError(SilenceError):
    """The data received in time are not exactly one valid answer."""


class Wire(Protocol):
    """A connection for requests to a device.

    Attributes
    ----------
    numbered : bool
        Whether answers carry the number of their request.
    """

    numbered: bool

    def ask(self, unit: int, pdu: bytes, timeout_s: float, wake: int | None) -> bytes:
        """Send a request and return the answer's protocol data unit; `wake` as in `drivers.lines.channel`."""

    def quieten(self, silence_s: float, wake: int | None) -> None:
        """Discard received bytes until the line has been silent for `silence_s`."""

    def close(self) -> None:
        """Close the connection; harmless when repeated."""


class TcpWire:
    """Modbus TCP."""

    numbered = True

    def __init__(self, channel: Channel) -> None:
        self._channel = channel
        self._clock = SystemClock()
        self._transaction = 0
        self._buffer = b""

    def ask(self, unit: int, pdu: bytes, timeout_s: float, wake: int | None) -> bytes:
        """Send a request and return the answer's protocol data unit.

        Raises
        ------
        SilenceError, OvertakenError, ForeignAnswerError
        """
        self._transaction = (self._transaction + 1) % 2**16
        deadline_s = self._clock.now_s() + timeout_s
        self._channel.send(struct.pack(">HHHB", self._transaction, 0, len(pdu) + 1, unit) + pdu)
        while True:
            while (message := self._next()) is None:
                if not (data := self._channel.receive(deadline_s, wake)):
                    raise SilenceError(f"the part {shown(self._buffer)}" if self._buffer else "none")
                self._buffer += data
            transaction, answering, answer = message
            if transaction == self._transaction:
                if answering != unit:
                    raise ForeignAnswerError(f"an answer of unit {unit}", f"one of unit {answering}")
                return answer
            # an answer to an earlier request is discarded; the deadline limits how many
            if self._clock.now_s() > deadline_s:
                raise SilenceError("answers to other requests")

    def _next(self) -> tuple[int, int, bytes] | None:
        """Take one complete message from the buffer: transaction, unit, protocol data unit."""
        if len(self._buffer) < 7:
            return None
        transaction, protocol, length, unit = struct.unpack(">HHHB", self._buffer[:7])
        if protocol != 0 or not 2 <= length <= PDU_MAX + 1:
            raise ForeignAnswerError("a Modbus TCP message", shown(self._buffer[:7]))
        if len(self._buffer) < 6 + length:
            return None
        answer, self._buffer = self._buffer[7 : 6 + length], self._buffer[6 + length :]
        return transaction, unit, answer

    def quieten(self, silence_s: float, wake: int | None) -> None:
        """Do nothing: a late answer is recognised by its number."""

    def close(self) -> None:
        """Close the connection; harmless when repeated."""
        self._channel.close()


class RtuWire:
    """Modbus RTU, on a serial port or through a gateway that passes its frames over TCP.

    Parameters
    ----------
    channel : Channel
    baud : int, optional
        For the silent interval between frames; None if a gateway keeps the interval.
    clock : Clock, optional
        The system's clock by default.
    """

    numbered = False

    def __init__(self, channel: Channel, baud: int | None, clock: Clock | None = None) -> None:
        self._channel = channel
        self._clock = clock or SystemClock()
        self._character_s = BITS_PER_CHARACTER / baud if baud else 0.0
        self._gap_s = max(GAP_MIN_S, GAP_CHARACTERS * self._character_s) if baud else 0.0
        self._busy_until_s = 0.0

    def ask(self, unit: int, pdu: bytes, timeout_s: float, wake: int | None) -> bytes:
        """Send a request and return the answer's protocol data unit.

        Raises
        ------
        SilenceError, OvertakenError, ForeignAnswerError
        """
        self._channel.discard()
        # the device needs the gap to recognise a new frame, also after an interrupted frame
        self._clock.sleep(min(self._busy_until_s - self._clock.now_s(), self._gap_s))
        frame = bytes([unit]) + pdu
        self._channel.send(frame + crc(frame))
        sent_s = self._clock.now_s() + (len(frame) + 2) * self._character_s
        self._busy_until_s = sent_s + self._gap_s
        answer = self._receive(sent_s + timeout_s, wake)
        self._busy_until_s = self._clock.now_s() + self._gap_s
        if crc(answer[:-2]) != answer[-2:]:
            raise DamagedError(f"the damaged frame {shown(answer)}")
        if answer[0] != unit:
            raise ForeignAnswerError(f"an answer of unit {unit}", f"one of unit {answer[0]}")
        return answer[1:-2]

    def _receive(self, deadline_s: float, wake: int | None) -> bytes:
        buffer = b""
        while (size := _frame_size(buffer)) is None or len(buffer) < size:
            if not (data := self._channel.receive(deadline_s, wake)):
                raise SilenceError(f"the part {shown(buffer)}" if buffer else "none")
            buffer += data
        frame = buffer[:size]
        # a repeated identical frame is harmless; two different frames are ambiguous
        if buffer != (frame * (len(buffer) // size + 1))[: len(buffer)]:
            raise DamagedError(f"more than one frame, {shown(buffer)}")
        return frame

    def quieten(self, silence_s: float, wake: int | None) -> None:
        """Discard received bytes until the line has been silent for `silence_s`.

        Raises
        ------
        SilenceError
            If the line does not become silent.
        OvertakenError
        """
        end_s = self._clock.now_s() + QUIET_ATTEMPTS * silence_s
        while self._channel.receive(self._clock.now_s() + silence_s, wake):
            if self._clock.now_s() > end_s:
                raise SilenceError("other bytes all the time")

    def close(self) -> None:
        """Close the connection; harmless when repeated."""
        self._channel.close()


def _frame_size(start: bytes) -> int | None:
    """Length of the frame beginning with `start`, with unit and checksum; None if `start` is too short."""
    if len(start) < 3:
        return None
    function = start[1]
    if function & EXCEPTION_BIT:
        return 5
    if function in (READ_HOLDING, READ_INPUT):
        return 5 + start[2]
    if function in (WRITE_ONE, WRITE_MANY):
        return 8
    raise ForeignAnswerError("the answer to a read or a write", shown(start))
