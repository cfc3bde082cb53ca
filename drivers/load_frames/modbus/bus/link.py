"""Modbus requests with answers that can be believed.

Every answer is compared with its request. Nothing that writes is ever repeated here. Where answers carry no
number (RTU), a line on which one is missing stays quiet until none can be late any more. Then, and on every
new connection, it proves by a known answer that the machine is the same, before anything but a hold goes out.
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
    """Something urgent went first; the device may have acted on the request all the same."""


class ModbusLink:
    """One connection with one request in flight; made when first needed, and again after it was lost.

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
        At most so much of it is for connecting, a wait that nothing urgent can end, and for what is urgent,
        which is repeated rather than waited for.
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
        """Name registers that never change, and what they hold: by them the machine is known again."""
        self._proof = read_request(table, address, len(words)), words

    def read(self, table: str, address: int, count: int, *, urgent: bool = False) -> list[int]:
        """Return `count` registers of the `input` or `holding` table; repeated once, for reading is harmless.

        Parameters
        ----------
        urgent : bool
            Go first, and end the wait of whoever else uses this link.

        Raises
        ------
        DeviceTimeout, LinkLost
            If no answer, or none that belongs to the request, came.
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
            Go first, and end the wait of whoever else uses this link.
        single : bool
            Write the one register by function 6 instead of 16.

        Raises
        ------
        DeviceTimeout, LinkLost
            If it was not acknowledged. The device may have taken it all the same: read back and decide.
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
                # that was the late answer, come with the proof
                self._resynchronise()
            self._suspect = False
        return self._ask(request, self._reply_timeout_s, self._turn.wake)

    def _resynchronise(self) -> None:
        """Wait until no answer can be late any more, and read what is known."""
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
        """Turn what can go wrong on the wire into an error of this device."""
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
        """See that a late answer cannot be taken for the next one's: reconnect, or wait before going on."""
        if self._wire is not None and self._wire.numbered:
            self._drop()
        else:
            self._suspect = True
        return error

    def _drop(self) -> None:
        wire, self._wire = self._wire, None
        # somebody else may be there next time, and on a line late answers come over a new connection too
        self._suspect = True
        if wire is not None:
            wire.close()
