"""Instruments that are asked: the right one, its errors, late answers, restarts and slow starts."""

import math
from collections.abc import Callable, Iterator
from contextlib import closing
from typing import Any

import pytest

from drivers.channels.text.asked import AskedText
from drivers.channels.text.driver import open_channels
from drivers.channels.text.settings import TextChannelSettings
from drivers.clock import SystemClock, VirtualClock
from drivers.errors import DeviceFault, DeviceTimeout, LinkLost
from drivers.interfaces import OpenContext
from simulators.instrument.meter import Meter, MeterServer

FORCE = {"unit": "N", "range": [-1000.0, 1000.0]}
IDENTIFICATION = {"query": "*IDN?", "pattern": "SIMULATED,.*"}
ERRORS = {"query": "SYST:ERR?", "pattern": "0,.*"}


@pytest.fixture
def meter(clock: VirtualClock) -> Meter:
    return Meter(clock, {"force": 1.0})


@pytest.fixture
def server(meter: Meter) -> Iterator[MeterServer]:
    with closing(MeterServer(meter)) as opened:
        yield opened


@pytest.fixture
def opened(server: MeterServer, clock: VirtualClock) -> Iterator[Callable[..., Any]]:
    devices = []

    def open_with(**changes: object) -> Any:
        table = {"query": "READ?", "rate_hz": 10.0, "signals": {"force": FORCE}, "reply_timeout_s": 0.15}
        settings = TextChannelSettings.model_validate({"address": server.address, **table, **changes})
        devices.append(open_channels(settings, OpenContext("channels.box", clock)))
        return devices[-1]

    yield open_with
    for device in devices:
        device.close()


def test_an_instrument_tells_maker_model_number_and_firmware(opened):
    info = opened(identification=IDENTIFICATION).info
    assert (info.vendor, info.model, info.serial, info.firmware) == (
        *("SIMULATED", "Two-channel meter", "S-0007", "1.0"),
    )


def test_another_instrument_is_refused_before_it_is_commanded(opened, meter):
    with pytest.raises(DeviceTimeout, match=r"got 'SIMULATED.* instead of an answer that fits .*KEITHLEY"):
        opened(identification={"query": "*IDN?", "pattern": "KEITHLEY.*"}, opening=["*RST"])
    assert meter.commands == []


def test_an_opening_command_that_the_instrument_does_not_know_is_told(opened):
    said = (
        r"check the opening commands: expected .*fits the pattern '0,\.\*', got '-113,\"Undefined header\"'"
    )
    with pytest.raises(DeviceFault, match=said):
        opened(opening=["*CLS", "CNOF:VOLT"], errors=ERRORS)
    assert opened(opening=["*CLS", "CONF:VOLT"], errors=ERRORS).read(1.0).values == 1.0


def test_a_query_that_the_instrument_does_not_know_is_told(opened):
    with pytest.raises(DeviceTimeout, match=r"send 'RAED\?': .* got silence; check .* query and pattern"):
        opened(query="RAED?")


def test_a_line_that_does_not_fit_is_shown(opened):
    with pytest.raises(DeviceTimeout, match=r"got '\+1\.00.*', which does not fit the pattern 'F=\(\.\*\)'"):
        opened(signals={"force": {**FORCE, "pattern": "F=(.*)"}})


@pytest.mark.parametrize("proof", [{}, {"identification": IDENTIFICATION}], ids=["unproven", "proven"])
@pytest.mark.parametrize(
    "fault", ["late:1", "delay:0.4:1", "drop:1", "duplicate:1", "lose-request:1", "split:1"]
)
def test_a_single_fault_neither_ends_the_reading_nor_makes_it_wrong(opened, meter, server, fault, proof):
    device = opened(**proof)
    for count in range(4):
        meter.show("force", 10.0 * count)
        if count == 1:
            server.faults.switch_on(fault)
        assert device.read(2.0).values == 10.0 * count


def test_every_late_answer_is_refused_if_the_instrument_can_be_identified(opened, meter, server):
    device = opened(identification=IDENTIFICATION)
    server.faults.switch_on("late")
    for count in range(3):
        meter.show("force", 10.0 * count)
        with pytest.raises(DeviceTimeout):
            device.read(0.6)
    server.faults.clear()
    assert device.read(2.0).values == 20.0


