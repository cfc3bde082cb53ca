"""Send Modbus messages over TCP or a serial line. Each request is followed by its answer.

Sources: MODBUS Messaging on TCP/IP Implementation Guide V1.0b, chapter 3.1.3; MODBUS over Serial Line V1.02,
chapters 2.5.1 (frames, silent intervals) and 6.2.2 (CRC).
"""

import math
import struct
from collections.abc import Sequence
from typing import Protocol

from drivers.clock import Clock, SystemClock
from drivers.lines.channel import Channel
from drivers.load_frames.modbus.bus.pdu import (
    EXCEPTION_BIT,
    READ_COILS,
    READ_DISCRETE,
    READ_HOLDING,
    READ_INPUT,
    WRITES,
    ForeignAnswerError,
    crc,
    shown,
)

# On the line a byte has 11 bits: a start bit, eight data bits, and a parity and a stop bit or two stop bits.
BITS_PER_CHARACTER = 11
GAP_CHARACTERS = 3.5
# Above 19 200 baud the specification gives a fixed time for the gap between frames.
GAP_MIN_S = 0.00175
PDU_MAX = 253
TCP_HEADER = 7
# If a line is not silent within this multiple of the required silence, other devices are sending on it.
QUIET_ATTEMPTS = 10
# After this time, in seconds, without an answer, the device counts as having lost the request. The request
# sent next may collide with a late answer on two-wire RS-485. This is accepted. A master may send again after
# its reply timeout if it keeps the silent interval of 3.5 characters (MODBUS over Serial Line V1.02, chapter
# 2.4.1). The checksum shows a message that a collision has damaged. So a reading may fail after a collision,
# but it never gives a wrong value.
OWED_AGAIN_S = 0.12


class SilenceError(Exception):
    """No complete answer came in time. The text of the error describes the received data."""


class DamagedError(SilenceError):
    """The data received in time are not exactly one valid answer."""


class Wire(Protocol):
    """Interface of a connection over which requests are sent to a device."""

    numbered: bool  # True if each answer contains the number of its request

    def ask(
        self, unit: int, pdu: bytes, timeout_s: float, wake: int | None, again_s: float = math.inf
    ) -> bytes:
        """Send a request and return the answer's protocol data unit. The descriptor `wake` ends the wait.

        If answers have numbers, the request is sent again after `again_s` seconds without an answer.
        """

    def quieten(self, silence_s: float, wake: int | None) -> None:
        """Discard received bytes until the line has been silent for `silence_s` seconds."""

    def close(self) -> None:
        """Close the connection. A repeated call has no effect."""


