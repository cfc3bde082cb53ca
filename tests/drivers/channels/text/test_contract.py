"""The text driver passes the contract tests: asked and listened to, on every kind of line."""

from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import pytest

from drivers.channels.text.driver import open_channels
from drivers.channels.text.settings import TextChannelSettings
from drivers.clock import Clock, SystemClock, VirtualClock
from drivers.interfaces import OpenContext
from drivers.testing import ChannelsBench, ChannelsContract
from simulators.instrument.meter import COUNTER_WRAPS_AT, Meter, MeterServer, SendingMeterServer
from simulators.wire.ports import LOCALHOST

TRUE = {"force": 12.5, "travel": -0.25}
RANGES = {"force": [-100.0, 100.0], "travel": [-5.0, 5.0]}
IDENTIFICATION = {"query": "*IDN?", "pattern": "SIMULATED,.*"}
RATE_HZ = 50.0
SENDING_HZ = 200.0


def signals(**places: dict[str, Any]) -> dict[str, Any]:
    return {
        name: {"unit": "unit", "range": RANGES[name], "scale": 2.0, "offset": 1.0, **place}
        for name, place in places.items()
    }


COLUMNS = signals(force={"column": 1}, travel={"column": 2})
OWN_QUERIES = signals(
    force={"query": "FORCE?", "pattern": "force= (.*) unit"},
    travel={"query": "TRAVEL?", "pattern": "travel= (.*) unit"},
)


@dataclass(frozen=True)
class Way:
    """A way to read the meter: the line, how its address is written, and keys of the rig file."""

    prefix: str = ""
    host: str | None = None
    table: dict[str, Any] = field(default_factory=dict)


ASKED = {"query": "READ?", "rate_hz": RATE_HZ, "signals": COLUMNS}
WAYS = {
    "pty": Way(table={**ASKED, "identification": IDENTIFICATION, "opening": ["*CLS", "CONF:VOLT"]}),
    "pty-own-queries": Way(table={"rate_hz": RATE_HZ, "signals": OWN_QUERIES}),
    "tcp": Way("socket://", LOCALHOST, ASKED),
    "tcp-time": Way(
        "socket://",
        LOCALHOST,
        {
            **ASKED,
            "query": "TIME?",
            "rate_hz": 20.0,
            "time": {"column": 1, "unit": "ms"},
            "signals": signals(force={"column": 2}, travel={"column": 3}),
        },
    ),
    "visa": Way("visa://TCPIP0::", LOCALHOST, ASKED),
}


def address_of(server: Any, prefix: str) -> str:
    if prefix.startswith("visa"):
        return prefix + server.address.replace(":", "::") + "::SOCKET"
    return prefix + server.address


def bench_of(
    server: Any, meter: Meter, clock: Clock, settings: TextChannelSettings, **more: Any
) -> Iterator[ChannelsBench]:
    # the value of a signal is twice the meter's number plus one
    def show(name: str, value: float) -> None:
        meter.show(name, (value - 1.0) / 2.0)

    for name, value in TRUE.items():
        show(name, value)
    with closing(open_channels(settings, OpenContext("channels.box", clock))) as device:
        yield ChannelsBench(
            device,
            clock,
            TRUE,
            tolerance=1e-4,
            show=show,
            changes=lambda: len(meter.commands),
            lose_answers=partial(server.faults.switch_on, "drop"),
            restore=server.faults.clear,
            unplug=partial(server.faults.switch_on, "unplug"),
            break_sensor=meter.break_sensor,
            **more,
        )


class TestAsked(ChannelsContract):
    @pytest.fixture(params=WAYS)
    def bench(self, request: pytest.FixtureRequest) -> Iterator[ChannelsBench]:
        way = WAYS[request.param]
        # a meter with a clock of its own needs some time between two samples
        clock: Clock = SystemClock() if "time" in way.table else VirtualClock()
        if way.prefix.startswith("visa"):
            pytest.importorskip("pyvisa_py", reason="PyVISA-py of the extra [visa] is not installed")
        meter = Meter(clock, dict.fromkeys(TRUE, 0.0))
        with closing(MeterServer(meter, host=way.host)) as server:
            settings = TextChannelSettings(
                address=address_of(server, way.prefix), reply_timeout_s=0.15, **way.table
            )
            yield from bench_of(server, meter, clock, settings)


SENT: dict[str, dict[str, Any]] = {
    "plain": {},
    "clock": {"time": {"column": 1, "unit": "ms"}},
    "clock-and-counter": {
        "time": {"column": 1, "unit": "ms"},
        "counter": {"column": 2, "wraps_at": COUNTER_WRAPS_AT},
        "identification": IDENTIFICATION,
        "opening": ["*CLS"],
        "errors": {"query": "SYST:ERR?", "pattern": "0,.*"},
    },
}


class TestSending(ChannelsContract):
    @pytest.fixture(params=[(kind, line) for kind, line in zip(SENT, ("pty", "tcp", "pty"), strict=True)])
    def bench(self, request: pytest.FixtureRequest) -> Iterator[ChannelsBench]:
        kind, line = request.param
        clock = SystemClock()
        meter = Meter(clock, dict.fromkeys(TRUE, 0.0))
        host = LOCALHOST if line == "tcp" else None
        with closing(SendingMeterServer(meter, SENDING_HZ, host=host)) as server:
            settings = TextChannelSettings(
                address=server.address if host is None else f"socket://{server.address}",
                stream=True,
                rate_hz=SENDING_HZ,
                columns=4,
                signals=signals(force={"column": 3}, travel={"column": 4}),
                **SENT[kind],
            )
            skip: Callable[[], object] | None = None
            if "counter" in kind:
                skip = partial(setattr, meter, "skipped", 5)
            sends = kind == "plain"
            yield from bench_of(server, meter, clock, settings, skip_samples=skip, sends_by_itself=sends)
