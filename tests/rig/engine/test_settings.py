"""The run file has the settings that every device reports, before the first image and at the end."""

import json
import threading

import h5py
import pytest

from dic.errors import RunFileError
from dic.runfile.reader import RunFile
from drivers.errors import DeviceTimeout
from rig.commands.verify import verify_run
from rig.devices import OpenedInterlock
from rig.engine.settings import READING_S
from rig.engine.status import EngineStatus
from tests.rig.conftest import FakeInterlock, FakeRig, in_real_time

SPEED = {"speed_deg_s": 10.0, "firmware": "7.38", "axis": 1, "always_checksum": True}


class Reporting:
    """A function `read_settings` that returns the given tables one after the other, and repeats the last."""

    def __init__(self, *tables: object) -> None:
        self.tables = list(tables)
        self.calls = 0

    def __call__(self) -> object:
        self.calls += 1
        table = self.tables.pop(0) if len(self.tables) > 1 else self.tables[0]
        if isinstance(table, Exception):
            raise table
        return table


def silence() -> DeviceTimeout:
    return DeviceTimeout("stage", "read settings", "an answer within 1 s", "silence", "check the cable")


def test_settings_are_on_file_from_the_start_and_from_the_end(rotation: FakeRig):
    rotation.stage.read_settings = Reporting(SPEED)
    rotation.cameras["off_axis"].read_settings = Reporting({"gain": 2.5})
    assert rotation.engine().run().status == "completed"
    with RunFile(rotation.path) as run:
        for moment in ("start", "end"):
            assert run.settings("stage", moment) == SPEED
            assert run.settings("off_axis", moment) == {"gain": 2.5}
            assert run.settings("on_axis", moment) == {}
        first_image = min(run.columns("instrument/off_axis")["order"])
        table = run.columns("settings")
        starts = table["order"][table["moment"] == b"start"]
        assert max(starts) < first_image
    assert rotation.stage.read_settings.calls == 2
    assert not [message for message in rotation.events() if "at the start, and is" in message]


def test_a_setting_that_differs_at_the_end_is_a_warning(rotation: FakeRig):
    later = {"speed_deg_s": 4.0, "firmware": "7.38", "axis": 1, "resolution": 64}
    rotation.stage.read_settings = Reporting(SPEED, later)
    assert rotation.engine().run().status == "completed"
    with h5py.File(rotation.path) as file:
        events = file["entry/events"]
        pairs = zip(events["level"][()], events["message"][()], strict=True)
        warnings = [message.decode() for level, message in pairs if level == b"warning"]
    assert warnings == [
        "stage: always_checksum was true at the start, and is missing at the end",
        "stage: resolution was missing at the start, and is 64 at the end",
        "stage: speed_deg_s was 10.0 at the start, and is 4.0 at the end",
    ]


def test_a_device_that_reports_nothing_at_the_start_ends_the_run_before_anything_moves(rotation: FakeRig):
    rotation.stage.read_settings = Reporting(silence())
    outcome = rotation.engine().run()
    assert (outcome.status, outcome.steps_done) == ("failed", 0)
    assert "got silence" in outcome.reason
    assert "home" not in rotation.calls
    assert rotation.cameras["on_axis"].grabs == 0


@pytest.mark.parametrize("error", [silence(), ValueError("no idea")])
def test_a_device_that_reports_nothing_at_the_end_is_a_warning_of_a_completed_run(rotation: FakeRig, error):
    rotation.stage.read_settings = Reporting(SPEED, error)
    assert rotation.engine().run().status == "completed"
    begin = "stage: its settings are unknown at the end: stage: "
    assert [m for m in rotation.events() if m.startswith(begin) and str(error.args[0]) in m]
    assert verify_run(rotation.path).problems == []


def test_a_call_that_hangs_ends_the_run_at_its_deadline(rotation: FakeRig):
    rotation.stage.read_settings = lambda: rotation.clock.sleep(1e6)
    outcome = rotation.engine().run()
    assert f"stage: read settings: expected the end of the call within {READING_S:g} s" in outcome.reason
    assert outcome.lost_devices[0].startswith("stage: its driver hangs in read settings")


def test_settings_of_a_failed_run_are_read_after_the_safe_state(rotation: FakeRig):
    rotation.stage.read_settings = Reporting(SPEED)
    stop = rotation.stage.stop
    asked = []
    rotation.stage.stop = lambda: asked.append(rotation.stage.read_settings.calls) or stop()

    def unplug(count, frame):
        raise OSError("USB gone")

    rotation.cameras["on_axis"].on_grab = unplug
    assert "raises OSError (USB gone)" in rotation.engine().run().reason
    assert asked == [1]
    with RunFile(rotation.path) as run:
        assert run.info.status == "failed"
        assert run.settings("stage", "end") == SPEED


