"""Send Modbus requests to a device and verify the answers.

Every answer is compared with its request. A write request is repeated only if a second execution has no
effect. Modbus RTU answers have no number. Therefore, after a missing answer, the link reads known registers
that identify the machine. A device answers in order, so when these registers have arrived, no late answer can
come any more. After a damaged answer, the link first waits until the line is silent. On every new connection,
the link reads the known registers too. Only a hold command is sent at once, without the wait and without
reading these registers.
"""

import contextlib
import math
from collections.abc import Callable
from typing import Protocol, TypeVar

from drivers.errors import DeviceError, DeviceFault, DeviceTimeout, LinkLost
from drivers.lines.call_time import CallTime
from drivers.lines.channel import CHANNEL_ERRORS, OvertakenError
from drivers.lines.request_turn import RequestTurn
from drivers.lines.stop_deadline import STOP_TIMES
from drivers.load_frames.modbus.bus.pdu import (
    NOBODY,
    ExceptionAnswerError,
    ForeignAnswerError,
    Request,
    fewer_registers,
    known_answer,
    read_request,
    write_coil_request,
    write_one_request,
    write_request,
)
from drivers.load_frames.modbus.bus.wire import DamagedError, RtuWire, SilenceError, Wire

T = TypeVar("T")


class Address(Protocol):
    """Interface of an address at which a device is reached. Error messages contain `text`."""

    @property
    def text(self) -> str:
        """The address as written in the rig file."""

    def open(self, timeout_s: float) -> Wire:
        """Connect to the device. Raise one of `drivers.lines.channel.CHANNEL_ERRORS` if this fails."""


class Overtaken(DeviceTimeout):
    """An urgent request interrupted an ordinary request, which the device may still have executed."""


