"""Blocks, numbers, times and errors of the driver `nidaqmx-channels`, with an imitation of the library."""

import sys

import numpy as np
import pytest
from pydantic import ValidationError

from drivers.channels.nidaqmx.channels import open_channels
from drivers.channels.nidaqmx.settings import NidaqmxSettings
from drivers.errors import DeviceFault, DeviceTimeout, LinkLost
from drivers.interfaces import OpenContext
from drivers.settings import mistakes_in
from tests.drivers.channels.nidaqmx.conftest import FORCE, TRAVEL
from tests.drivers.channels.nidaqmx.fake_nidaqmx import (
    DaqReadError,
    OverwriteMode,
    TerminalConfiguration,
)

NUMBER = {"input": "ai0", "unit": "1", "range": [-1, 1]}


@pytest.fixture
def numbered(daq, open_device):
    """The device with one input that shows the number of the sample."""
    daq.numbered.add("ai0")
    return open_device(signals={"number": NUMBER})


def assert_true(samples):
    true = np.arange(samples.first, samples.first + len(samples.values))
    assert samples.values[:, 0].tolist() == true.tolist()
    assert samples.device_s == pytest.approx(true / 1000.0)


def test_inputs_are_made_as_the_rig_file_says(daq, open_device):
    device = open_device()
    (task,) = daq.tasks
    assert task.channels == [
        {"name": "ai0", "terminals": TerminalConfiguration.DIFF, "low": -10.0, "high": 10.0},
        {"name": "ai3", "terminals": TerminalConfiguration.DEFAULT, "low": -5.0, "high": 5.0},
    ]
    assert (task.buffer, task.overwrite) == (10_000, OverwriteMode.OVERWRITE_UNREAD_SAMPLES)
    assert (device.info.model, device.info.serial) == ("USB-6001", "1A2B3C")


def test_blocks_follow_each_other_without_a_gap(daq, numbered):
    first = numbered.read(1.0)
    assert (first.first, len(first.values)) == (0, 50)
    daq.clock.sleep(0.733)
    behind = numbered.read(1.0)
    assert (behind.first, len(behind.values)) == (50, 733)
    for samples in (first, behind, numbered.read(1.0)):
        assert_true(samples)


def test_the_rate_that_the_device_chose_gives_the_times(daq, open_device):
    daq.coerced_hz = 1024.0
    device = open_device()
    assert device.rate_hz == 1024.0
    assert np.diff(device.read(1.0).device_s) == pytest.approx(1 / 1024.0)


def test_overwritten_samples_leave_a_gap_of_their_number(daq, numbered):
    before = numbered.read(1.0)
    daq.clock.sleep(12.0)
    newest, after = numbered.read(1.0), numbered.read(1.0)
    assert newest.first == before.first + 50 + 12_000 - 50
    assert after.first == newest.first + len(newest.values)
    for samples in (newest, after):
        assert_true(samples)


def test_a_part_of_a_block_is_returned_if_the_time_is_over(daq, numbered):
    part = numbered.read(0.0205)
    assert len(part.values) == 20
    assert_true(part)
    rest = numbered.read(1.0)
    assert rest.first == 20
    assert_true(rest)


def test_a_part_of_a_block_keeps_the_inputs_apart(open_device):
    assert open_device().read(0.0105).values.tolist() == 10 * [[12_500.0, 18.0]]


def test_a_clock_that_stands_still_is_told_and_nothing_is_lost(daq, numbered):
    before = numbered.read(1.0)
    daq.clocked = False
    with pytest.raises(DeviceTimeout, match=r"channels\.ni \(Dev1\): read: .*-200284.*sample clock"):
        numbered.read(0.5)
    daq.clocked = True
    after = numbered.read(1.0)
    assert after.first == before.first + len(before.values)


def test_an_unplugged_device_goes_on_by_the_clock_of_the_rig(daq, numbered):
    before = numbered.read(1.0)
    daq.plugged = False
    for _ in range(2):
        with pytest.raises(LinkLost, match="check the cable"):
            numbered.read(0.5)
    daq.clock.sleep(3.0)
    daq.plugged = True
    after = numbered.read(1.0)
    assert after.first == pytest.approx(before.first + len(before.values) + 3000, abs=1)
    assert after.device_s[0] - before.device_s[-1] == pytest.approx(3.0, abs=0.002)
    assert after.values[:, 0].tolist() == list(range(50))


def test_lost_samples_after_a_new_start_are_counted_from_it(daq, numbered):
    numbered.read(1.0)
    daq.plugged = False
    with pytest.raises(LinkLost):
        numbered.read(0.5)
    daq.plugged = True
    again = numbered.read(1.0)
    daq.clock.sleep(15.0)
    assert numbered.read(1.0).first == again.first + 15_000


def test_every_other_error_is_a_fault_with_its_number(daq, numbered, monkeypatch):
    def overflow(*_):
        raise DaqReadError("Onboard device memory overflow.", -200361, 0)

    monkeypatch.setattr(daq.tasks[0], "fetched", overflow)
    with pytest.raises(DeviceFault, match=r"Onboard device memory overflow \(NI-DAQmx -200361\)"):
        numbered.read(1.0)
    assert daq.open_tasks == 0
    assert len(numbered.read(1.0).values) == 50


@pytest.mark.parametrize(
    ("table", "kind", "said"),
    [
        ({"device": "Dev2"}, LinkLost, r"a device called Dev2.*-200220"),
        ({"signals": {"a": NUMBER | {"input": "ai9"}}}, DeviceFault, r"inputs ai9 at 1000 Hz.*ai9"),
    ],
)
def test_a_device_or_an_input_that_is_not_there_is_told(open_device, table, kind, said):
    with pytest.raises(kind, match=said):
        open_device(**table)


def test_an_error_while_closing_a_device_that_is_gone_is_not_raised(daq, open_device):
    device = open_device()
    daq.plugged = False
    device.close()
    assert daq.open_tasks == 0


def test_a_missing_package_is_told_in_one_sentence(monkeypatch, clock):
    monkeypatch.setitem(sys.modules, "nidaqmx", None)
    settings = NidaqmxSettings.model_validate({"device": "Dev1", "rate_hz": 10.0, "signals": {"a": FORCE}})
    with pytest.raises(DeviceFault, match=r'channels\.ni: load .*install it: pip install "offaxis\[daqmx\]"'):
        open_channels(settings, OpenContext("channels.ni", clock))


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ({"rate_hz": 0.5}, "greater than or equal to 1"),
        ({"device": "Dev1/ai0"}, "match pattern"),
        ({"signals": {"a": FORCE | {"input": "dac0"}}}, "match pattern"),
        ({"signals": {"a": FORCE | {"range": [-60e3, 60e3]}}}, "within -50000 to 50000 N is expected"),
        ({"signals": {"a": TRAVEL | {"volts": 1.0}}}, "within 18 to 22 mm is expected"),
        ({"signals": {"a": FORCE | {"terminals": "single"}}}, "'differential'"),
    ],
)
def test_mistakes_in_the_rig_file_are_told(table, said):
    given = {"device": "Dev1", "rate_hz": 10.0, "signals": {"a": FORCE}} | table
    with pytest.raises(ValidationError) as raised:
        NidaqmxSettings.model_validate(given)
    assert said in " ".join(mistakes_in(raised.value, "channels.ni"))
