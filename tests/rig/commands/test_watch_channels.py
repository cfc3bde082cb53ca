"""`rig channels` shows the present values of all channels without a run, and keeps all samples."""

import csv
import signal
import subprocess
import time
from dataclasses import replace

import numpy as np
import pytest

from drivers.clock import VirtualClock
from drivers.errors import DeviceFault
from rig.commands.watch_channels import ChannelWatch, lines_of
from rig.devices import Rig
from rig.errors import RigError
from tests.command_line import RIG, run_rig
from tests.rig.channels.fake_box import FORCE, FakeBox
from tests.rig.closed_rig import write_rig
from tests.rig.conftest import FakeOperator


def watch(table=None, force_n=lambda t: 100.0, **box) -> tuple[ChannelWatch, Rig]:
    clock = VirtualClock()
    rig = Rig(clock, FakeOperator([]), {}, channels={"box": FakeBox(clock, force_n, **box)})
    return ChannelWatch(rig, table), rig


def test_the_numbers_are_those_of_the_last_seconds():
    noise = np.random.default_rng(1)
    watching, rig = watch(
        force_n=lambda t: 100.0 * max(0.0, t - 20.0) + noise.normal(0.0, 7.0), rate_hz=200.0
    )
    with watching.reading():
        watching.wait(30.0)
        (now,) = watching.now()
    assert now.value == pytest.approx(100.0 * (rig.clock.now_s() - 20.0 - 0.1), abs=40.0)
    assert now.noise == pytest.approx(7.0, rel=0.25)
    assert now.rate_hz == pytest.approx(200.0, rel=0.01)
    assert now.samples == pytest.approx(6000, rel=0.02)
    assert now.is_good
    (line,) = lines_of([now])
    assert "N, noise " in line
    assert "range -1000 to 20000" in line
    assert "200 of 200 per s, 0 lost, time ± " in line


def test_a_value_out_of_range_and_lost_samples_are_shown_and_do_not_end_it():
    watching, _ = watch(
        force_n=lambda t: 1e5, on_read=lambda count, s: replace(s, first=s.first + 5 * (count > 30))
    )
    with watching.reading():
        watching.wait(5.0)
        (now,) = watching.now()
    assert "OUT OF RANGE" in now.line(5)
    assert (now.lost, now.is_good) == (5, False)


def test_all_samples_are_in_the_table_with_the_delay_subtracted(tmp_path):
    table = tmp_path / "live.csv"
    watching, _ = watch(table, force_n=lambda t: 10.0 * t, signals=(replace(FORCE, delay_s=0.25),))
    with watching.reading():
        watching.wait(4.0)
    (now,) = watching.now()
    with table.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == now.samples
    assert list(rows[0]) == ["time_s", "time_std_s", "force [N]"]
    times_s = np.array([float(row["time_s"]) for row in rows])
    values = np.array([float(row["force [N]"]) for row in rows])
    np.testing.assert_allclose(np.diff(times_s), 1 / 50, atol=1e-3)
    assert np.polyfit(times_s, values, 1)[0] == pytest.approx(10.0, rel=1e-3)


def test_a_device_that_fails_and_a_full_disk_end_it_in_one_sentence(tmp_path):
    def broken(count, samples):
        if count > 50:
            raise DeviceFault("channels.box", "read", "a value", "none", "check the box")
        return samples

    watching, _ = watch(on_read=broken)
    with pytest.raises(DeviceFault, match="check the box"), watching.reading():
        watching.wait(60.0)
    watching, _ = watch(tmp_path / "t.csv")
    full = OSError(28, "No space left on device")

    def add(*_):
        raise full

    with watching.reading():
        watching._table.add = add
        with pytest.raises(RigError, match=r"t\.csv: .*No space left"):
            watching.wait(5.0)


def test_the_command_in_simulated_time(tmp_path):
    done = run_rig(
        *("channels", write_rig(tmp_path), "--csv", tmp_path / "c.csv", "--json", tmp_path / "c.json"),
    )
    assert (done.status, done.err) == (0, "")
    (force,) = done.report["channels"]
    assert (force["signal"], force["unit"], force["device"]) == ("force", "N", "box")
    assert force["rate_hz"] == pytest.approx(50.0, rel=0.01)
    assert force["samples"] >= 500
    assert f"c.csv: {force['samples']} samples" in done.out
    assert "exists" in run_rig("channels", write_rig(tmp_path), "--csv", tmp_path / "c.csv").err


def test_a_rig_without_channels_is_refused(tmp_path):
    rig_file = write_rig(tmp_path)
    text = rig_file.read_text()
    rig_file.write_text(text[: text.index("[channels.box]")] + text[text.index("[operator]") :])
    done = run_rig("channels", rig_file)
    assert done.status == 2
    assert "a rig with tables [channels.NAME]" in done.err


@pytest.mark.realtime
def test_ctrl_c_ends_it_with_the_last_values(tmp_path):
    rig_file = write_rig(tmp_path, ('driver = "virtual-rig"', 'driver = "virtual-rig"\nreal_time = true'))
    program = subprocess.Popen(
        [*RIG, "channels", str(rig_file)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        assert "until Ctrl-C" in program.stderr.readline()
        time.sleep(3.0)
        program.send_signal(signal.SIGINT)
        out, _ = program.communicate(timeout=60.0)
    finally:
        program.kill()
        program.wait()
    assert program.returncode in (0, 1)
    assert out.startswith("force ")