class ModbusLink:
    """A connection that carries one request at a time. The first request after a lost connection reconnects.

    `unit` is the Modbus unit identifier of the device at this address. `reply_timeout_s` is the longest wait
    for an answer, in seconds of real time. `urgent_timeout_s` is the longest time, in seconds, for
    connecting, and for the answer to an urgent request. Keep this time short, because an urgent request must
    wait for the end of an attempt to connect. `call_time` is the time left in the present call of the driver.
    """

    def __init__(
        self,
        name: str,
        address: Address,
        unit: int,
        reply_timeout_s: float,
        urgent_timeout_s: float = STOP_TIMES.answer_s,
        call_time: CallTime | None = None,
    ) -> None:
        self.name = name
        self._address, self._unit = address, unit
        self._reply_timeout_s = reply_timeout_s
        self._urgent_timeout_s = min(reply_timeout_s, urgent_timeout_s)
        self._turn = RequestTurn()
        self._wire: Wire | None = None
        self._call_time = call_time or CallTime()
        self._suspect = False
        # the latest request on Modbus RTU that has no answer yet
        self._owed: Request | None = None
        self._proof: tuple[Request, list[int]] | None = None
        self._closed = False

    def prove_by(self, table: str, address: int, words: list[int]) -> None:
        """Set the address and the content of the registers that identify the machine. The content never
        changes."""
        self._proof = read_request(table, address, len(words)), words

    def read(self, table: str, address: int, count: int, *, urgent: bool = False) -> list[int]:
        """Return `count` registers of the `input` or `holding` table. Repeat a failed read once.

        `urgent` is True to send the request before all others, and to interrupt other waits on this link.
        Raise `DeviceTimeout` or `LinkLost` if no answer came, or the answer does not belong to the request,
        and `DeviceFault` if the device answered with a Modbus exception.
        """
        request = read_request(table, address, count)
        while True:
            with contextlib.suppress(Overtaken):
                return self._repeated(request, urgent)

    def write(
        self,
        address: int,
        words: list[int],
        *,
        urgent: bool = False,
        single: bool = False,
        harmless: bool = False,
    ) -> None:
        """Write holding registers in one request.

        `urgent` is True to send the request before all others, and to interrupt other waits on this link.
        `single` is True to write a single register with Modbus function 6 instead of function 16. `harmless`
        is True if the request may be repeated after a missing answer, because a second execution has no
        effect. A request that is not harmless is never repeated. Raise `DeviceTimeout` or `LinkLost` if the
        device did not acknowledge the request. The device may still have executed the request, so the caller
        must read the registers back. Raise `DeviceFault` if the device answered with a Modbus exception.
        """
        request = write_one_request(address, words[0]) if single else write_request(address, words)
        if harmless:
            self._repeated(request, urgent)
        else:
            self._exchange(request, urgent, self._call_time.first_wait_s(self._reply_timeout_s))

    def write_coil(self, number: int, *, on: bool) -> None:
        """Switch one coil. Repeat a failed request once, because a second execution has no effect.

        The errors are those of `write`.
        """
        while True:
            with contextlib.suppress(Overtaken):
                self._repeated(write_coil_request(number, on), urgent=False)
                return

    def _repeated(self, request: Request, urgent: bool) -> list[int]:
        """Send a request that may be repeated. Raise the error of the last attempt."""
        try:
            return self._exchange(request, urgent, self._first_wait_s(), self._reply_timeout_s)
        except Overtaken:
            raise
        except (DeviceTimeout, LinkLost):
            if self._call_time.left_s == 0:
                raise
        return self._exchange(request, urgent, self._call_time.last_wait_s(self._reply_timeout_s))

    def _first_wait_s(self) -> float:
        """Return the longest wait for the answer to a request that may be repeated.

        On Modbus TCP the request is repeated within this time. On Modbus RTU the request can be repeated only
        if there are known registers, which show that no late answer can come any more.
        """
        rtu = self._wire is not None and not self._wire.numbered
        wait = self._call_time.first_wait_s if rtu and self._proof else self._call_time.last_wait_s
        return wait(self._reply_timeout_s)

    def close(self) -> None:
        """Close the connection. A repeated call has no effect."""
        with self._turn.urgent():
            self._closed = True
            self._drop()
        self._turn.close()

    def _exchange(
        self, request: Request, urgent: bool, timeout_s: float, again_s: float = math.inf
    ) -> list[int]:
        if urgent:
            with self._turn.urgent():
                timeout_s = self._urgent_timeout_s
                return self._told(request, timeout_s, lambda: self._ask(request, timeout_s, None))
        with self._turn.ordinary():
            return self._told(request, timeout_s, lambda: self._ask_in_turn(request, timeout_s, again_s))

    def _ask_in_turn(self, request: Request, timeout_s: float, again_s: float) -> list[int]:
        if self._suspect:
            if (late := self._late_answer(request)) is not None:
                return late
            if self._suspect:
                self._resynchronise_twice()
            timeout_s = min(timeout_s, self._call_time.left_s)
        return self._ask(request, timeout_s, self._turn.wake, again_s)

    def _resynchronise_twice(self) -> None:
        try:
            self._resynchronise()
        except (DamagedError, ForeignAnswerError):
            # try once more, because the received answer was a late answer to an earlier request
            self._resynchronise()
        self._suspect = False

    def _late_answer(self, request: Request) -> list[int] | None:
        """Receive the late answer on Modbus RTU. If it is the answer to `request`, return its registers.

        If no answer is missing, do nothing and return None.
        """
        owed, self._owed = self._owed, None
        if owed is None or self._proof is None or not isinstance(self._wire, RtuWire):
            return None
        proof, words = self._proof
        proofs = [(proof.pdu, known_answer(proof.pdu, words))]
        if len(words) > 1:
            fewer = fewer_registers(proof.pdu, len(words) - 1)
            proofs.append((fewer, known_answer(fewer, words[:-1])))
        wait_s = self._call_time.last_wait_s(self._reply_timeout_s)
        found = self._wire.owed(self._unit, proofs, wait_s, self._turn.wake)
        self._suspect = False
        return request.registers(found[0]) if owed is request and len(found) == 1 else None

    def _resynchronise(self) -> None:
        """Wait until no late answer can come any more, then check the registers that identify the machine."""
        quiet_s = min(self._reply_timeout_s, self._call_time.left_s / 2)
        self._connected().quieten(quiet_s, self._turn.wake)
        if self._proof is not None:
            request, known = self._proof
            wait_s = self._call_time.first_wait_s(self._reply_timeout_s)
            found = self._ask(request, wait_s, self._turn.wake)
            if found != known:
                raise ForeignAnswerError(f"the machine with {known} in its identity", f"one with {found}")

    def _ask(
        self, request: Request, timeout_s: float, wake: int | None, again_s: float = math.inf
    ) -> list[int]:
        wire, self._owed = self._connected(), request
        try:
            answer = wire.ask(self._unit, request.pdu, timeout_s, wake, again_s)
        except DamagedError:
            self._owed = None
            raise
        self._owed = None
        return request.registers(answer)

    def _connected(self) -> Wire:
        if self._closed:
            raise ConnectionAbortedError("the link was closed")
        if self._wire is None:
            self._wire = self._address.open(self._urgent_timeout_s)
        return self._wire

    def _told(self, request: Request, timeout_s: float, ask: Callable[[], T]) -> T:
        """Send a request with `ask`. Raise a `DeviceError` with the device's name if the communication
        fails."""
        step = request.step
        try:
            return ask()
        except ExceptionAnswerError as refusal:
            if refusal.code in NOBODY:
                remedy = "check the unit number, and the machine and its line behind the gateway"
                raise DeviceTimeout(
                    self.name, step, f"an answer of unit {self._unit}", str(refusal), remedy
                ) from None
            remedy = "compare the register map and the limits with the machine's manual"
            raise DeviceFault(self.name, step, "acceptance", str(refusal), remedy) from None
        except OvertakenError:
            self._suspect, self._owed = True, None
            raise Overtaken(
                self.name,
                step,
                "an answer",
                "a hold that went first",
                "check the state of the machine, then repeat the request if needed",
            ) from None
        except SilenceError as silence:
            raise self._distrust(
                DeviceTimeout(
                    self.name,
                    step,
                    f"an answer within {timeout_s:.3g} s",
                    str(silence),
                    "check that the controller runs, its unit number and the line's settings",
                )
            ) from None
        except ForeignAnswerError as stranger:
            remedy = "check that nothing else answers at this address"
            raise self._distrust(LinkLost(self.name, step, stranger.expected, stranger.got, remedy)) from None
        except CHANNEL_ERRORS as error:
            connected = self._wire is not None
            self._drop()
            raise LinkLost(
                self.name,
                step,
                "an open connection" if connected else f"a connection to {self._address.text}",
                getattr(error, "strerror", None) or str(error) or type(error).__name__,
                "check the cable, the address and that the controller runs and is free",
            ) from error

    def _distrust(self, error: DeviceError) -> DeviceError:
        """Return `error`, and prevent the next request from receiving the late answer to this request.

        On Modbus TCP the connection is closed. On Modbus RTU the next request is delayed.
        """
        if self._wire is not None and self._wire.numbered:
            self._drop()
        else:
            self._suspect = True
        return error

    def _drop(self) -> None:
        wire, self._wire = self._wire, None
        # Check the machine after reconnecting. Another machine may answer, or on RTU an old answer may come.
        self._suspect, self._owed = True, None
        if wire is not None:
            wire.close()
