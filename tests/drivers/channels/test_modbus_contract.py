"""The driver `modbus-channels` passes the contract tests on every kind of line."""

from collections.abc import Iterator
from contextlib import closing
from functools import partial

import pytest

from drivers.channels.modbus import ModbusChannelsSettings, open_channels
from drivers.clock import VirtualClock
from drivers.interfaces import OpenContext
from drivers.testing import ChannelsBench, ChannelsContract
from tests.drivers.box import BOX_LINES, WatchedBox

FORCE_N_PER_V, STRAIN_PER_COUNT = 5000.0, 1000.0 / 30_000
SIGNALS = {
    "force": {"input": 0, "type": "f32", "unit": "N", "scale": FORCE_N_PER_V, "range": [-52e3, 52e3],
              "invalid": [-9999]},
    "crosshead": {"input": 22, "type": "f32", "word_order": "CDAB", "unit": "mm", "scale": 2.0,
                  "offset": 50.0, "range": [29.0, 71.0], "invalid": [-9999]},
    "strain": {"input": 42, "type": "i16", "table": "holding", "unit": "µm/m", "scale": STRAIN_PER_COUNT,
               "range": [-1000, 1000], "invalid": [-0x8000]},
    "trigger": {"input": 60, "type": "u32", "unit": "pulses", "range": [0, 4e9]},
    "running": {"input": 1, "table": "discrete", "unit": "1", "range": [-1.0, 5 / 3]},
}  # fmt: skip


def show(box: WatchedBox, name: str, value: float) -> None:
    """Set the input of a signal to a value in the unit of the signal."""
    match name:
        case "force":
            box.hand.inputs["force"] = value / FORCE_N_PER_V
        case "crosshead":
            box.hand.inputs["crosshead"] = (value - 50.0) / 2.0
        case "strain":
            box.hand.inputs["extensometer"] = value / 100.0
        case "trigger":
            box.hand.pulses = round(value)
        case "running":
            box.hand.running = value == 1.0


class TestModbusChannels(ChannelsContract):
    @pytest.fixture(params=BOX_LINES)
    def bench(self, request) -> Iterator[ChannelsBench]:
        serve, url, line = BOX_LINES[request.param]
        clock = VirtualClock()
        box = WatchedBox(clock)
        true = {"force": 12_500.0, "crosshead": 52.5, "strain": -200.0, "trigger": 70_000.0, "running": 1.0}
        for name, value in true.items():
            show(box, name, value)
        with closing(serve(box)) as server:
            settings = ModbusChannelsSettings.model_validate(
                {"address": url.format(server.address), "rate_hz": 100.0, "reply_timeout_s": 1.0}
                | {"signals": SIGNALS}
                | line
            )
            with closing(open_channels(settings, OpenContext("channels.box", clock))) as device:
                yield ChannelsBench(
                    device,
                    clock,
                    true,
                    tolerance=0.01,
                    show=partial(show, box),
                    changes=lambda: box.changes,
                    lose_answers=lambda: server.faults.switch_on("drop"),
                    restore=server.faults.clear,
                    unplug=lambda: server.faults.switch_on("unplug"),
                    break_sensor=lambda: server.faults.switch_on("broken-sensor"),
                    skip_samples=lambda: clock.sleep(0.055),
                )