class TcpWire:
    """Connection for Modbus TCP, where each answer has the number of its request."""

    numbered = True

    def __init__(self, channel: Channel) -> None:
        self._channel = channel
        self._clock = SystemClock()
        self._transaction = 0
        self._buffer = b""

    def ask(
        self, unit: int, pdu: bytes, timeout_s: float, wake: int | None, again_s: float = math.inf
    ) -> bytes:
        """Send a request and return the answer's protocol data unit.

        If no answer comes for `again_s` seconds, the request is sent again. Then the answer to either of the
        two requests is returned. May raise `SilenceError`, `OvertakenError` or `ForeignAnswerError`.
        """
        begun_s = self._clock.now_s()
        deadline_s, repeat_s = begun_s + timeout_s, begun_s + again_s
        ours = {self._post(unit, pdu)}
        while True:
            while (message := self._next()) is None:
                if data := self._channel.receive(min(deadline_s, repeat_s), wake):
                    self._buffer += data
                elif repeat_s < deadline_s:
                    repeat_s = math.inf
                    ours.add(self._post(unit, pdu))
                else:
                    raise SilenceError(f"the part {shown(self._buffer)}" if self._buffer else "none")
            transaction, answering, answer = message
            if transaction in ours:
                if answering != unit:
                    raise ForeignAnswerError(f"an answer of unit {unit}", f"one of unit {answering}")
                return answer
            # Discard an answer to an earlier request. The deadline limits how long such answers are
            # discarded.
            if self._clock.now_s() > deadline_s:
                raise SilenceError("answers to other requests")

    def _post(self, unit: int, pdu: bytes) -> int:
        """Send a request with a new number, and return the number."""
        self._transaction = (self._transaction + 1) % 2**16
        self._channel.send(struct.pack(">HHHB", self._transaction, 0, len(pdu) + 1, unit) + pdu)
        return self._transaction

    def _next(self) -> tuple[int, int, bytes] | None:
        """Remove one complete message from the buffer. Return transaction, unit and protocol data unit."""
        if len(self._buffer) < TCP_HEADER:
            return None
        transaction, protocol, length, unit = struct.unpack(">HHHB", self._buffer[:TCP_HEADER])
        if protocol != 0 or not 2 <= length <= PDU_MAX + 1:
            raise ForeignAnswerError("a Modbus TCP message", shown(self._buffer[:TCP_HEADER]))
        if len(self._buffer) < 6 + length:
            return None
        answer, self._buffer = self._buffer[7 : 6 + length], self._buffer[6 + length :]
        return transaction, unit, answer

    def quieten(self, silence_s: float, wake: int | None) -> None:
        """Do nothing, because a late answer is recognised by its number."""

    def close(self) -> None:
        """Close the connection. A repeated call has no effect."""
        self._channel.close()


def silent_interval_s(baud: int) -> float:
    """Return the time, in seconds, for which a serial line must be silent between two frames."""
    return max(GAP_MIN_S, GAP_CHARACTERS * BITS_PER_CHARACTER / baud)


