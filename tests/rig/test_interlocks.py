"""An open interlock of the virtual rig prevents a start, and ends a run in the safe state."""

import json
import math
from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np
import pytest

from drivers.errors import ConfigurationError
from rig import (
    InterlockCheck,
    RunFile,
    RunFileError,
    RunInterlock,
    plan_protocol,
    replay_run,
    run_protocol,
    verify_run,
)
from rig.errors import InterlockOpen
from rig.rigfile import read_rig
from simulators.rig.virtual_rig import VirtualRig
from tests.opened_rigs import opened_rigs
from tests.places import example

DOOR = """
[interlocks.door]
driver = "modbus-input"
address = "@interlocks"
number = 2
allowed_min = 1
"""
OVEN = """
[interlocks.oven]
driver = "modbus-input"
address = "@interlocks"
table = "input"
number = 0
scale = 0.1
quantity = "°C"
allowed_max = 40
"""


@pytest.fixture
def rigs() -> Iterator[list[VirtualRig]]:
    with opened_rigs() as opened:
        yield opened


def files_in(folder: Path) -> tuple[Path, Path, Path]:
    """Write a protocol and a rig file with a door and an oven; return their paths and a run file's path."""
    small = ('driver = "simulated-camera"', 'driver = "simulated-camera"\nwidth_px = 64\nheight_px = 64')
    (folder / "p.toml").write_text(example("tension"))
    (folder / "r.toml").write_text(example("rig-virtual-tension").replace(*small) + DOOR + OVEN)
    return folder / "p.toml", folder / "r.toml", folder / "run.h5"


@pytest.fixture
def files(tmp_path):
    return files_in(tmp_path)


def test_an_open_interlock_refuses_the_start_by_its_name(files, monkeypatch):
    build = VirtualRig.__init__

    def with_an_open_door(rig: VirtualRig, *args, **kwargs) -> None:
        build(rig, *args, **kwargs)
        rig.interlocks.set_contact(2, closed=False)

    monkeypatch.setattr(VirtualRig, "__init__", with_an_open_door)
    with pytest.raises(InterlockOpen, match="before the start: expected interlock door at least 1, got 0"):
        run_protocol(*files)
    assert not files[2].exists()


@pytest.mark.parametrize(
    ("happens", "said"),
    [
        (lambda module: module.set_contact(2, closed=False), "expected interlock door at least 1, got 0"),
        (lambda module: module.set_register(0, 401), "expected interlock oven at most 40 °C, got 40.1 °C"),
    ],
)
def test_an_interlock_that_opens_during_a_motion_ends_the_run_in_the_safe_state(files, rigs, happens, said):
    def on_progress(_may_move: bool) -> None:
        if rigs[0].load_frame.load_n() > 700.0:
            happens(rigs[0].interlocks)

    outcome = run_protocol(*files, on_progress=on_progress)
    assert outcome.status == "failed"
    assert said in outcome.reason
    assert outcome.unsafe == ()
    assert rigs[0].load_frame.executed[-1][1] == "hold"
    assert rigs[0].load_frame.load_n() < 800.0


def test_the_plan_names_what_each_interlock_allows(files):
    table = plan_protocol(*files[:2]).limits.table
    lines = [str(limit) for limit in table]
    assert "interlock door: at least 1 (the rig's interlocks.door.allowed_min)" in lines
    assert "interlock oven: at most 40 °C (the rig's interlocks.oven.allowed_max)" in lines
    row = next(row for row in table.rows() if row["quantity"] == "interlock oven")
    assert (row["unit"], row["least"], row["greatest"]) == ("°C", None, 40.0)


def test_an_interlock_without_a_condition_is_a_mistake_in_the_rig_file(files):
    text = files[1].read_text().replace("allowed_min = 1\n", "")
    files[1].write_text(text)
    with pytest.raises(ConfigurationError, match=r"interlocks\.door: allowed_min or allowed_max is expected"):
        read_rig(files[1])


def test_a_name_that_is_no_name_of_a_group_is_a_mistake_in_the_rig_file(files):
    files[1].write_text(files[1].read_text().replace("interlocks.door", 'interlocks."lab/door"'))
    with pytest.raises(ConfigurationError, match="a name of letters, digits and _ is expected, such as door"):
        read_rig(files[1])


@pytest.fixture(scope="module")
def hot(tmp_path_factory) -> Path:
    """The file of a run that ended under load, because the oven became hotter: 41 °C instead of 20 °C."""
    files = files_in(tmp_path_factory.mktemp("hot"))
    with opened_rigs() as rigs:

        def on_progress(_may_move: bool) -> None:
            loaded = rigs[0].load_frame.load_n() > 100.0
            rigs[0].interlocks.set_register(0, 410 if loaded else 200)

        outcome = run_protocol(*files, on_progress=on_progress)
    assert "expected interlock oven at most 40 °C, got 41 °C" in outcome.reason
    return files[2]


