"""Driver for one output of a Modbus module that gives pulses: a coil, or a register.

The driver switches the output on, reads it back, and returns. The width of the pulse is at least `width_s`,
and longer by the time of one request.
"""

from typing import Literal, Self

from pydantic import Field, model_validator

from drivers.errors import DeviceFault
from drivers.interfaces import DeviceInfo, OpenContext
from drivers.lines.addresses import resolve_address
from drivers.lines.call_time import CallTime, one_call
from drivers.lines.pulse_line import PulseLine
from drivers.load_frames.modbus.bus.address import ModbusAddress, ModbusPlaceSettings
from drivers.load_frames.modbus.bus.link import ModbusLink
from drivers.load_frames.modbus.registers.registers import Register, WordOrder
from drivers.registry import DriverSpec


class ModbusPulseSettings(ModbusPlaceSettings):
    """Settings of one output of a Modbus module that gives pulses."""

    output: int = Field(ge=0, le=0xFFFF, description="address of the output in the request, counted from 0")
    # ``coil`` is switched by Modbus function 5, ``holding`` is a register that is written by function 6, or
    # 16 for a number of 32 bits
    table: Literal["coil", "holding"] = "coil"
    type: Literal["u16", "i16", "u32", "i32", "f32"] = "u16"
    word_order: WordOrder = "ABCD"
    pulse: float = Field(default=1.0, description="value of the output during the pulse")
    rest: float = Field(default=0.0, description="value of the output at rest")
    width_s: float = Field(default=0.02, ge=0.001, le=60, description="length of the pulse")
    # False for an output that must not be read, because reading makes it an input
    readback: bool = True
    reply_timeout_s: float = Field(default=0.25, gt=0, le=10)

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.table == "coil":
            if self.model_fields_set & {"type", "word_order"}:
                raise ValueError("type and word_order belong to a register; remove them for a coil")
            if {self.pulse, self.rest} != {0.0, 1.0}:
                raise ValueError(
                    f"pulse and rest of a coil are 1 and 0 or 0 and 1, got {self.pulse:g}, {self.rest:g}"
                )
        elif self.type != "f32" and not (self.pulse.is_integer() and self.rest.is_integer()):
            raise ValueError(f"pulse and rest must be whole numbers in {self.type}")
        elif self.words(self.pulse) == self.words(self.rest):
            raise ValueError(f"pulse and rest must be different numbers in {self.type}")
        return self

    def words(self, value: float) -> list[int]:
        """Return what the registers contain, or the state of the coil, for a value of the output."""
        if self.table == "coil":
            return [int(value)]
        return Register(address=0, type=self.type).encode(value, self.word_order)


class ModbusPulse:
    """One output of a Modbus module that gives pulses. To construct this class, call `open_pulse`."""

    def __init__(
        self, settings: ModbusPulseSettings, context: OpenContext, link: ModbusLink, call_time: CallTime
    ) -> None:
        self._settings = settings
        self._link, self._call_time = link, call_time
        width_key = f"width_s = {settings.width_s:g}"
        self._line = PulseLine(link.name, context.clock, settings.width_s, width_key, self._put)
        self.info = DeviceInfo(
            vendor="Modbus",
            model=f"{settings.table} {settings.output} of unit {settings.unit}",
            serial="",
            simulated=settings.address.startswith("@"),
        )

    def rest(self) -> None:
        """Put the output into its state of rest. Raise `DeviceError` if this is not certain."""
        self._line.rest()

    @one_call
    def pulse(self) -> None:
        """Begin a pulse, read the output back, and return. The pulse ends by itself after `width_s`.

        Raise `DeviceFault` if the pulse before has not ended yet, or if it did not end in time. Raise
        `DeviceError` if the module does not confirm this pulse, which may still have been given.
        """
        self._line.pulse()

    @one_call
    def _put(self, on: bool, step: str) -> None:
        settings = self._settings
        words = settings.words(settings.pulse if on else settings.rest)
        if settings.table == "coil":
            self._link.write_coil(settings.output, on=bool(words[0]))
        else:
            self._link.write(settings.output, words, single=len(words) == 1, harmless=True)
        if not settings.readback:
            return
        found = self._link.read(settings.table, settings.output, len(words))
        if found != words:
            raise DeviceFault(
                self._link.name,
                step,
                f"{settings.table} {settings.output} to contain {words}",
                f"{found}",
                "check that nothing else writes this output, and its mode in the module",
            )

    def close(self) -> None:
        """Leave the output at rest, and close the connection. A pulse goes on for at most one second.

        Raise `DeviceError` if the output may not be at rest, or if the last pulse did not end in time. The
        connection is closed all the same. A repeated call has no effect.
        """
        try:
            self._line.close()
        finally:
            self._link.close()


def open_pulse(settings: ModbusPulseSettings, context: OpenContext) -> ModbusPulse:
    """Connect to the module and put the output at rest. Raise `DeviceError` if this fails."""
    address = resolve_address(settings.address, context)
    place = ModbusAddress(address, settings.baud, settings.parity, settings.stop_bits, context.relay)
    call_time = CallTime(context.call_timeout_s, patience_s=context.patience_s)
    link = ModbusLink(
        f"{context.name} ({address})", place, settings.unit, settings.reply_timeout_s, call_time=call_time
    )
    device = ModbusPulse(settings, context, link, call_time)
    try:
        with call_time.opening(settings.reply_timeout_s):
            device.rest()
    except BaseException:
        link.close()
        raise
    return device


SPEC = DriverSpec(kind="trigger", settings=ModbusPulseSettings, open=open_pulse)
