"""What the driver `modbus-pulse` writes, and what it says about mistakes and pulses that did not end."""

from contextlib import closing

import pytest
from pydantic import ValidationError

from drivers.clock import SystemClock
from drivers.errors import DeviceError, DeviceFault
from drivers.interfaces import OpenContext
from drivers.settings import mistakes_in
from drivers.triggers.modbus import ModbusPulseSettings, open_pulse
from simulators.closed_machine.modbus import AnalogueBoxServer
from tests.drivers.box import WatchedBox

SWITCH, READ = 5, 1


@pytest.fixture
def box(clock):
    return WatchedBox(clock)


@pytest.fixture
def server(box):
    with closing(AnalogueBoxServer(box)) as server:
        yield server


def settings(address="10.0.0.1:502", **table):
    return ModbusPulseSettings.model_validate({"address": address, "output": 3} | table)


def opened(server, clock, **table):
    return open_pulse(settings(server.address, **table), OpenContext("triggers.logger", clock))


def test_the_output_is_put_at_rest_first_and_read_back_after_each_write(server, box, clock):
    with closing(opened(server, clock)) as trigger:
        trigger.pulse()
    functions = [request[0] for request in box.requests]
    assert functions == 3 * [SWITCH, READ]


def test_an_output_that_must_not_be_read_is_only_written(server, box, clock):
    with closing(opened(server, clock, readback=False)) as trigger:
        trigger.pulse()
    assert [request[0] for request in box.requests] == 3 * [SWITCH]


def test_a_coil_may_rest_switched_on(server, box, clock):
    with closing(opened(server, clock, pulse=0.0, rest=1.0)) as trigger:
        assert box.coil(3)
        trigger.pulse()
    assert box.coil(3)
    assert [on for _, _, on in box.edges] == [True, False, True]


def test_a_volt_output_gets_its_voltage(server, box, clock):
    table = {"output": 1000, "table": "holding", "type": "f32", "pulse": 5.0}
    with closing(opened(server, clock, **table)) as trigger:
        box.requests.clear()
        trigger.pulse()
        # 5 V as a 32-bit float, by function 16 to register 1000
        assert box.requests[0] == bytes.fromhex("10 03e8 0002 04 40a00000")


@pytest.mark.realtime
def test_a_pulse_that_did_not_end_in_time_is_told_once(server, box):
    clock = SystemClock()
    trigger = opened(server, clock, width_s=0.05, reply_timeout_s=0.1)
    trigger.pulse()
    server.faults.switch_on("unplug")
    clock.sleep(0.5)
    server.faults.clear()
    with pytest.raises(DeviceFault, match=r"end the pulse before: .*at rest after 0\.05 s.*longer"):
        trigger.pulse()
    assert not box.coil(3)
    trigger.pulse()
    trigger.close()
    assert [on for _, _, on in box.edges] == 2 * [True, False]


@pytest.mark.realtime
def test_closing_says_if_the_output_may_not_be_at_rest(server):
    clock = SystemClock()
    trigger = opened(server, clock, width_s=0.05, reply_timeout_s=0.1)
    trigger.pulse()
    server.faults.switch_on("drop")
    with pytest.raises(DeviceError, match=r"triggers\.logger .*switch coil 3 off"):
        trigger.close()
    trigger.close()


def test_an_output_that_the_module_does_not_have_is_refused_at_the_start(server, clock):
    with pytest.raises(DeviceFault, match="illegal data address"):
        opened(server, clock, output=99)


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ({"type": "u16"}, "remove them for a coil"),
        ({"pulse": 5.0}, "1 and 0 or 0 and 1"),
        ({"table": "holding", "pulse": 0.0}, "must be different"),
        ({"table": "holding", "pulse": 0.5}, "whole numbers in u16"),
        ({"table": "holding", "pulse": 70_000.0}, "does not fit u16"),
        ({"width_s": 0.0}, "greater than or equal to 0.001"),
        ({"pin": 3}, "unknown key"),
    ],
)
def test_mistakes_in_the_rig_file_are_told(table, said):
    with pytest.raises(ValidationError) as raised:
        settings(**table)
    assert said in " ".join(mistakes_in(raised.value, "triggers.logger"))
