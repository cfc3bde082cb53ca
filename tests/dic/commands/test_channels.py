"""`dic channels` writes each sample of a run with the time at which the quantity had its value."""

import csv

import numpy as np
import pytest

from drivers.interfaces import DeviceInfo
from drivers.signals import Signal
from rig.recorder import Recorder
from rig.recorder.records import ChannelsRecord, SignalRecord
from rig.samples import TimedSamples
from tests.command_line import refusal, run_dic
from tests.run_files import CAMERAS, HEADER, START, write_run

INFO = DeviceInfo("v", "m", "s")
FORCE = Signal("force", "N", -2e3, 1e5, 0.1, 0.003)
WAY = Signal("way", "mm", -10.0, 10.0)
OVEN = Signal("oven", "°C", -50.0, 400.0, 0.5)


@pytest.fixture
def run(tmp_path):
    """A box of two signals with 100 samples per second, of which three are lost, and a slow thermometer."""
    path = tmp_path / "run.h5"
    devices = {
        "box": ChannelsRecord(INFO, (SignalRecord(FORCE, "load"), SignalRecord(WAY))),
        "oven": ChannelsRecord(INFO, (SignalRecord(OVEN),)),
    }
    recorder = Recorder(path, HEADER, CAMERAS, channels=devices)
    for first in (0, 53):
        at_s = 0.01 * (first + np.arange(50)) + 7.0
        values = np.stack([1000.0 * at_s, 0.5 - at_s], axis=1)
        recorder.samples("box", TimedSamples(values, at_s, np.full(50, 0.004), at_s, first))
    for number in range(2):
        at_s = np.array([7.6 + number])
        value = np.array([[np.nan if number else 23.46]])
        recorder.samples("oven", TimedSamples(value, at_s, np.zeros(1), at_s, number))
    recorder.close("completed", "", START)
    return path


def rows(path, **options):
    with path.open(newline="", encoding="utf-8-sig") as file:
        return list(csv.DictReader(file, **options))


def test_the_channels_are_told(run, tmp_path):
    done = run_dic("channels", run, "--json", tmp_path / "c.json")
    assert done.status == 0
    assert "force [N] of box: 100 samples, 3 lost, " in done.out
    assert "delay 0.1 ± 0.003 s" in done.out
    force, _, oven = done.report["channels"]
    assert (force["samples"], force["lost"], force["greatest"]) == (100, 3, pytest.approx(8020.0))
    assert force["rate_hz"] == pytest.approx(99 / 1.02)
    assert (oven["least"], oven["greatest"], done.report["lines"]) == (23.46, 23.46, None)


def test_each_value_stands_at_the_time_of_its_quantity(run, tmp_path):
    done = run_dic("channels", run, "-o", tmp_path / "all.csv")
    assert done.status == 0
    assert "202 lines" in done.out
    found = rows(tmp_path / "all.csv")
    assert list(found[0]) == ["time_s", "time_std_s", "force [N]", "way [mm]", "oven [°C]"]
    times_s = np.array([float(row["time_s"]) for row in found])
    assert len(found) == 202
    assert (np.diff(times_s) >= 0.0).all()
    force = [row for row in found if row["force [N]"]]
    assert len(force) == 100
    # the sample of 7.0 s shows the load of 6.9 s
    assert (force[0]["time_s"], force[0]["time_std_s"]) == ("6.900000", "0.005000")
    assert (float(force[0]["force [N]"]), force[0]["way [mm]"]) == (7000.0, "")
    (way, *_) = [row for row in found if row["way [mm]"]]
    assert (way["time_s"], way["time_std_s"], float(way["way [mm]"])) == ("7.000000", "0.004000", -6.5)
    # an invalid value is an empty cell
    assert [row["time_s"] for row in found if row["oven [°C]"]] == ["7.100000"]


def test_one_signal_with_decimal_commas(run, tmp_path):
    path = tmp_path / "way.csv"
    assert run_dic("channels", run, "-o", path, "--signal", "channels.way", "--decimal-comma").status == 0
    found = rows(path, delimiter=";")
    assert list(found[0]) == ["time_s", "time_std_s", "way [mm]"]
    assert found[1] == {"time_s": "7,010000", "time_std_s": "0,004000", "way [mm]": "-6,51"}


def test_what_is_not_there_is_refused_in_one_sentence(run, tmp_path):
    said = refusal("channels", run, "-o", tmp_path / "x.csv", "--signal", "froce")
    assert "expected the channels froce, got force, way, oven; correct the name" in said
    bare = write_run(tmp_path / "bare.h5")
    assert run_dic("channels", bare).out == "the run has no measured channels\n"
    assert "a run without channels" in refusal("channels", bare, "-o", tmp_path / "x.csv")
    assert "only with -o" in run_dic("channels", run, "--signal", "way").err
    assert not (tmp_path / "x.csv").exists()
