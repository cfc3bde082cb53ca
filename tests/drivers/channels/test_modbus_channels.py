"""Registers, requests, due times and mistakes of the driver `modbus-channels`."""

import math
import struct
from contextlib import closing

import numpy as np
import pytest
from pydantic import ValidationError

from drivers.channels.modbus import ModbusChannelsSettings, open_channels
from drivers.clock import SystemClock, VirtualClock
from drivers.errors import DeviceError, DeviceFault, DeviceTimeout
from drivers.interfaces import OpenContext
from drivers.settings import mistakes_in
from simulators.closed_machine.modbus import AnalogueBoxServer
from tests.drivers.box import WatchedBox

VOLTS = {"unit": "V", "range": [-11, 11]}
FLOAT = VOLTS | {"type": "f32"}


@pytest.fixture
def box(clock):
    return WatchedBox(clock)


@pytest.fixture
def server(box):
    with closing(AnalogueBoxServer(box)) as server:
        yield server


def settings(address="10.0.0.1:502", **table):
    return ModbusChannelsSettings.model_validate(
        {"address": address, "rate_hz": 100.0, "signals": {"force": FLOAT | {"input": 0}}} | table
    )


def opened(server, clock, **table):
    given = settings(server.address, **{"reply_timeout_s": 0.5} | table)
    return closing(open_channels(given, OpenContext("channels.box", clock)))


def test_neighbours_are_read_in_one_request(server, box, clock):
    box.hand.inputs = {"force": 1.5, "crosshead": -2.5, "extensometer": 9.75}
    signals = {name: FLOAT | {"input": place} for name, place in (("b", 2), ("c", 4), ("a", 0))}
    with opened(server, clock, signals=signals) as device:
        box.requests.clear()
        samples = device.read(1.0)
    assert box.requests == [b"\x04\x00\x00\x00\x06"]
    assert samples.values.tolist() == [[-2.5, 9.75, 1.5]]


def test_a_gap_is_read_over_only_if_the_rig_file_allows_it(server, box, clock):
    signals = {"a": FLOAT | {"input": 0}, "c": FLOAT | {"input": 4}}
    for gap, requests in ((0, 2), (1, 2), (2, 1)):
        with opened(server, clock, signals=signals, gap_max=gap) as device:
            box.requests.clear()
            device.read(1.0)
        assert len(box.requests) == requests


def test_a_gap_that_the_module_does_not_have_is_refused_when_it_is_opened(server, clock):
    signals = {"a": FLOAT | {"input": 4}, "b": FLOAT | {"input": 20}}
    with (
        pytest.raises(DeviceFault, match="illegal data address"),
        opened(server, clock, signals=signals, gap_max=20),
    ):
        pass


@pytest.mark.parametrize(("most", "requests"), [(125, 1), (4, 2), (3, 3), (2, 3)])
def test_a_request_has_no_more_registers_than_the_module_takes(most, requests):
    signals = {name: FLOAT | {"input": place} for place, name in ((0, "a"), (2, "b"), (4, "c"))}
    assert len(settings(signals=signals, request_max=most).requests()) == requests


def test_tables_are_read_apart_and_signals_may_share_a_register(server, box, clock):
    box.hand.inputs["force"], box.hand.high = 2.0, True
    signals = {
        "force": FLOAT | {"input": 0},
        "level": {"input": 0, "table": "discrete", "unit": "1", "range": [0, 1]},
        "also": FLOAT | {"input": 0, "table": "holding"},
        "high_word": {"input": 0, "unit": "1", "range": [0, 65_535]},
    }
    with opened(server, clock, signals=signals) as device:
        box.requests.clear()
        (values,) = device.read(1.0).values
    assert sorted(request[0] for request in box.requests) == [2, 3, 4]
    assert values.tolist() == [2.0, 1.0, 2.0, 0x4000]


@pytest.mark.parametrize("value", [math.nan, math.inf, -9999.0])
def test_no_value_is_no_number_and_the_other_signals_are_kept(server, box, clock, value):
    signals = {
        "force": FLOAT | {"input": 0, "invalid": [-9999], "scale": 5.0, "offset": 1.0},
        "crosshead": FLOAT | {"input": 2},
    }
    box.raw = {0: list(struct.unpack(">4H", struct.pack(">2f", value, 3.0)))}
    with opened(server, clock, signals=signals) as device:
        (values,) = device.read(1.0).values
    assert np.isnan(values[0])
    assert values[1] == 3.0


