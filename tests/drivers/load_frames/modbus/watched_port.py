"""A simulated load frame on a port at which a test can read, change, lose or delay each message."""

import struct
from collections.abc import Callable

from drivers.clock import VirtualClock
from drivers.load_frames.modbus.load_frame import ModbusLoadFrame
from drivers.load_frames.modbus.settings import ModbusLoadFrameSettings
from simulators.load_frame.device import LoadFrameDevice
from simulators.load_frame.modbus import LoadFrameServer

COMMAND_ADDRESS = 0
Answer = Callable[[], bytes | None]


class Port(LoadFrameServer):
    """A Modbus server of a load frame. A test can read, change, lose or delay each message."""

    def __init__(self, device: LoadFrameDevice) -> None:
        self.commands: list[tuple[int, int]] = []
        self.tamper: Callable[[bytes, Answer], bytes | None] = lambda request, answer: answer()
        super().__init__(device)

    def answer(self, unit: int, request: bytes) -> bytes | None:
        if is_command(request):
            self.commands.append((int.from_bytes(request[6:8], "big"), int.from_bytes(request[-2:], "big")))
        return self.tamper(request, lambda: super(Port, self).answer(unit, request))


def is_command(request: bytes) -> bool:
    return request[0] == 16 and struct.unpack(">H", request[1:3])[0] == COMMAND_ADDRESS


def is_state(request: bytes) -> bool:
    return request[:3] == b"\x04\x00\x00"


def settings(address: str, **changes: object) -> ModbusLoadFrameSettings:
    values = {"address": address, "load_max_n": 12000.0, "displacement_max_mm": 5.3, "reply_timeout_s": 2.0}
    return ModbusLoadFrameSettings.model_validate(values | changes)


def wait(frame: ModbusLoadFrame, clock: VirtualClock) -> float:
    """Wait in simulated time for standstill, and return the duration in seconds."""
    start_s = clock.now_s()
    while frame.read().moving:
        clock.sleep(0.1)
        assert clock.now_s() - start_s < 3600
    return clock.now_s() - start_s
