"""Driver for the inputs of a Modbus module as channels: voltages, counters, contacts.

The module has no clock, so each sample is asked for when it is due. The due times are a fixed grid that
begins with the first reading. A sample has the number of its due time, and is asked for between this due time
and the next one. If the computer is busy and a due time has passed by then, no sample is asked for late in
its place: its number is missing. So is the number of a sample whose answer was lost, because a repeated
request would measure at another time.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, Self

import numpy as np
from pydantic import Field, ValidationError, model_validator

from drivers.channels.settings import ChannelSettings, SignalSettings
from drivers.clock import Event, SystemClock
from drivers.errors import DeviceTimeout, LinkLost
from drivers.interfaces import DeviceInfo, OpenContext
from drivers.lines.addresses import resolve_address
from drivers.lines.call_time import CallTime
from drivers.load_frames.modbus.bus.address import ModbusAddress, ModbusPlaceSettings
from drivers.load_frames.modbus.bus.link import ModbusLink
from drivers.load_frames.modbus.registers.registers import Register, WordOrder
from drivers.registry import DriverSpec
from drivers.settings import mistakes_in
from drivers.signals import Samples, Signal

BITS = ("discrete", "coil")
BITS_MAX = 2000
"""Largest number of contacts in one request."""
Table = Literal["input", "holding", "discrete", "coil"]


class ModbusSignal(SignalSettings):
    """One signal of a Modbus module: its input, and the kind of number in its registers."""

    input: int = Field(ge=0, le=0xFFFF, description="address of the input in the request, counted from 0")
    # ``input`` (Modbus function 4) or ``holding`` (3) for registers; ``discrete`` (2) or ``coil`` (1) for a
    # contact, whose value is 0 or 1
    table: Table = "input"
    type: Literal["u16", "i16", "u32", "i32", "f32"] = "u16"
    word_order: WordOrder = Field(default="ABCD", description="order of the four bytes of a 32-bit number")
    # numbers that mean "no value", such as -9999 or 0x7FFF; signed numbers for a signed type
    invalid: list[int] = Field(default_factory=list, max_length=16)

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.table in BITS and self.model_fields_set & {"type", "word_order", "invalid"}:
            raise ValueError("type, word_order and invalid belong to a register; remove them for a contact")
        try:
            end = self.input + self.register.size
        except ValidationError as error:
            raise ValueError("; ".join(mistakes_in(error))) from None
        if end > 0x10000:
            raise ValueError(f"input {self.input} is the last register, and {self.type} takes two")
        return self

    @cached_property
    def register(self) -> Register:
        """The registers of this signal. A contact counts as one register."""
        return Register(address=self.input, type=self.type, invalid=self.invalid)

    def decode(self, words: list[int]) -> float:
        """Return the number in the registers; NaN if it means that there is no value."""
        try:
            return float(self.register.decode(words, self.word_order))
        except ValueError:
            return math.nan


class ModbusChannelsSettings(ModbusPlaceSettings, ChannelSettings):
    """Settings of a Modbus module whose inputs are channels."""

    signals: Mapping[str, ModbusSignal] = Field(min_length=1, max_length=64)
    rate_hz: float = Field(ge=0.01, le=2000, description="samples per second")
    reply_timeout_s: float = Field(default=0.5, gt=0, le=10)
    request_max: int = Field(
        default=125, ge=2, le=125, description="largest number of registers in a request"
    )
    # registers without a signal that one request may read over, to save a request. 0 reads no register
    # that the rig file does not name, because a module may refuse it, or clear a counter that is read.
    gap_max: int = Field(default=0, ge=0, le=123)

    def requests(self) -> "list[_Request]":
        """Return the fewest requests that read all signals."""
        found: list[_Request] = []
        for each in sorted(self.signals.values(), key=lambda each: (each.table, each.input)):
            end = each.register.end
            last = found[-1] if found else None
            most = BITS_MAX if each.table in BITS else self.request_max
            if (
                last is not None
                and last.table == each.table
                and each.input <= last.end + self.gap_max
                and end - last.address <= most
            ):
                found[-1] = _Request(last.table, last.address, max(end, last.end))
            else:
                found.append(_Request(each.table, each.input, end))
        return found


@dataclass(frozen=True)
class _Request:
    """Consecutive registers or contacts of a table, from `address` to the one before `end`."""

    table: str
    address: int
    end: int

    def words(self, signal: ModbusSignal, found: list[int]) -> list[int] | None:
        """Return the registers of a signal from the answer, or None if they are not all in it."""
        if signal.table != self.table or not self.address <= signal.input < signal.register.end <= self.end:
            return None
        return found[signal.input - self.address : signal.register.end - self.address]


class ModbusChannels:
    """The inputs of a Modbus module. To construct this class, call `open_channels`."""

    def __init__(
        self,
        settings: ModbusChannelsSettings,
        context: OpenContext,
        link: ModbusLink,
        call_time: CallTime,
    ) -> None:
        self._settings, self._clock = settings, context.clock
        self._link, self._call_time = link, call_time
        self._requests = settings.requests()
        self._closed = Event()
        # answers come in real time, also if the clock of the rig is simulated
        self._real = SystemClock()
        self._begun_s: float | None = None
        self._next = 0
        self.signals: tuple[Signal, ...] = settings.declared
        self.rate_hz = settings.rate_hz
        self.info = DeviceInfo(
            vendor="Modbus",
            model=f"inputs of unit {settings.unit}",
            serial="",
            simulated=settings.address.startswith("@"),
        )

    def read(self, timeout_s: float) -> Samples:
        """Wait until the next sample is due, read all signals, and return the sample.

        If the module does not answer within `reply_timeout_s`, or the connection is gone, this sample is
        lost, and the next one is read. Raise the error of the last attempt, `DeviceTimeout` or `LinkLost`, if
        no sample could be read within `timeout_s`; the last answer has `reply_timeout_s` all the same. Raise
        `DeviceFault` if the module refuses the request.
        """
        begun_s, really_begun_s = self._clock.now_s(), self._real.now_s()
        while True:
            number = self._wait_for_due(begun_s, timeout_s)
            self._next = number + 1
            try:
                return self._sample(number)
            except (DeviceTimeout, LinkLost):
                too_late = self._due_s(self._next) > begun_s + timeout_s
                if too_late or self._real.now_s() >= really_begun_s + timeout_s or self._closed.is_set():
                    raise

    def _sample(self, number: int) -> Samples:
        asked_s = self._clock.now_s()
        with self._call_time.call(self._settings.reply_timeout_s):
            inputs = self.inputs()
        received_s = self._clock.now_s()
        return Samples(self._settings.in_units(np.array([inputs])), number, received_s, asked_s)

    def inputs(self) -> list[float]:
        """Return the numbers of all inputs now, without their scales."""
        words: dict[str, list[int]] = {}
        for request in self._requests:
            found = self._link.read(request.table, request.address, request.end - request.address)
            for name, signal in self._settings.signals.items():
                if (own := request.words(signal, found)) is not None:
                    words[name] = own
        return [signal.decode(words[name]) for name, signal in self._settings.signals.items()]

    def _wait_for_due(self, begun_s: float, timeout_s: float) -> int:
        """Wait until a sample is due, and return its number."""
        if self._begun_s is None:
            self._begun_s = begun_s
        now_s, due_s = self._clock.now_s(), self._due_s(self._next)
        if due_s > begun_s + timeout_s:
            self._clock.wait(self._closed, begun_s + timeout_s - now_s)
            raise self._not_due(due_s - begun_s, timeout_s)
        if due_s > now_s:
            self._clock.wait(self._closed, due_s - now_s)
        if self._closed.is_set():
            raise LinkLost(self._link.name, "read", "an open device", "a closed one", "open it again")
        # The clock may wake a little before the due time, because its seconds are rounded.
        passed = math.floor((self._clock.now_s() - self._begun_s) * self.rate_hz)
        return max(self._next, passed)

    def _due_s(self, number: int) -> float:
        return (self._begun_s or 0.0) + number / self.rate_hz

    def _not_due(self, wait_s: float, timeout_s: float) -> DeviceTimeout:
        return DeviceTimeout(
            self._link.name,
            "read",
            f"a sample within {timeout_s:.3g} s",
            f"the next one due in {wait_s:.3g} s, at {self.rate_hz:g} Hz",
            "allow more time than one period, or raise rate_hz",
        )

    def close(self) -> None:
        """Close the connection. A repeated call has no effect."""
        self._closed.set()
        self._link.close()


def open_channels(settings: ModbusChannelsSettings, context: OpenContext) -> ModbusChannels:
    """Connect to the module and read all inputs once. Raise `DeviceError` if this fails."""
    address = resolve_address(settings.address, context)
    place = ModbusAddress(address, settings.baud, settings.parity, settings.stop_bits, context.relay)
    call_time = CallTime(context.call_timeout_s, patience_s=context.patience_s)
    link = ModbusLink(
        f"{context.name} ({address})", place, settings.unit, settings.reply_timeout_s, call_time=call_time
    )
    try:
        device = ModbusChannels(settings, context, link, call_time)
        with call_time.opening(settings.reply_timeout_s):
            device.inputs()
    except BaseException:
        link.close()
        raise
    return device


SPEC = DriverSpec(kind="channels", settings=ModbusChannelsSettings, open=open_channels)
