"""`rig check` reads channels, tells their values, noise, rate and losses, and gives no pulse."""

from dataclasses import replace

import numpy as np
import pytest

from drivers.clock import VirtualClock
from drivers.errors import DeviceTimeout
from rig.commands.check import check_rig
from rig.devices import OpenedTrigger, Rig
from tests.command_line import run_rig
from tests.rig.channels.fake_box import FORCE, FakeBox, FakeLine
from tests.rig.closed_rig import write_rig
from tests.rig.conftest import FakeOperator


def checked(clock=None, **box):
    clock = clock or VirtualClock()
    device = FakeBox(clock, box.pop("force_n", lambda t: 100.0), **box)
    rig = Rig(clock, FakeOperator([]), {}, channels={"box": device}, measured={"load": "force"})
    return check_rig(rig), rig


def test_values_noise_rate_and_range_are_told():
    noise = np.random.default_rng(1)
    found, _ = checked(force_n=lambda t: 100.0 * t + noise.normal(0.0, 7.0), rate_hz=200.0)
    assert (found.problems, found.failed) == ([], {})
    table = found.devices["channels.box"]
    assert table["signals"]["force"]["noise"] == pytest.approx(7.0, rel=0.15)
    assert table["state"]["reached_hz"] == pytest.approx(200.0, rel=0.01)
    assert table["state"]["lost"] == 0
    assert any("range -1000 to 20000 N, taken as the load of the load frame" in line for line in found.lines)


def test_a_slow_device_is_read_for_longer():
    found, rig = checked(rate_hz=2.0)
    assert found.devices["channels.box"]["state"]["samples"] >= 20
    assert rig.clock.now_s() > 9.0


def test_lost_samples_a_low_rate_and_more_noise_than_declared_are_problems():
    noise = np.random.default_rng(1)
    found, _ = checked(
        force_n=lambda t: noise.normal(0.0, 7.0),
        signals=(replace(FORCE, std=1.0),),
        on_read=lambda count, s: replace(s, first=s.first + 5 * (count > 30)),
    )
    assert any("5 samples were lost" in problem for problem in found.problems)
    assert any("the noise is" in problem and "std = 1 is declared" in problem for problem in found.problems)
    clock = VirtualClock()
    box = FakeBox(clock, lambda t: 1.0, rate_hz=50.0)
    box.read = lambda timeout_s, read=box.read: (clock.sleep(0.1), read(timeout_s))[1]
    slow = Rig(clock, FakeOperator([]), {}, channels={"box": box})
    assert any("rate_hz = 50 is asked for" in problem for problem in check_rig(slow).problems)


def test_values_out_of_range_and_no_values_are_problems_and_still_shown():
    found, _ = checked(on_read=lambda count, s: replace(s, values=s.values * np.nan))
    assert "channels.force: it is no valid value, expected -1000 to 20000 N" in found.problems[0]
    assert found.devices["channels.box"]["signals"]["force"]["newest"] is None
    found, _ = checked(force_n=lambda t: 30e3)
    assert "channels.force: it is 30000 N" in found.problems[0]
    assert found.devices["channels.box"]["signals"]["force"]["newest"] == 30e3


def test_a_fault_is_one_sentence_and_the_other_devices_are_checked():
    def on_read(count, samples):
        raise DeviceTimeout("channels.box", "read", "an answer", "none", "check the cable")

    clock = VirtualClock()
    line = FakeLine(clock)
    devices = {"box": FakeBox(clock, lambda t: 1.0, on_read=on_read), "other": FakeBox(clock, lambda t: 2.0)}
    rig = Rig(clock, FakeOperator([]), {}, channels=devices, triggers={"logger": OpenedTrigger(line, "step")})
    found = check_rig(rig)
    assert list(found.failed) == ["channels.box"]
    assert found.devices["channels.other"]["signals"]["force"]["newest"] == 2.0
    assert found.devices["triggers.logger"]["state"] == {"at": "step"}
    assert line.pulses_s == []


def test_the_command_on_a_virtual_closed_machine(tmp_path):
    done = run_rig("check", write_rig(tmp_path), "--json", tmp_path / "check.json")
    assert "channels.box: " in done.out
    table = done.report["devices"]["channels.box"]
    assert table["state"]["reached_hz"] == pytest.approx(50.0, rel=0.05)
    assert abs(table["signals"]["force"]["newest"]) < 50e3
    assert done.report["failed"] == {}
