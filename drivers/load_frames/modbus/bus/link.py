"""Modbus requests with verified answers.

Every answer is compared with its request. This module never repeats a write. RTU answers have no number:
after a missing answer the link sends nothing until no late answer can come any more. Then, and on every new
connection, the link reads known registers to prove that the machine is the same. Only a hold is sent earlier.
"""

from collections.abc import Callable
from typing import TypeVar

from drivers.errors import DeviceError, DeviceFault, DeviceTimeout, LinkLost
from drivers.lines.channel import CHANNEL_ERRORS, OvertakenError
from drivers.lines.request_turn import Turn
from drivers.lines.stop_deadline import STOP_TIMES
from drivers.load_frames.modbus.bus.address import ModbusAddress
from drivers.load_frames.modbus.bus.pdu import (
    NOBODY,
    ExceptionAnswerError,
    ForeignAnswerError,
    Request,
    read_request,
    write_one_request,
    write_request,
)
from drivers.load_frames.modbus.bus.wire import DamagedError, SilenceError, Wire

READ_ATTEMPTS = 2

T = TypeVar("T")


class Overtaken(DeviceTimeout):
    """An urgent request went first; the device may have executed this request nevertheless."""


class ModbusLink:
    """A connection with one request at a time; opened at the first request and again after a loss.

    Parameters
    ----------
    name : str
        The device's name and address, for messages.
    address : ModbusAddress
    unit : int
        The unit identifier behind that address.
    reply_timeout_s : float
        Deadline for an answer; real time.
    urgent_timeout_s : float
        Upper limit for connecting and for urgent requests. An urgent request cannot end the wait for a
        connection, and the caller repeats an urgent request instead of waiting longer.
    """

    def __init__(
        self,
        name: str,
        address: ModbusAddress,
        unit: int,
        reply_timeout_s: float,
        urgent_timeout_s: float = STOP_TIMES.answer_s,
    ) -> None:
        self.name = name
        self._address, self._unit = address, unit
        self._reply_timeout_s = reply_timeout_s
        self._urgent_timeout_s = min(reply_timeout_s, urgent_timeout_s)
        self._turn = Turn()
        self._wire: Wire | None = None
        self._suspect = False
        self._proof: tuple[Request, list[int]] | None = None
        self._closed = False

    def prove_by(self, table: str, address: int, words: list[int]) -> None:
        """Name registers that never change and their content, which identify the machine later."""
        self._proof = read_request(table, address, len(words)), words

    def read(self, table: str, address: int, count: int, *, urgent: bool = False) -> list[int]:
        """Return `count` registers of the `input` or `holding` table; a failed read is repeated once.

        Parameters
        ----------
        urgent : bool
            Go first, and end the wait of all other users of this link.

        Raises
        ------
        DeviceTimeout, LinkLost
            If no answer came, or the answer does not belong to the request.
        DeviceFault
            If the device answered with an exception.
        """
        request = read_request(table, address, count)
        failures = 0
        while True:
            try:
                return self._exchange(request, urgent)
            except Overtaken:
                continue
            except (DeviceTimeout, LinkLost):
                failures += 1
                if failures == READ_ATTEMPTS:
                    raise

    def write(self, address: int, words: list[int], *, urgent: bool = False, single: bool = False) -> None:
        """Write holding registers in one request; never repeated.

        Parameters
        ----------
        urgent : bool
            Go first, and end the wait of all other users of this link.
        single : bool
            Write the one register by function 6 instead of 16.

        Raises
        ------
        DeviceTimeout, LinkLost
            If the device did not acknowledge the request. It may have executed the request nevertheless: read
            the registers back, then decide.
        DeviceFault
            If the device answered with an exception.
        """
        self._exchange(
            write_one_request(address, words[0]) if single else write_request(address, words), urgent
        )

    def close(self) -> None:
        """Close the connection; harmless when repeated."""
        with self._turn.urgent():
            self._closed = True
            self._drop()
        self._turn.close()

    def _exchange(self, request: Request, urgent: bool) -> list[int]:
        if urgent:
            with self._turn.urgent():
                timeout_s = self._urgent_timeout_s
                return self._told(request, timeout_s, lambda: self._ask(request, timeout_s, None))
        with self._turn.ordinary():
            return self._told(request, self._reply_timeout_s, lambda: self._ask_in_turn(request))

    def _ask_in_turn(self, request: Request) -> list[int]:
        if self._suspect:
            try:
                self._resynchronise()
            except (DamagedError, ForeignAnswerError):
                # this was the late answer, received instead of the proof
                self._resynchronise()
            self._suspect = False
        return self._ask(request, self._reply_timeout_s, self._turn.wake)

    def _resynchronise(self) -> None:
        """Wait until no late answer can come any more, then read the known registers."""
        self._connected().quieten(self._reply_timeout_s, self._turn.wake)
        if self._proof is not None:
            request, known = self._proof
            found = self._ask(request, self._reply_timeout_s, self._turn.wake)
            if found != known:
                raise ForeignAnswerError(f"the machine with {known} in its identity", f"one with {found}")

    def _ask(self, request: Request, timeout_s: float, wake: int | None) -> list[int]:
        answer = self._connected().ask(self._unit, request.pdu, timeout_s, wake)
        return request.registers(answer)

    def _connected(self) -> Wire:
        if self._closed:
            raise ConnectionAbortedError("the link was closed")
        if self._wire is None:
            self._wire = self._address.open(self._urgent_timeout_s)
        return self._wire

    def _told(self, request: Request, timeout_s: float, ask: Callable[[], T]) -> T:
        """Turn failures on the wire into errors of this device."""
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
            self._suspect = True
            raise Overtaken(
                self.name,
                step,
                "an answer",
                "a hold that went first",
                "look what the machine does, then repeat it if it is wanted",
            ) from None
        except SilenceError as silence:
            raise self._distrust(
                DeviceTimeout(
                    self.name,
                    step,
                    f"an answer within {timeout_s:g} s",
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
        """Prevent the use of a late answer for the next request: reconnect, or wait before it."""
        if self._wire is not None and self._wire.numbered:
            self._drop()
        else:
            self._suspect = True
        return error

    def _drop(self) -> None:
        wire, self._wire = self._wire, None
        # a different machine may answer next time, and RTU answers can be late on a new connection too
        self._suspect = True
        if wire is not None:
            wire.close()
