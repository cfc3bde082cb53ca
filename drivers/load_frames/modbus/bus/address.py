"""Address of a Modbus device: ``host:port``, ``rtu://host:port``, or the path of a serial port."""

from dataclasses import dataclass
from typing import Literal, Self

from pydantic import Field, field_validator, model_validator

from drivers.lines.channel import Channel, SerialChannel, TcpChannel, open_relay
from drivers.lines.echo import EchoedChannel
from drivers.load_frames.modbus.bus.wire import RtuWire, TcpWire, Wire
from drivers.settings import LONGEST_PATH, Settings

RTU_PREFIX = "rtu://"
# Unit 0 is excluded, because it is the broadcast address of a serial line, which no device answers.
SERIAL_UNITS = range(1, 248)


@dataclass(frozen=True)
class ModbusAddress:
    """Address of a Modbus device, and the settings of its serial line."""

    text: str  # the address as written in the rig file
    baud: int = 19_200
    parity: str = "E"  # parity of a serial port: ``N`` (none), ``E`` (even) or ``O`` (odd)
    stop_bits: int = 1  # number of stop bits of a serial port
    # address ``host:port`` of a guardian's relay to the device, or an empty text without a relay
    relay: str = ""
    echo: bool = False  # True if the adapter of an RTU line also receives what it sends

    @property
    def rtu(self) -> bool:
        """True for Modbus RTU, where a line has one master and the answers have no transaction numbers."""
        return self.serial or self.text.startswith(RTU_PREFIX)

    @property
    def serial(self) -> bool:
        """True if the address is a serial port of this computer."""
        return self.text.startswith("/")

    def open(self, timeout_s: float) -> Wire:
        """Connect to the device. Raise one of `drivers.lines.channel.CHANNEL_ERRORS` if this fails."""
        return self.wire(open_relay(self.relay, timeout_s) or self.channel(timeout_s))

    def channel(self, timeout_s: float) -> Channel:
        """Open the line to the device without a relay. The errors are those of `open`."""
        line = self._line(timeout_s)
        return EchoedChannel(line, self.baud) if self.echo else line

    def _line(self, timeout_s: float) -> Channel:
        if self.serial:
            return SerialChannel(self.text, self.baud, self.parity, self.stop_bits, timeout_s)
        host, _, port = self.text.removeprefix(RTU_PREFIX).rpartition(":")
        return TcpChannel(host.strip("[]"), int(port), timeout_s)

    def wire(self, channel: Channel) -> Wire:
        """Return the connection that sends requests on `channel`, as Modbus RTU or Modbus TCP."""
        return RtuWire(channel, self.baud if self.serial else None) if self.rtu else TcpWire(channel)


class ModbusPlaceSettings(Settings):
    """Where a Modbus device is: its address, its unit, and the settings of a serial port.

    Attributes
    ----------
    address : str
        ``host:port`` for Modbus TCP, ``rtu://host:port`` for a gateway that passes RTU frames over TCP, the
        path of a serial port for Modbus RTU, or ``@name`` for a server of the simulated rig.
    unit : int
        Modbus unit identifier of the device.
    baud, parity, stop_bits
        Settings of a serial port. The defaults are the defaults of the Modbus specification.
    """

    address: str = Field(max_length=LONGEST_PATH)
    unit: int = Field(default=1, ge=0, le=255)
    baud: int = Field(default=19_200, ge=300, le=4_000_000)
    parity: Literal["N", "E", "O"] = "E"
    stop_bits: Literal[1, 2] = 1

    @field_validator("address")
    @classmethod
    def _reachable(cls, address: str) -> str:
        if not address.startswith("@") and (mistake := address_mistake(address)):
            raise ValueError(mistake)
        return address

    @model_validator(mode="after")
    def _answered(self) -> Self:
        if ModbusAddress(self.address).rtu and self.unit not in SERIAL_UNITS:
            raise ValueError("a unit from 1 to 247 is expected on a serial line: broadcasts have no answer")
        return self


def address_mistake(text: str) -> str | None:
    """Return a message if an address is malformed. Return None for a valid address."""
    if text.startswith("/"):
        return None
    host, colon, port = text.removeprefix(RTU_PREFIX).rpartition(":")
    if host and colon and port.isascii() and port.isdecimal() and 0 < int(port) < 65536:
        return None
    return "expected host:port, rtu://host:port, the path of a serial port, or @name in a simulated rig"