class RtuWire:
    """Connection for Modbus RTU, on a serial port or through a gateway that passes the frames over TCP.

    `baud` is the baud rate, from which the silent interval between frames is computed. None if a gateway
    inserts the silent interval. `clock` is the clock for deadlines and silent intervals. The default is the
    system's clock.
    """

    numbered = False

    def __init__(self, channel: Channel, baud: int | None, clock: Clock | None = None) -> None:
        self._channel = channel
        self._clock = clock or SystemClock()
        self._character_s = BITS_PER_CHARACTER / baud if baud else 0.0
        self._gap_s = silent_interval_s(baud) if baud else 0.0
        self._busy_until_s = 0.0
        self._sent = b""

    def ask(
        self, unit: int, pdu: bytes, timeout_s: float, wake: int | None, again_s: float = math.inf
    ) -> bytes:
        """Send a request once, even if `again_s` is given, and return the answer's protocol data unit.

        May raise `SilenceError`, `OvertakenError` or `ForeignAnswerError`.
        """
        del again_s
        self._channel.discard()
        answer = self._receive(self._post(unit, pdu) + timeout_s, wake)
        self._busy_until_s = self._clock.now_s() + self._gap_s
        return _checked(answer, unit)

    def owed(
        self, unit: int, proofs: Sequence[tuple[bytes, bytes]], timeout_s: float, wake: int | None
    ) -> list[bytes]:
        """Send a request whose answer is known. Return all answers that come before this answer.

        A device answers in the order of the requests. So the returned answers are late answers to earlier
        requests, and no more of them can come. A busy device may lose the request. Then the second request of
        `proofs` is sent, whose answer must differ from the answer to the first one. Otherwise a device whose
        answers always come one request late would not be noticed.

        `proofs` has one or two requests and their known answers, as protocol data units. May raise
        `SilenceError`, `OvertakenError` or `ForeignAnswerError`.
        """
        left = list(proofs)
        request, known = left.pop(0)
        passed: list[bytes] = []
        found: list[bytes] = []
        buffer = b""
        deadline_s = self._post(unit, request) + timeout_s
        again_s = self._clock.now_s() + OWED_AGAIN_S if left else math.inf
        while True:
            size = _frame_size(buffer)
            if size is not None and len(buffer) >= size:
                answer, buffer = _checked(buffer[:size], unit), buffer[size:]
                if answer == known:
                    self._busy_until_s = self._clock.now_s() + self._gap_s
                    return found
                if answer not in passed:
                    found.append(answer)
            elif data := self._channel.receive(min(deadline_s, again_s), wake):
                buffer += data
            elif left and not buffer and self._clock.now_s() < deadline_s:
                passed.append(known)
                request, known = left.pop(0)
                self._post(unit, request)
                again_s = math.inf
            else:
                raise SilenceError(f"the part {shown(buffer)}" if buffer else "none")

    def _post(self, unit: int, pdu: bytes) -> float:
        """Send a request, and return the time at which its last byte is on the line."""
        # Wait for the silent interval, which marks a new frame, also after an interrupted frame.
        self._clock.sleep(min(self._busy_until_s - self._clock.now_s(), self._gap_s))
        frame = bytes([unit]) + pdu
        self._sent = frame + crc(frame)
        self._channel.send(self._sent)
        sent_s = self._clock.now_s() + (len(frame) + 2) * self._character_s
        self._busy_until_s = sent_s + self._gap_s
        return sent_s

    def _receive(self, deadline_s: float, wake: int | None) -> bytes:
        buffer = b""
        while (size := _frame_size(buffer)) is None or len(buffer) < size or self._may_be_echo(buffer[:size]):
            if not (data := self._channel.receive(deadline_s, wake)):
                self._require_no_echo(buffer)
                raise SilenceError(f"the part {shown(buffer)}" if buffer else "none")
            buffer += data
        self._require_no_echo(buffer)
        frame = buffer[:size]
        # A repeated, identical answer is harmless. If two answers differ, nobody knows which one is right.
        if buffer != (frame * (len(buffer) // size + 1))[: len(buffer)]:
            raise DamagedError(f"more than one frame, {shown(buffer)}")
        return frame

    def _may_be_echo(self, frame: bytes) -> bool:
        """Return whether a damaged frame is rather the beginning of the request, which the line returns."""
        begins = len(frame) < len(self._sent) and self._sent.startswith(frame)
        return begins and crc(frame[:-2]) != frame[-2:]

    def _require_no_echo(self, buffer: bytes) -> None:
        """Raise an error if the line returns a request to read, which is no answer to it."""
        if self._sent[1] not in WRITES and buffer.startswith(self._sent):
            raise DamagedError("its own request: the adapter echoes, so set echo = true in the rig file")

    def quieten(self, silence_s: float, wake: int | None) -> None:
        """Discard received bytes until the line has been silent for `silence_s` seconds.

        Raise `SilenceError` if the line does not become silent. May also raise `OvertakenError`.
        """
        end_s = self._clock.now_s() + QUIET_ATTEMPTS * silence_s
        while self._channel.receive(self._clock.now_s() + silence_s, wake):
            if self._clock.now_s() > end_s:
                raise SilenceError("other bytes without a pause")

    def close(self) -> None:
        """Close the connection. A repeated call has no effect."""
        self._channel.close()


def _checked(frame: bytes, unit: int) -> bytes:
    """Return the protocol data unit of a frame whose checksum and unit are right."""
    if crc(frame[:-2]) != frame[-2:]:
        raise DamagedError(f"the damaged frame {shown(frame)}")
    if frame[0] != unit:
        raise ForeignAnswerError(f"an answer of unit {unit}", f"one of unit {frame[0]}")
    return frame[1:-2]


def _frame_size(start: bytes) -> int | None:
    """Return the length in bytes of the frame that begins with `start`, or None if `start` is too short."""
    if len(start) < 3:
        return None
    function = start[1]
    if function & EXCEPTION_BIT:
        return 5
    if function in (READ_COILS, READ_DISCRETE, READ_HOLDING, READ_INPUT):
        return 5 + start[2]
    if function in WRITES:
        return 8
    raise ForeignAnswerError("the answer to a read or a write", shown(start))
