"""The MQTT driver passes the contract tests with a broker by others."""

import math
import time
from collections.abc import Iterator
from contextlib import closing
from functools import partial
from typing import Any

import pytest

from drivers.channels.mqtt.driver import SPEC
from drivers.clock import SystemClock
from drivers.interfaces import OpenContext
from drivers.testing import ChannelsBench, ChannelsContract
from tests.mqtt_broker import Broker, Publisher, clocked

TRUE = {"force": 12.5, "travel": -0.25}
RANGES = {"force": [-100.0, 100.0], "travel": [-5.0, 5.0]}
RATE_HZ = 50.0
TABLES: dict[str, dict[str, Any]] = {
    "json-with-time": {
        "topic": "machine/all",
        "time": {"json": "ms", "unit": "ms"},
        "signals": {
            name: {"unit": "unit", "range": limits, "json": f"values.{name}"}
            for name, limits in RANGES.items()
        },
    },
    "numbers": {
        "invalid": ["nan"],
        "signals": {
            name: {"unit": "unit", "range": limits, "topic": f"machine/{name}"}
            for name, limits in RANGES.items()
        },
    },
}


@pytest.mark.parametrize("kind", TABLES)
class TestMqtt(ChannelsContract):
    @pytest.fixture
    def bench(self, kind: str, broker: Broker) -> Iterator[ChannelsBench]:
        broker.start()
        shown, begun_s = dict(TRUE), time.monotonic()

        def texts() -> dict[str, str]:
            if kind == "numbers":
                return {f"machine/{name}": f"{value}" for name, value in shown.items()}
            return clocked("machine/all", shown, begun_s)

        table = {"address": broker.address, "stale_after_s": 1.0, "rate_hz": RATE_HZ, **TABLES[kind]}
        with closing(Publisher(broker, texts)) as publisher:
            publisher.go_on(RATE_HZ)
            context = OpenContext("channels.shop", SystemClock())
            with closing(SPEC.open(SPEC.settings.model_validate(table), context)) as device:
                yield ChannelsBench(
                    device,
                    context.clock,
                    TRUE,
                    tolerance=1e-9,
                    show=shown.__setitem__,
                    lose_answers=partial(publisher.faults.switch_on, "drop"),
                    restore=publisher.faults.clear,
                    unplug=partial(publisher.faults.switch_on, "unplug"),
                    break_sensor=lambda: shown.update(force=math.nan),
                    sends_by_itself=kind == "numbers",
                )