def test_a_camera_that_still_exposes_at_the_end_is_not_asked(rotation_table, tmp_path):
    """In real time, because an exposure in simulated time ends when the engine gives it up."""
    rotation_table["settle"] |= {"dwell_s": 0.001, "poll_s": 0.001}
    rig = in_real_time(rotation_table, tmp_path / "run.h5")
    camera = rig.cameras["on_axis"]
    camera.read_settings = Reporting({"gain": 1.0})
    ended = threading.Event()

    def end_the_exposure(status: EngineStatus) -> None:
        if status.state.name == "ABORTED":
            ended.set()

    engine = rig.engine(on_status=[end_the_exposure])

    def long_exposure(count, frame):
        engine.abort("Ctrl-C")
        ended.wait(60.0)
        return frame

    camera.on_grab = long_exposure
    outcome = engine.run()
    assert (outcome.status, outcome.lost_devices) == ("aborted", ())
    assert camera.read_settings.calls == 1
    assert "on_axis: its settings are unknown at the end: another call still runs" in rig.events()


@pytest.mark.parametrize(
    ("table", "said"),
    [
        (None, "expected a table of at most 100 settings, got None"),
        ({"x": [1]}, "expected a text, a finite number, true or false as x, got [1]"),
        ({"x_mm": float("nan")}, "expected a text, a finite number, true or false as x_mm, got nan"),
        ({"": 1}, "expected names of 1 to 64 characters, got ''"),
        ({"x": "é" * 200}, "expected at most 240 bytes as x"),
    ],
)
def test_what_is_no_table_of_settings_is_a_fault_of_the_driver(rotation: FakeRig, table, said):
    rotation.stage.read_settings = Reporting(table)
    outcome = rotation.engine().run()
    assert outcome.status == "failed"
    assert said in outcome.reason
    assert outcome.reason.endswith("report it to the author of the driver")


def test_an_interlock_may_report_settings(rotation: FakeRig):
    door = FakeInterlock(rotation.clock, lambda count: 1.0)
    door.read_settings = Reporting({"debounce_s": 0.1})
    rotation.interlocks["door"] = OpenedInterlock(door, 1.0, None)
    assert rotation.engine().run().status == "completed"
    with RunFile(rotation.path) as run:
        assert run.settings("interlocks.door", "start") == {"debounce_s": 0.1}


def changed(rig: FakeRig, **asked: object) -> None:
    """Replace the recorded settings of the stage in the file of a finished run."""
    with h5py.File(rig.path, "r+") as file:
        group = file["entry/instrument/stage"]
        del group["settings"]
        text = json.dumps(asked)
        group.create_dataset("settings", data=text, dtype=h5py.string_dtype("utf-8", len(text)))


def test_verify_says_which_settings_are_missing(rotation: FakeRig):
    assert rotation.engine().run().status == "completed"
    changed(rotation, driver="x", asked={}, reports_settings=False)
    assert not [problem for problem in verify_run(rotation.path).problems if "settings" in problem]
    changed(rotation, driver="x", asked={}, reports_settings=True)
    assert [problem for problem in verify_run(rotation.path).problems if "settings" in problem] == [
        "stage: its settings at the start of the run are missing",
        "stage: its settings at the end of the run are missing",
    ]


def test_a_run_file_of_an_earlier_program_has_no_settings_and_is_read(rotation: FakeRig):
    assert rotation.engine().run().status == "completed"
    with h5py.File(rotation.path, "r+") as file:
        del file["entry/settings"], file["entry/instrument/stage/settings"]
    with RunFile(rotation.path) as run:
        assert (run.settings("stage", "start"), run.asked("stage")) == ({}, {})
    assert not [problem for problem in verify_run(rotation.path).problems if "settings" in problem]


def test_a_damaged_table_of_settings_is_one_sentence(rotation: FakeRig):
    rotation.stage.read_settings = Reporting(SPEED)
    assert rotation.engine().run().status == "completed"
    with h5py.File(rotation.path, "r+") as file:
        file["entry/settings/value"][0] = b"{"
    with RunFile(rotation.path) as run, pytest.raises(RunFileError, match="damaged settings of stage"):
        run.settings("stage", "start")