def test_samples_come_on_the_grid_of_the_first_one(server, clock):
    with opened(server, clock, rate_hz=4.0) as device:
        clock.sleep(100.0)
        begun_s = clock.now_s()
        samples = [device.read(1.0) for _ in range(8)]
    assert [each.first for each in samples] == list(range(8))
    assert [each.asked_s - begun_s for each in samples] == pytest.approx([k / 4.0 for k in range(8)])


def test_a_busy_computer_leaves_a_gap_and_the_grid_stands(server, clock):
    with opened(server, clock, rate_hz=10.0) as device:
        begun_s = clock.now_s()
        device.read(1.0)
        clock.sleep(0.37)
        late, after = device.read(1.0), device.read(1.0)
    assert (late.first, after.first) == (3, 4)
    assert late.asked_s - begun_s == pytest.approx(0.37)
    assert after.asked_s - begun_s == pytest.approx(0.4)


def test_a_sample_that_could_not_be_read_is_missing(server, clock):
    with opened(server, clock) as device:
        first = device.read(1.0)
        server.faults.switch_on("exception")
        with pytest.raises(DeviceFault, match="device busy"):
            device.read(1.0)
        server.faults.clear()
        assert device.read(1.0).first == first.first + 2


@pytest.mark.parametrize("fault", ["drop:1", "lose-request:1", "late:1"])
def test_a_lost_answer_costs_its_sample_and_no_other(server, clock, fault):
    with opened(server, clock, reply_timeout_s=0.1) as device:
        before = device.read(1.0)
        server.faults.switch_on(fault)
        after = device.read(1.0)
        assert after.first == before.first + 2
        assert after.received_s - after.asked_s < 0.01
        assert device.read(1.0).first == after.first + 1


def test_a_period_longer_than_the_timeout_is_said_and_costs_no_sample(server, clock):
    with opened(server, clock, rate_hz=0.5) as device:
        assert device.read(0.5).first == 0
        for _ in range(3):
            with pytest.raises(DeviceTimeout, match=r"due in .* at 0\.5 Hz"):
                device.read(0.5)
        assert device.read(0.6).first == 1


@pytest.mark.realtime
def test_the_wait_for_an_answer_keeps_the_callers_time(server):
    clock = SystemClock()
    with opened(server, clock) as device:
        device.read(1.0)
        server.faults.switch_on("drop")
        begun_s = clock.now_s()
        with pytest.raises(DeviceError):
            device.read(0.6)
        assert 0.5 < clock.now_s() - begun_s < 1.5


def test_registers_that_the_module_does_not_have_are_refused_at_the_start(server, clock):
    with (
        pytest.raises(DeviceFault, match=r"channels\.box .*illegal data address"),
        opened(server, clock, signals={"far": FLOAT | {"input": 500}}),
    ):
        pass


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ({"signals": {}}, "at least 1 item"),
        ({"signals": {"two words": FLOAT | {"input": 0}}}, "a name of letters"),
        ({"signals": {"a": FLOAT | {"input": 0xFFFF}}}, "is the last register, and f32 takes two"),
        ({"signals": {"a": VOLTS | {"input": 0, "type": "i16", "invalid": [0xFFFF]}}}, "never stands in i16"),
        ({"signals": {"a": FLOAT | {"input": 0, "table": "coil"}}}, "remove them for a contact"),
        ({"signals": {"a": FLOAT | {"input": 0, "scale": 0.0}}}, "scale must not be 0"),
        ({"signals": {"a": FLOAT | {"input": 0, "range": [1, 0]}}}, "the lowest value before the highest"),
        ({"signals": {"a": FLOAT | {"input": 0, "gain": 1}}}, "unknown key"),
        ({"rate_hz": 0.0}, "greater than or equal to 0.01"),
        ({"address": "/dev/ttyUSB0", "unit": 0}, "from 1 to 247"),
        ({"address": "here"}, "expected host:port"),
    ],
)
def test_mistakes_in_the_rig_file_are_told(table, said):
    with pytest.raises(ValidationError) as raised:
        settings(**table)
    assert said in " ".join(mistakes_in(raised.value, "channels.box"))


def test_an_address_of_a_simulation_that_does_not_exist_is_told(clock):
    with pytest.raises(DeviceError, match=r"@closed_machine.*no simulated rig"):
        open_channels(settings("@closed_machine"), OpenContext("channels.box", VirtualClock()))
