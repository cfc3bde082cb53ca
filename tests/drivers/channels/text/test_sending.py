"""Instruments that send lines by themselves, line by line from the test's side of a pseudo-terminal."""

import itertools
import math
from collections.abc import Callable, Iterator
from contextlib import closing
from typing import Any

import pytest

from drivers.channels.text.sending import SendingText
from drivers.channels.text.settings import TextChannelSettings
from drivers.clock import SystemClock
from drivers.errors import DeviceFault, DeviceTimeout, LinkLost
from drivers.interfaces import OpenContext
from tests.drivers.channels.text.serial_sender import Sender

FORCE = {"unit": "N", "range": [-1000.0, 1000.0]}
WITH_BOTH = {
    "time": {"column": 1, "unit": "ms"},
    "counter": {"column": 2, "wraps_at": 256},
    "signals": {"force": {**FORCE, "column": 3}},
}
READ_S = 2.0
pytestmark = pytest.mark.realtime


@pytest.fixture
def sender() -> Iterator[Sender]:
    with closing(Sender()) as opened:
        yield opened


@pytest.fixture
def opened(sender: Sender) -> Iterator[Callable[..., SendingText]]:
    """A function that opens the instrument while it sends two lines, of which the first may be cut."""
    devices = []

    def open_with(*first: str, **changes: Any) -> SendingText:
        table = {"address": sender.path, "stream": True, "rate_hz": 10.0, "signals": {"force": FORCE}}
        settings = TextChannelSettings.model_validate({**table, **changes})
        with sender.saying_soon(*first):
            devices.append(SendingText(settings, OpenContext("channels.box", SystemClock())))
        return devices[-1]

    yield open_with
    for device in devices:
        device.close()


def test_each_line_is_a_sample_and_the_first_which_may_be_cut_is_none(opened, sender):
    device = opened("7.5", "1")
    sender.say("2", "3", "4")
    samples = [device.read(READ_S) for _ in range(3)]
    assert [float(sample.values[0, 0]) for sample in samples] == [2.0, 3.0, 4.0]
    assert [sample.first for sample in samples] == [1, 2, 3]
    for before, after in itertools.pairwise(samples):
        assert before.asked_s <= after.asked_s <= after.received_s
    # three lines in one piece: none of them is known to be later than the piece before
    assert samples[2].asked_s <= samples[0].received_s


def test_lines_wait_with_the_time_of_their_arrival(opened, sender):
    clock = SystemClock()
    device = opened("0", "1")
    sender.say("2")
    clock.sleep(0.3)
    sample = device.read(READ_S)
    assert clock.now_s() - sample.received_s > 0.2


def test_lines_with_a_time_come_as_one_block(opened, sender):
    device = opened("0,0,0", "10,1,1", **WITH_BOTH)
    sender.say(*(f"{10 * n},{n},{n}" for n in range(2, 7)))
    SystemClock().sleep(0.2)
    block = device.read(READ_S)
    assert block.values.ravel().tolist() == [2.0, 3.0, 4.0, 5.0, 6.0]
    assert block.device_s == pytest.approx([0.02, 0.03, 0.04, 0.05, 0.06])
    assert block.asked_s == -math.inf


def test_lost_repeated_and_damaged_lines_are_told_by_the_counter(opened, sender):
    device = opened("0,0,0", "10,253,1", **WITH_BOTH)
    sender.say("20,254,2", "20,254,2", "30,25", "x,y,z", "50,1,5", "60,2,6")
    SystemClock().sleep(0.2)
    first, second = device.read(READ_S), device.read(READ_S)
    assert first.values.ravel().tolist() == [2.0]
    # 255 and, after the counter began again, 0 are missing
    assert second.first == first.first + 3
    assert second.values.ravel().tolist() == [5.0, 6.0]


def test_a_damaged_line_is_a_lost_sample_without_a_counter(opened, sender):
    device = opened("0", "1")
    sender.say("2", "3\x00\x80", "4")
    assert [device.read(READ_S).first for _ in range(2)] == [1, 3]


def test_a_time_that_wraps_goes_on(opened, sender):
    time = {"column": 1, "unit": "ms", "wraps_at": 1000.0}
    device = opened("0,0", "980,1", time=time, signals={"force": {**FORCE, "column": 2}})
    sender.say("990,2", "0,3", "10,4")
    SystemClock().sleep(0.2)
    assert device.read(READ_S).device_s == pytest.approx([0.99, 1.0, 1.01])


def test_a_restart_is_told_once_after_the_samples_before_it(opened, sender):
    device = opened("0,0,0", "5000,1,1", **WITH_BOTH)
    sender.say("5010,2,2", "10,1,3", "20,2,4")
    SystemClock().sleep(0.2)
    before = device.read(READ_S)
    assert before.values.ravel().tolist() == [2.0]
    with pytest.raises(DeviceFault, match="a counter that went back from 2 to 1"):
        device.read(READ_S)
    after = device.read(READ_S)
    assert after.first > before.first + 1
    assert after.values.ravel().tolist() == [3.0, 4.0]
    # rounded
    assert after.device_s[0] > before.device_s[-1] - 1e-9


def test_what_is_declared_as_no_sample_is_left_out(opened, sender):
    device = opened("Load cell 1.0", "tare ...", "0", ignore=["Load cell .*", r"tare \.\.\."])
    sender.say("tare ...", "2")
    assert device.read(READ_S).first == 1


def test_an_instrument_is_identified_between_its_lines(opened, sender):
    check = {"query": "ID", "pattern": "load cell .*"}
    device = opened("0", "1", "load cell 3", "2", identification=check, opening=["RUN"])
    assert sender.heard(7) == b"ID\nRUN\n"
    assert device.info.model == "load cell 3"
    device.close()
    with pytest.raises(DeviceTimeout, match="got 'scale 7'"):
        opened("scale 7", "1", "2", identification=check)


def test_lines_that_do_not_fit_are_shown_instead_of_silence(opened, sender):
    with pytest.raises(DeviceTimeout, match=r"got '1;2' with '1;2' instead of a number; check .*baud rate"):
        opened("0", "1;2")
    with pytest.raises(DeviceTimeout, match="got silence"):
        opened()


def test_a_line_that_is_gone_is_told_and_its_samples_before_are_kept(opened, sender):
    device = opened("0", "1")
    sender.say("2")
    SystemClock().sleep(0.2)
    sender.close()
    assert device.read(READ_S).values == 2.0
    with pytest.raises(LinkLost):
        device.read(READ_S)
    with pytest.raises(LinkLost, match="expected a free serial port"):
        device.read(READ_S)
    sender.__init__()
