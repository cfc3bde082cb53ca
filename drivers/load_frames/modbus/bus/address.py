"""Address of a Modbus device: ``host:port``, ``rtu://host:port``, or the path of a serial port."""

from dataclasses import dataclass

from drivers.lines.channel import SerialChannel, TcpChannel
from drivers.load_frames.modbus.bus.wire import RtuWire, TcpWire, Wire

RTU_PREFIX = "rtu://"
# Unit 0 of a serial line is the broadcast: no device answers, so no request could be confirmed.
SERIAL_UNITS = range(1, 248)


@dataclass(frozen=True)
class ModbusAddress:
    """A device's address and the settings of its line.

    Attributes
    ----------
    text : str
        As written.
    baud : int
    parity : str
        ``N``, ``E`` or ``O``.
    stop_bits : int
        Of a serial port.
    """

    text: str
    baud: int = 19_200
    parity: str = "E"
    stop_bits: int = 1

    @property
    def rtu(self) -> bool:
        """Whether the device speaks Modbus RTU: one line, one master, answers without transaction numbers."""
        return self.serial or self.text.startswith(RTU_PREFIX)

    @property
    def serial(self) -> bool:
        """Whether the address is a serial port of this computer."""
        return self.text.startswith("/")

    def open(self, timeout_s: float) -> Wire:
        """Connect; raises one of `drivers.lines.channel.CHANNEL_ERRORS` if that fails."""
        if self.serial:
            channel = SerialChannel(self.text, self.baud, self.parity, self.stop_bits, timeout_s)
            return RtuWire(channel, self.baud)
        host, _, port = self.text.removeprefix(RTU_PREFIX).rpartition(":")
        tcp = TcpChannel(host.strip("[]"), int(port), timeout_s)
        return RtuWire(tcp, None) if self.rtu else TcpWire(tcp)


def address_mistake(text: str) -> str | None:
    """Return what is wrong with an address, or None."""
    if text.startswith("/"):
        return None
    host, colon, port = text.removeprefix(RTU_PREFIX).rpartition(":")
    if host and colon and port.isascii() and port.isdecimal() and 0 < int(port) < 65536:
        return None
    return "expected host:port, rtu://host:port, the path of a serial port, or @name in a simulated rig"