@pytest.mark.realtime
def test_an_answer_that_takes_longer_than_a_call_is_fetched_by_a_later_one(server, meter):
    clock = SystemClock()
    table = {"query": "READ?", "rate_hz": 2.0, "reply_timeout_s": 1.0, "signals": {"force": FORCE}}
    settings = TextChannelSettings(address=server.address, **table)
    with closing(AskedText(settings, OpenContext("channels.box", clock))) as device:
        server.faults.switch_on("delay:0.4")
        device.read(2.0)
        samples, silences = [], 0
        while len(samples) < 2:
            meter.show("force", float(len(samples)))
            try:
                samples.append(device.read(0.1))
            except DeviceTimeout:
                silences += 1
    assert silences > 2
    assert samples[1].received_s - samples[1].asked_s == pytest.approx(0.4, abs=0.1)
    assert samples[1].values == 1.0


def test_samples_come_at_the_rate_and_carry_the_time_of_their_question(opened, clock):
    device = opened(rate_hz=4.0)
    times_s = [device.read(1.0).asked_s for _ in range(5)]
    assert times_s == pytest.approx([times_s[0] + 0.25 * n for n in range(5)])
    with pytest.raises(DeviceTimeout, match="a rate of 4 Hz"):
        device.read(0.05)


def test_a_lost_line_is_opened_and_set_up_again(opened, server, meter):
    device = opened(opening=["CONF:VOLT"], identification=IDENTIFICATION)
    server.faults.switch_on("unplug")
    for _ in range(2):
        with pytest.raises(LinkLost):
            device.read(0.5)
    server.faults.clear()
    assert device.read(2.0).values == 1.0
    assert meter.commands == ["CONF:VOLT", "CONF:VOLT"]


def test_an_instrument_that_starts_slowly_is_waited_for(opened, clock, server):
    before_s = clock.now_s()
    device = opened(start_s=2.5)
    assert clock.now_s() - before_s == pytest.approx(2.5)
    server.faults.switch_on("unplug")
    with pytest.raises(LinkLost):
        device.read(0.5)
    server.faults.clear()
    with pytest.raises(DeviceTimeout, match="an instrument that is still starting"):
        device.read(0.5)
    clock.sleep(2.0)
    assert device.read(2.0).values == 1.0


@pytest.fixture
def with_time(server: MeterServer) -> Iterator[AskedText]:
    """An instrument whose answers have its own time, on the real clock."""
    clock = SystemClock()
    server.meter = Meter(clock, {"force": 1.0})
    settings = TextChannelSettings(
        address=server.address,
        query="TIME?",
        rate_hz=200.0,
        reply_timeout_s=0.15,
        time={"column": 1, "unit": "ms"},
        signals={"force": {**FORCE, "column": 2}},
    )
    with closing(AskedText(settings, OpenContext("channels.box", clock))) as device:
        yield device


@pytest.mark.realtime
def test_an_old_answer_with_a_time_is_true_at_this_time_and_comes_once(with_time, server):
    """The fault lets the meter send the answer before, which then is older than the question."""
    server.faults.switch_on("stale")
    shown_s, last_s = [], with_time.read(2.0).device_s[0]
    for count in range(5):
        server.meter.show("force", 10.0 * count)
        shown_s.append(float(server.meter.answer("TIME?").split(",")[0]) / 1000.0)
        sample = with_time.read(2.0)
        assert sample.device_s[0] > last_s
        last_s = sample.device_s[0]
        before = [n for n, time_s in enumerate(shown_s) if time_s <= last_s]
        assert sample.values == (10.0 * before[-1] if before else 1.0)


@pytest.mark.realtime
def test_a_restart_is_told_once_and_the_time_goes_on(with_time, server):
    before = with_time.read(1.0)
    server.meter.restart()
    with pytest.raises(DeviceFault, match="a clock that went back from"):
        with_time.read(1.0)
    after = with_time.read(1.0)
    passed_s = after.received_s - before.received_s
    assert after.device_s[0] - before.device_s[0] == pytest.approx(passed_s, abs=0.02)


def test_a_broken_sensor_is_no_number(opened, meter):
    device = opened()
    meter.break_sensor()
    assert math.isnan(device.read(1.0).values[0, 0])