@pytest.fixture
def recorded(hot, tmp_path) -> Path:
    """A copy of the run file, which a test can change."""
    copy = tmp_path / "copy.h5"
    copy.write_bytes(hot.read_bytes())
    return copy


def test_every_reading_of_an_interlock_is_in_the_run_file_also_the_one_that_ended_the_run(recorded):
    with RunFile(recorded) as run:
        door, oven = run.columns("interlocks/door"), run.columns("interlocks/oven")
        frame = run.columns("instrument/load_frame")
        assert run.interlocks == {
            "door": RunInterlock("", 1.0, math.inf),
            "oven": RunInterlock("°C", -math.inf, 40.0),
        }
        assert run.identity("interlocks.oven")["model"] == "input 0 of unit 1"
    assert len(door["value"]) == len(oven["value"]) == len(frame["time_s"])
    assert (door["value"] == 1.0).all()
    # the first reading was taken before the oven was set to 20 °C
    assert oven["value"][1:-1] == pytest.approx(20.0)
    assert oven["value"][-1] == pytest.approx(41.0)
    # a reading of all devices belongs together: it was made before the next one of the load frame
    assert (oven["time_s"][:-1] <= frame["time_s"][1:]).all()
    assert (np.diff(oven["time_s"]) >= 0.0).all()


def test_the_settings_of_an_interlock_are_in_the_run_file(recorded):
    with h5py.File(recorded) as file:
        settings = json.loads(file["entry/interlocks/oven/settings"][()])
    assert settings["driver"] == "modbus-input"
    assert (settings["asked"]["table"], settings["asked"]["scale"]) == ("input", 0.1)


def test_a_replay_feeds_the_readings_of_interlocks_again_and_ends_with_the_same_words(recorded, tmp_path):
    replayed = replay_run(recorded, tmp_path / "new.h5")
    assert replayed.differences == []
    with RunFile(recorded) as run, RunFile(tmp_path / "new.h5") as new:
        assert replayed.outcome.reason == run.info.status_reason
        for name in ("door", "oven"):
            table = f"interlocks/{name}"
            np.testing.assert_array_equal(run.columns(table)["value"], new.columns(table)["value"])
        assert new.interlocks == run.interlocks


def test_a_replay_of_changed_readings_of_an_interlock_is_another_one(recorded, tmp_path):
    with h5py.File(recorded, "r+") as file:
        file["entry/interlocks/door/value"][20] = 0.0
    replayed = replay_run(recorded, tmp_path / "new.h5")
    assert "expected interlock door at least 1, got 0" in replayed.outcome.reason
    assert any(sentence.startswith("interlocks/door: ") for sentence in replayed.differences)


def test_verify_counts_the_readings_of_interlocks_and_misses_what_is_missing(recorded, tmp_path):
    found = verify_run(recorded)
    readings = found.interlocks["oven"].readings
    assert readings > 50
    assert found.interlocks == {"door": InterlockCheck(readings, 0), "oven": InterlockCheck(readings, 1)}
    assert not any("interlock door" in problem for problem in found.problems)
    with h5py.File(recorded, "r+") as file:
        del file["entry/interlocks/oven"]
        for name in ("value", "time_s", "order"):
            file[f"entry/interlocks/door/{name}"].resize((readings - 2,))
    problems = verify_run(recorded).problems
    assert "interlock oven: its readings are missing" in problems
    assert f"interlock door: {readings - 2} readings on file, {readings} of the machines" in problems


def test_verify_names_a_completed_run_that_went_on_beyond_the_range_of_an_interlock(recorded):
    with h5py.File(recorded, "r+") as file:
        file["entry/status"][()] = b"completed"
    assert "interlock oven: 1 readings are outside its range, but the run went on" in (
        verify_run(recorded).problems
    )


def test_a_run_file_without_interlocks_is_still_read(recorded):
    with h5py.File(recorded, "r+") as file:
        del file["entry/interlocks"]
    with RunFile(recorded) as run:
        assert run.interlocks == {}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda group: group.move("door", "..\\door"), "an interlock with the name"),
        (lambda group: group["door"].attrs.__delitem__("unit"), "the interlock door without unit"),
        (lambda group: group["door"].attrs.__setitem__("allowed_min", np.nan), "a range from nan to inf"),
        (lambda group: group["door/value"].resize((1,)), "1 rows of /entry/interlocks/door/value"),
        (lambda group: group.__delitem__("door/value"), "no data set /entry/interlocks/door/value"),
    ],
)
def test_a_damaged_table_of_an_interlock_is_named(recorded, change, said):
    with h5py.File(recorded, "r+") as file:
        change(file["entry/interlocks"])
    with pytest.raises(RunFileError, match=said):
        RunFile(recorded)
