"""Driver for one input of a Modbus module: a contact, for example on a door, or a measured value."""

from typing import Literal, Self

from pydantic import Field, model_validator

from drivers.errors import DeviceFault
from drivers.interfaces import DeviceInfo, InterlockState, OpenContext
from drivers.lines.addresses import resolve_address
from drivers.lines.call_time import CallTime, one_call
from drivers.load_frames.modbus.bus.address import ModbusAddress, ModbusPlaceSettings
from drivers.load_frames.modbus.bus.link import ModbusLink
from drivers.registry import DriverSpec

_BITS = ("discrete", "coil")


class ModbusInputSettings(ModbusPlaceSettings):
    """Settings of one input: the address of the Modbus module, and the table and number of the input."""

    # ``discrete`` (Modbus function 2) or ``coil`` (1) for a contact, whose value is 0 or 1; ``input``
    # (function 4) or ``holding`` (3) for a register with a number
    table: Literal["discrete", "coil", "input", "holding"] = "discrete"
    number: int = Field(ge=0, le=65_535)  # address of the input in the request, counted from 0
    signed: bool = False  # True if the register is a signed number
    # numbers of a register that mean "no value", such as 0x7FFF for a broken wire. For a signed register,
    # write them as signed numbers.
    invalid: list[int] = Field(default_factory=list, max_length=16)
    # the value of a register is its number × scale + offset
    scale: float = 1.0
    offset: float = 0.0
    # unit of the value, shown to the user, or an empty text for a contact
    quantity: str = Field(default="", max_length=20)
    reply_timeout_s: float = Field(default=0.5, gt=0, le=10)

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.table in _BITS and self.model_fields_set & {"signed", "invalid", "scale", "offset"}:
            raise ValueError(
                "signed, invalid, scale and offset belong to a register; remove them for a contact"
            )
        lowest, highest = (-0x8000, 0x7FFF) if self.signed else (0, 0xFFFF)
        if beyond := [number for number in self.invalid if not lowest <= number <= highest]:
            raise ValueError(f"invalid has {beyond[0]}, expected numbers from {lowest} to {highest}")
        return self


class ModbusInput:
    """One input of a Modbus module. To construct this class, call `open_input`."""

    def __init__(
        self, settings: ModbusInputSettings, context: OpenContext, link: ModbusLink, call_time: CallTime
    ) -> None:
        self._call_time = call_time
        self._settings = settings
        self._clock = context.clock
        self._link = link
        self.unit = settings.quantity
        self.info = DeviceInfo(
            vendor="Modbus",
            model=f"{settings.table} {settings.number} of unit {settings.unit}",
            serial="",
            simulated=settings.address.startswith("@"),
        )

    @one_call
    def read(self) -> InterlockState:
        """Read the input. A failed reading is repeated once.

        Raise `DeviceError` if the module does not answer in time, refuses the request, or reports that it has
        no value.
        """
        settings = self._settings
        (number,) = self._link.read(settings.table, settings.number, 1)
        if settings.signed and number >= 0x8000:
            number -= 0x10000
        if number in settings.invalid:
            raise DeviceFault(
                self._link.name,
                f"read {settings.table} {settings.number}",
                "a value",
                f"{number}, which means that there is none",
                "check the sensor and its cable at the module",
            )
        return InterlockState(number * settings.scale + settings.offset, self._clock.now_s())

    def close(self) -> None:
        """Close the connection. A repeated call has no effect."""
        self._link.close()


def open_input(settings: ModbusInputSettings, context: OpenContext) -> ModbusInput:
    """Connect to the module and read the input once. Raise `DeviceError` if this fails."""
    address = resolve_address(settings.address, context)
    place = ModbusAddress(address, settings.baud, settings.parity, settings.stop_bits, context.relay)
    call_time = CallTime(context.call_timeout_s, patience_s=context.patience_s)
    link = ModbusLink(
        f"{context.name} ({address})", place, settings.unit, settings.reply_timeout_s, call_time=call_time
    )
    device = ModbusInput(settings, context, link, call_time)
    try:
        device.read()
    except BaseException:
        link.close()
        raise
    return device


SPEC = DriverSpec(kind="interlock", settings=ModbusInputSettings, open=open_input)
