"""The driver `modbus-pulse` passes the contract tests for coils and registers, on every kind of line."""

from collections.abc import Iterator
from contextlib import closing

import pytest

from drivers.clock import VirtualClock
from drivers.interfaces import OpenContext
from drivers.testing import TriggerBench, TriggerContract
from drivers.triggers.modbus import ModbusPulseSettings, open_pulse
from tests.drivers.box import BOX_LINES, WatchedBox

OUTPUTS = {
    "coil": ({"output": 3}, 3),
    "register": ({"output": 1001, "table": "holding", "pulse": 7.0}, 1001),
    "volts": ({"output": 1002, "table": "holding", "type": "f32", "pulse": 5.0}, 1002),
}
WIDTH_S = 0.05


@pytest.mark.parametrize("output", OUTPUTS)
@pytest.mark.parametrize("line", BOX_LINES)
class TestModbusPulse(TriggerContract):
    @pytest.fixture
    def bench(self, output, line) -> Iterator[TriggerBench]:
        serve, url, of_line = BOX_LINES[line]
        of_output, number = OUTPUTS[output]
        clock = VirtualClock()
        box = WatchedBox(clock)

        with closing(serve(box)) as server:
            settings = ModbusPulseSettings.model_validate(
                {"address": url.format(server.address), "width_s": WIDTH_S, "reply_timeout_s": 0.2}
                | of_output
                | of_line
            )
            context = OpenContext("triggers.logger", clock)

            def reopen():
                trigger.close()  # a serial port takes one program
                box.leave_on(number)
                return open_pulse(settings, context)

            trigger = open_pulse(settings, context)
            with closing(trigger):
                yield TriggerBench(
                    trigger,
                    clock,
                    lambda: [(time_s, on) for time_s, which, on in box.edges if which == number],
                    width_s=WIDTH_S,
                    tolerance_s=1e-6,
                    reopen=reopen,
                    lose_answers=lambda: server.faults.switch_on("drop"),
                    lose_one_answer=lambda: server.faults.switch_on("drop:1"),
                    restore=server.faults.clear,
                    unplug=lambda: server.faults.switch_on("unplug"),
                    lose_writes=lambda: setattr(box, "deaf", True),
                )
                box.deaf = False
                server.faults.clear()
