"""The guard of a load frame on Modbus, which stops the machine if the process of the run fails."""

from drivers.errors import DeviceTimeout
from drivers.interfaces import OpenContext
from drivers.lines.addresses import shared_line
from drivers.lines.relay import Relay
from drivers.lines.stop_deadline import STOP_TIMES, StopTimes
from drivers.load_frames.modbus.bus.address import ModbusAddress
from drivers.load_frames.modbus.bus.link import Address, ModbusLink
from drivers.load_frames.modbus.bus.pdu import WRITE_MANY
from drivers.load_frames.modbus.bus.wire import TCP_HEADER, Wire, silent_interval_s
from drivers.load_frames.modbus.command_sequence import LEAP_MAX, CommandSequence
from drivers.load_frames.modbus.hold import hold_until_confirmed
from drivers.load_frames.modbus.registers.map import load_map
from drivers.load_frames.modbus.registers.mapped_device import MappedDevice
from drivers.load_frames.modbus.settings import ModbusLoadFrameSettings
from drivers.registry import GuardSpec

# The guardian's first sequence number exceeds the machine's by this value, so that the machine takes all
# sequence numbers of the run for older ones.
LEAP = LEAP_MAX + 2**12
REACH = "reach the machine for the guardian"


class ModbusGuard:
    """A `Guard` of a load frame. The constructor connects to the machine.

    Over Modbus TCP, the guard has its own connection if the machine accepts more than one connection. On
    Modbus RTU, or if the machine accepts only one connection, the guard owns the only line and passes the
    driver's requests to the machine. Raise `DeviceError` if the machine does not answer.
    """

    def __init__(
        self, settings: ModbusLoadFrameSettings, context: OpenContext, times: StopTimes = STOP_TIMES
    ) -> None:
        place = settings.place(settings.address)
        self._name = f"{context.name} ({place.text})"
        self._clock = context.clock
        self._map = load_map(settings.map)
        self._times = times
        self._gap_s = silent_interval_s(place.baud) if place.serial else 0.0
        self._line = _line(place, times.answer_s) if place.rtu or settings.connections == 1 else None
        way: Address = place if self._line is None else _OwnLine(place, self._line)
        link = ModbusLink(self._name, way, settings.unit, settings.reply_timeout_s, times.answer_s)
        self._device = MappedDevice(link, self._map, urgent=True)
        self.relay = ""
        try:
            self._identity = self._device.identify(REACH)
            self._executed = int(self._device.read_status(REACH)["executed"])
            if self._line is not None:
                self._line.begin()
                self.relay = self._line.address
        except BaseException:
            self.close()
            raise

    def check(self) -> None:
        """Check the guard's own connection. A line that the guard shares with the driver needs no check."""
        if self._line is None:
            # send an ordinary request, so that a stop does not wait for this check
            self._executed = int(self._device.unhurried().read_status(REACH)["executed"])

    def stop(self) -> None:
        """Hold the crosshead. Raise `DeviceTimeout` if the machine does not confirm the hold."""
        if self._line is not None:
            self._line.take_over()
            # wait, so that the machine can tell the hold from a request that the relay passed on just before
            self._clock.sleep(self._gap_s)
        sequence = CommandSequence(self._executed, LEAP)
        hold_until_confirmed(self._device, self._map, sequence, self._times, self._clock)
        if (found := self._device.identify("hold")) != self._identity:
            expected = f"the machine {self._identity}"
            raise DeviceTimeout(self._name, "hold", expected, f"{found}", "press the emergency stop")

    def close(self) -> None:
        """Release the line without stopping the machine. A repeated call has no effect."""
        self._device.close()
        if self._line is not None:
            self._line.close()


class _OwnLine:
    """The line of a relay, in the form of an address that a link can open."""

    def __init__(self, place: ModbusAddress, line: Relay) -> None:
        self.text = place.text
        self._place = place
        self._line = line
        self._opened = False

    def open(self, timeout_s: float) -> Wire:
        if self._opened:
            # the link closed its last connection, because answers on it were unreliable
            self._line.drop_channel()
        self._opened = True
        return self._place.wire(self._line.channel())


def _line(place: ModbusAddress, timeout_s: float) -> Relay:
    cut = _whole_rtu_requests if place.rtu else _whole_tcp_requests
    return Relay(lambda: place.channel(timeout_s), cut, fresh=not place.rtu)


def _whole_tcp_requests(buffer: bytes) -> int:
    whole = 0
    while len(buffer) >= whole + TCP_HEADER:
        size = TCP_HEADER - 1 + int.from_bytes(buffer[whole + 4 : whole + 6], "big")
        if len(buffer) < whole + size:
            break
        whole += size
    return whole


def _whole_rtu_requests(buffer: bytes) -> int:
    whole = 0
    while len(buffer) > whole + 6:
        size = 9 + buffer[whole + 6] if buffer[whole + 1] == WRITE_MANY else 8
        if len(buffer) < whole + size:
            break
        whole += size
    return whole


GUARD = GuardSpec(line=lambda settings: shared_line(settings.address), open=ModbusGuard)
