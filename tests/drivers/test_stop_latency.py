"""Measure the time from the call of stop or hold to its bytes on the line, while another request waits.

The limit for the median of fifteen calls is 5 ms. With four busy programs on two cores, this median stays
below 3 ms. The answer to the other request never comes. So a stop that waited for this answer would take the
reply timeout, which is 100 ms here.
"""

import statistics
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import pytest

from drivers.clock import SystemClock
from drivers.errors import DeviceError
from drivers.interfaces import OpenContext
from drivers.load_frames.modbus.load_frame import open_frame
from drivers.load_frames.modbus.settings import ModbusLoadFrameSettings
from drivers.stages.esp301.settings import EspSettings
from drivers.stages.esp301.stage import open_stage as open_esp301
from drivers.stages.zaber.settings import ZaberSettings
from drivers.stages.zaber.stage import open_stage as open_zaber
from simulators.load_frame.device import LoadFrameDevice
from simulators.load_frame.modbus import LoadFrameRtuServer, LoadFrameServer
from simulators.stage.device import StageDevice
from simulators.stage.newport import NewportServer
from simulators.stage.zaber import ZaberServer
from tests.spring import Spring
from tests.tcp_servers import load_frame_rtu_on_tcp, newport_on_tcp, zaber_on_tcp

pytestmark = pytest.mark.realtime

BOUND_S = 0.005
REPETITIONS = 15
ANSWER_S = 0.1
LIMITS = {"angle_min_deg": -5.0, "angle_max_deg": 365.0, "reply_timeout_s": ANSWER_S}


@dataclass(frozen=True)
class Line:
    """Functions that start a simulator, open its driver, and recognise the messages of reading and stop."""

    serve: Callable[[SystemClock], Any]
    open: Callable[[str, OpenContext], Any]
    stop: str
    is_read: Callable[[bytes], bool]
    is_stop: Callable[[bytes], bool]


def zaber(port: str, context: OpenContext) -> Any:
    return open_zaber(ZaberSettings(port=port, **LIMITS), context)


def newport(port: str, context: OpenContext) -> Any:
    return open_esp301(EspSettings(port=port, **LIMITS), context)


def frame(address: str, context: OpenContext) -> Any:
    settings = ModbusLoadFrameSettings(
        address=address, load_max_n=5000.0, displacement_max_mm=5.0, reply_timeout_s=ANSWER_S
    )
    return open_frame(settings, context)


def stage_line(server: Callable[..., Any], url: str) -> Line:
    return Line(
        lambda clock: server(StageDevice(clock)),
        lambda address, context: zaber(url.format(address), context),
        "stop",
        lambda message: b"get pos" in message,
        lambda message: b" stop" in message,
    )


def newport_line(server: Callable[..., Any], url: str) -> Line:
    return Line(
        lambda clock: server(StageDevice(clock), clock),
        lambda address, context: newport(url.format(address), context),
        "stop",
        lambda message: message == b"1TP",
        lambda message: message == b"1ST",
    )


def frame_line(server: Callable[..., Any], url: str, header: int) -> Line:
    """Return the `Line` of a load frame.

    Reading the state is Modbus function 4 at register 0. A hold is function 16 at register 0 with the command
    1.
    """
    return Line(
        lambda clock: server(LoadFrameDevice(clock, Spring())),
        lambda address, context: frame(url.format(address), context),
        "hold",
        lambda message: message[header : header + 3] == b"\x04\x00\x00",
        lambda message: message[header : header + 8] == b"\x10\x00\x00\x00\x0a\x14\x00\x01",
    )


LINES = {
    "zaber on a serial line": stage_line(ZaberServer, "{}"),
    "zaber on TCP": stage_line(zaber_on_tcp, "socket://{}"),
    "ESP301 on a serial line": newport_line(NewportServer, "{}"),
    "ESP301 on TCP": newport_line(newport_on_tcp, "socket://{}"),
    "Modbus TCP": frame_line(LoadFrameServer, "{}", 7),
    "Modbus RTU on a serial line": frame_line(LoadFrameRtuServer, "{}", 1),
    "Modbus RTU over TCP": frame_line(load_frame_rtu_on_tcp, "rtu://{}", 1),
}


class Bench:
    """A device whose line can lose the answer to a reading, and records the arrival of stop commands."""

    def __init__(self, line: Line, opened: ExitStack) -> None:
        clock = SystemClock()
        server = line.serve(clock)
        opened.callback(server.close)
        self._line = line
        self._mute = threading.Event()
        self._asked = threading.Event()
        self._stopped_s: list[float] = []
        respond = server.respond

        def watched(message: bytes) -> bytes:
            if line.is_stop(message):
                self._stopped_s.append(time.perf_counter())
            if self._mute.is_set() and line.is_read(message):
                self._mute.clear()
                self._asked.set()
                return b""
            return respond(message)

        server.respond = watched
        self.device = line.open(server.address, OpenContext("device", clock))
        opened.callback(self.device.close)

    def latency_s(self, pool: ThreadPoolExecutor) -> float:
        """Stop the device while another thread waits for an answer; return the time until the stop came."""
        self._asked.clear()
        self._stopped_s.clear()
        self._mute.set()
        reading = pool.submit(self.device.read)
        assert self._asked.wait(60.0)
        called_s = time.perf_counter()
        getattr(self.device, self._line.stop)()
        wait([reading])
        if reading.exception() is not None:
            assert isinstance(reading.exception(), DeviceError)
        return self._stopped_s[0] - called_s


@pytest.fixture
def opened() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


FIRST = ("zaber on a serial line", "ESP301 on TCP", "Modbus TCP")
"""Each driver, on each kind of line."""


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[] if name in FIRST else pytest.mark.extended) for name in LINES]
)
def test_stop_is_on_the_wire_within_5_ms_while_another_request_waits(name, opened):
    bench = Bench(LINES[name], opened)
    with ThreadPoolExecutor(1) as pool:
        latencies_s: list[float] = []
        # More than half within the bound: the median of all would be within it, whatever the rest were.
        while len(latencies_s) < REPETITIONS and _within(latencies_s) <= REPETITIONS // 2:
            latencies_s.append(bench.latency_s(pool))
    found = (
        f"{name}: {1000 * statistics.median(latencies_s):.2f} ms, at most {1000 * max(latencies_s):.2f} ms"
    )
    print(found)
    assert _within(latencies_s) > REPETITIONS // 2, found


def _within(latencies_s: list[float]) -> int:
    return sum(latency_s <= BOUND_S for latency_s in latencies_s)
