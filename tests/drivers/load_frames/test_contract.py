"""The load frame driver passes the contract tests with every line, map and server, also of other authors."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from drivers.clock import VirtualClock
from drivers.interfaces import OpenContext
from drivers.load_frames.modbus.load_frame import open_frame
from drivers.load_frames.modbus.settings import ModbusLoadFrameSettings
from drivers.testing import LoadFrameBench, LoadFrameContract
from simulators.load_frame.device import LoadFrameDevice, SpeedFault
from simulators.load_frame.faults import load_frame_faults
from simulators.load_frame.layout import LAYOUTS
from simulators.load_frame.modbus import LoadFrameRtuServer, LoadFrameServer
from simulators.load_frame.registers import LoadFrameRegisters
from simulators.wire.faults import LOAD_FRAME, FaultPanel
from tests.drivers.load_frames import foreign_servers
from tests.spring import Spring
from tests.tcp_servers import load_frame_rtu_on_tcp

LIMITS = {"load_max_n": 5000.0, "load_min_n": -100.0, "displacement_max_mm": 5.0, "displacement_min_mm": -1.0}
COMMANDS = {"hold", "displacement", "load", "tare"}


class Machine:
    """The simulated machine behind a server: its device, its registers, and the number of its motions."""

    def __init__(self, map_name: str) -> None:
        self.clock = VirtualClock()
        self.device = LoadFrameDevice(self.clock, Spring())
        self.panel = load_frame_faults(FaultPanel(LOAD_FRAME), self.device)
        self.registers = LoadFrameRegisters(self.device, LAYOUTS[map_name], 220001, self.panel)
        self.motions = 0
        for name in ("go_to_displacement", "go_to_load", "change_speed"):
            self._count(name)

    def _count(self, name: str) -> None:
        go = getattr(self.device, name)

        def counted(*arguments: float) -> None:
            self.motions += 1
            go(*arguments)

        setattr(self.device, name, counted)


@contextmanager
def opened(
    machine: Machine, address: str, map_name: str, reply_timeout_s: float, **handles: Any
) -> Iterator[LoadFrameBench]:
    settings = ModbusLoadFrameSettings(
        address=address, map=map_name, reply_timeout_s=reply_timeout_s, **LIMITS
    )
    frame = open_frame(settings, OpenContext("load_frame", machine.clock))
    device = machine.device
    try:
        yield LoadFrameBench(
            frame,
            machine.clock,
            commands=lambda: machine.motions,
            break_load_cell=lambda: device.break_load_cell(True),
            freeze=device.freeze,
            press_estop=device.press_estop,
            release_estop=device.release_estop,
            watchdog_s=settings.watchdog_s,
            stick_speed=lambda: device.spoil_speed(SpeedFault.STUCK),
            **handles,
        )
    finally:
        frame.close()


LINES = {
    "tcp-generic": (LoadFrameServer, "{}", "generic"),
    "tcp-scaled-integers": (LoadFrameServer, "{}", "scaled-integers"),
    "rtu-separate-words": (LoadFrameRtuServer, "{}", "separate-words"),
    "rtu-over-tcp-generic": (load_frame_rtu_on_tcp, "rtu://{}", "generic"),
}


@pytest.mark.parametrize("line", LINES)
class TestOnTheSimulator(LoadFrameContract):
    @pytest.fixture
    def bench(self, line: str) -> Iterator[LoadFrameBench]:
        serve, url, map_name = LINES[line]
        machine = Machine(map_name)
        server = serve(machine.device, registers=machine.registers, faults=machine.panel)
        handles = {
            "lose_answers": lambda: machine.panel.switch_on("drop"),
            "restore": machine.panel.clear,
        }
        try:
            with opened(machine, url.format(server.address), map_name, 0.3, **handles) as bench:
                yield bench
        finally:
            server.close()


FOREIGN = {
    "pyModbusTCP": (foreign_servers.PyModbusTcpServer, "generic"),
    "modbus-tk-tcp": (foreign_servers.TkTcpServer, "scaled-integers"),
    "modbus-tk-rtu": (foreign_servers.TkRtuServer, "separate-words"),
    "libmodbus-tcp": (foreign_servers.LibmodbusTcpServer, "separate-words"),
    "libmodbus-rtu": (foreign_servers.LibmodbusRtuServer, "scaled-integers"),
}


@pytest.fixture(scope="module", params=FOREIGN)
def foreign(request: pytest.FixtureRequest) -> Iterator[tuple[foreign_servers.ForeignServer, str]]:
    name = request.param
    if name.startswith("libmodbus") and foreign_servers.libmodbus() is None:
        pytest.skip("libmodbus is not on this machine (Debian: libmodbus5)")
    serve, map_name = FOREIGN[name]
    server = serve()
    yield server, map_name
    server.close()


class TestOnServersByOthers(LoadFrameContract):
    # they cannot be made to lose an answer
    test_silence_is_told_in_time_and_motion_waits_for_a_hold = None
    test_a_command_whose_answer_is_lost_is_executed_once_at_most = None
    test_a_change_without_an_answer_is_told_in_time = None
    # each hold that interrupts a request makes some of them silent for a whole reply timeout
    test_a_change_that_races_with_a_hold_never_outruns_it = None

    @pytest.fixture(autouse=True)
    def nothing_is_left_open(self) -> None:
        """Check nothing here, because the threads of other authors' servers may end later."""

    @pytest.fixture
    def bench(self, foreign: tuple[foreign_servers.ForeignServer, str]) -> Iterator[LoadFrameBench]:
        server, map_name = foreign
        machine = Machine(map_name)
        server.answer = machine.registers.answer
        with opened(machine, server.address, map_name, 5.0) as bench:
            yield bench
