"""Readings at the middle of exposures: of a closed machine's voltage, of devices, and of earlier files."""

from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from dic.errors import RunFileError
from dic.runfile.at_exposure import steps_at_exposure
from dic.runfile.joined import open_run
from dic.runfile.reader import RunFile
from drivers.interfaces import DeviceInfo, LoadFrameState
from drivers.signals import Signal
from rig.protocol.step import ProtocolStep, RigReading
from rig.recorder import Recorder, StepRecord
from rig.recorder.records import ChannelsRecord, SignalRecord
from rig.samples import TimedSamples
from tests.dic.runfile.closed_machine import closed_test, write_test
from tests.run_files import CAMERAS, HEADER, START, take, write_continued_run, write_run

INFO = DeviceInfo("v", "m", "s")
OVEN = Signal("oven", "°C", -50.0, 400.0, delay_s=0.5)
CLIP = Signal("clip", "%", -5.0, 20.0)


def column(steps, name):
    return np.array([getattr(step, name) for step in steps])


def read(path, camera="front"):
    with open_run(path) as run:
        return steps_at_exposure(run)[camera]


def test_load_of_a_closed_machine_is_within_its_stated_uncertainty_at_2000_images(tmp_path):
    z, own = [], []
    for seed in range(100, 110):
        test = closed_test(seed, length_s=20.0)
        found = read(write_test(tmp_path / f"{seed}.h5", test))
        assert found.remarks == []
        std, lag = column(found.steps, "load_std_n"), column(found.steps, "load_lag_n")
        z.append((column(found.steps, "load_n") - test.load_n) / std)
        own.append(np.median(np.sqrt(std**2 - lag**2) / std))
    z = np.concatenate(z)
    assert len(z) == 2000
    assert 0.93 <= np.mean(np.abs(z) < 1.96) <= 0.99
    assert 0.8 < np.sqrt(np.mean(z**2)) < 1.2
    # Neither the noise nor the delay alone is all of it.
    assert 0.2 < np.mean(own) < 0.95


def test_the_shared_part_is_the_change_of_the_load_by_another_delay(tmp_path):
    test = closed_test(3, delay_std_s=0.02)
    found = read(write_test(tmp_path / "a.h5", test))
    later = replace(test.signal, delay_s=test.signal.delay_s + 0.02)
    moved = read(write_test(tmp_path / "b.h5", replace(test, signal=later)))
    lag = column(found.steps, "load_lag_n")
    # The delay, and the clocks of box (0.002 s) and camera (0.001 s).
    expected = (
        np.hypot(0.02, np.hypot(0.002, 0.001))
        / 0.02
        * (column(moved.steps, "load_n") - column(found.steps, "load_n"))
    )
    rising = np.abs(lag) > 0.5 * np.abs(lag).max()
    assert np.count_nonzero(rising) > 10
    # The difference of two loads has noise.
    assert np.median(expected[rising] / lag[rising]) == pytest.approx(1.0, abs=0.1)


def test_images_carry_the_time_of_their_exposure_and_how_late_it_was(tmp_path):
    test = closed_test(1, images=30)
    found = read(write_test(tmp_path / "r.h5", test))
    np.testing.assert_allclose(column(found.steps, "time_s"), test.middle_s)
    np.testing.assert_allclose(column(found.steps, "late_s"), 0.0, atol=1e-12)
    np.testing.assert_allclose(column(found.steps, "time_std_s"), test.middle_std_s)
    assert [step.kind for step in found.steps[:2]] == ["reference", "acquired"]


def write_channels(path: Path, samples: TimedSamples, images_s=(), **signals) -> Path:
    """Write a run with a slow box of two signals, and a reference and images at the given times."""
    chosen = {"oven": OVEN, "clip": CLIP} | signals
    box = ChannelsRecord(INFO, tuple(SignalRecord(each) for each in chosen.values()))
    recorder = Recorder(path, HEADER, CAMERAS, channels={"box": box})
    for k in range(len(samples.values)):
        one = slice(k, k + 1)
        each = (getattr(samples, name)[one] for name in ("values", "time_s", "time_std_s", "device_s"))
        recorder.samples("box", TimedSamples(*each, k))
    for index, at_s in enumerate((0.0, *images_s)):
        frames = {}
        for number, (name, info) in enumerate(CAMERAS.items()):
            # The second camera is later by 0.2 s.
            begin_s = at_s + 0.2 * number
            frame = replace(take(info, index), exposed_s=begin_s - 5e-4, received_s=begin_s + 5e-4)
            frames[name] = recorder.frame(name, replace(frame, exposure_us=np.nan)), 1
        kind = ["grid", "reference"][index] if index < 2 else "acquired"
        recorder.step(StepRecord(ProtocolStep(index, kind), RigReading(at_s), frames)).result(20)
    recorder.close("completed", "", START)
    return path


def polled(end_s=20.0, interval_s=0.1):
    """Return samples that were asked for, with the truth 20 + 2 t °C half a second late, and t / 10 %."""
    time_s = np.arange(0.0, end_s, interval_s) + 0.01 * np.sin(np.arange(0.0, end_s, interval_s))
    values = np.column_stack([20.0 + 2.0 * (time_s - 0.5), 0.1 * time_s])
    return TimedSamples(values, time_s, np.full(len(time_s), 0.002), np.full(len(time_s), np.nan), 0)


def test_other_signals_are_values_of_each_step_of_each_camera_with_names_for_tables(tmp_path):
    path = write_channels(tmp_path / "r.h5", polled(), (2.0, 5.03, 11.0))
    for camera, later_s in (("left", 0.0), ("right", 0.2)):
        steps = read(path, camera).steps
        at_s = np.array([2.0, 5.03, 11.0]) + later_s
        for step, t in zip(steps, at_s, strict=True):
            oven, clip = step.channels
            assert (oven.name, oven.unit, clip.name, clip.unit) == ("oven", "°C", "clip", "%")
            assert oven.value == pytest.approx(20.0 + 2.0 * t, abs=1e-6)
            assert clip.value == pytest.approx(0.1 * t, abs=1e-6)
            # 2 °C/s and times that are wrong by 2 ms each, between two samples
            assert 2.0 * 0.002 * np.sqrt(0.5) <= oven.std < 0.012
        known = steps[0].known()
        assert {"channel_oven_degC", "channel_oven_std_degC", "channel_clip_percent"} <= known.keys()
        assert np.isnan(steps[0].load_n)


def test_a_value_beside_the_record_or_an_invalid_sample_is_none_and_is_told(tmp_path):
    samples = polled(end_s=10.0)
    samples.values[50, 0] = 500.0
    found = read(write_channels(tmp_path / "r.h5", samples, (2.0, 4.53, 11.0)), "left")
    oven, clip = ([step.channels[k].value for step in found.steps] for k in (0, 1))
    # The oven at 4.53 s is what its sensor tells at 5.03 s, beside the value out of range.
    assert np.isfinite(oven).tolist() == [True, False, False]
    assert np.isfinite(clip).tolist() == [True, True, False]
    assert found.remarks[0].startswith(
        "channels.oven: its record does not cover the exposures of 2 of 3 steps"
    )
    assert found.remarks[1].startswith(
        "channels.clip: its record does not cover the exposures of 1 of 3 steps"
    )


def write_readings(path: Path, times_s, load_of, images_s) -> Path:
    """Write a run whose load frame was read at the given times, with a camera's images."""
    recorder = Recorder(path, HEADER, {"left": CAMERAS["left"]}, load_frame=INFO)
    for number, t in enumerate(times_s):
        state = LoadFrameState(load_of(t), 0.01 * t, False, True, True, number, (), float(t))
        recorder.load_frame_state(state)
    for index, at_s in enumerate((0.0, 0.0, *images_s)):
        frame = replace(take(CAMERAS["left"], index), exposed_s=at_s - 1e-3, received_s=at_s + 1e-3)
        frames = {"left": (recorder.frame("left", replace(frame, exposure_us=np.nan)), 1)}
        kind = ["grid", "reference", "load"][min(index, 2)]
        step = ProtocolStep(index, kind, 7.0 if kind == "load" else np.nan)
        recorder.step(StepRecord(step, RigReading(at_s, 7.0, 7.0), frames)).result(20)
    recorder.close("completed", "", START)
    return path


def test_sparse_readings_of_a_machine_that_moves_and_holds_give_its_load(tmp_path):
    rng = np.random.default_rng(5)

    def load_of(t):
        # 1000 N/s to 5 s, then held
        return 1000.0 * min(t, 5.0) + 2.0 * rng.normal()

    at_s = np.concatenate([np.linspace(1.03, 4.7, 20), np.linspace(5.5, 9.5, 20)])
    found = read(write_readings(tmp_path / "r.h5", np.arange(0.0, 10.5, 0.1), load_of, at_s), "left")
    load, std = (column(found.steps[1:], name) for name in ("load_n", "load_std_n"))
    truth = 1000.0 * np.minimum(at_s, 5.0)
    assert np.abs((load - truth) / std).max() < 3.0
    # While the machine moves, the time of its answers (0.01 s) counts.
    assert std[:20] == pytest.approx(10.0, rel=0.1)
    assert std[20:].max() < 5.0
    np.testing.assert_allclose(column(found.steps[1:], "displacement_mm"), 0.01 * at_s, atol=1e-9)


def test_where_the_readings_end_the_settled_one_is_kept_and_its_uncertainty_grows_with_the_time(tmp_path):
    times_s = np.arange(0.0, 5.0, 0.1)
    found = read(write_readings(tmp_path / "r.h5", times_s, lambda t: 100.0 * t, (3.0, 6.0, 9.0)), "left")
    inside, *beyond = found.steps[1:]
    assert inside.load_n == pytest.approx(300.0)
    assert [step.load_n for step in beyond] == [7.0, 7.0]
    for step in beyond:
        assert step.load_std_n == pytest.approx(100.0 * (step.time_s - 4.9), rel=0.05)
    assert any(
        text.startswith("load: its record does not cover the exposures of 2 of 4") for text in found.remarks
    )


def test_files_of_earlier_programs_give_the_middle_that_their_times_allow(tmp_path):
    path = write_run(tmp_path / "run.h5", loads=3)
    path.chmod(0o644)
    new = read(path, "left")
    with h5py.File(path, "r+") as file:
        for name in CAMERAS:
            for item in ("middle_s", "middle_std_s"):
                del file[f"entry/instrument/{name}/{item}"]
        del file["entry/steps/due_s"]
    old = read(path, "left")
    assert column(old.steps, "time_s").tolist() == column(new.steps, "time_s").tolist()
    # `take` exposes for 0.9 ms within 0.1 s.
    np.testing.assert_allclose(column(old.steps, "time_s"), np.arange(1.0, 5.0) + 0.05)
    np.testing.assert_allclose(column(old.steps, "time_std_s"), 0.0991 / np.sqrt(12.0))
    # The readings are 1 s apart, at the numbers of the steps, and the last exposure comes after them.
    assert column(old.steps, "load_n").tolist() == pytest.approx([1.05, 2.05, 3.05, 4000.0])
    assert np.isnan(column(old.steps, "late_s")).all()


def test_a_continued_run_has_the_steps_of_both_files(tmp_path):
    steps = read(write_continued_run(tmp_path), "right").steps
    assert [step.index for step in steps] == [1, 2, 3, 4, 5]
    np.testing.assert_allclose(column(steps, "time_s"), np.arange(1.0, 6.0) + 0.05)


def test_a_step_whose_images_were_overwritten_is_left_out(tmp_path):
    path = write_run(tmp_path / "run.h5", loads=4)
    path.chmod(0o644)
    with h5py.File(path, "r+") as file:
        file["entry/instrument/right/step"][2] = 7
    with RunFile(path) as run:
        assert [step.index for step in run.steps] == [0, 1, 3, 4, 5]
        assert run.overwritten == 1
        assert run.rows("right", run.steps[2]) == range(3, 4)
        assert run.place(run.steps[3]) == 3
        assert len(steps_at_exposure(run)["right"].steps) == 4


SIGNALS = "entry/channels/box/signals"


def put(file, text):
    del file[SIGNALS]
    file.create_dataset(SIGNALS, data=np.bytes_(text.encode()))


HARMS = {
    "no signals": (lambda file: put(file, "{}"), "without a signal"),
    "a text in place of JSON": (lambda file: put(file, "force"), "lacks some of its data"),
    "a missing key": (lambda file: put(file, '{"force": {"unit": "N"}}'), "no data set .*value_force"),
    "no range": (
        lambda file: put(file, file[SIGNALS][()].decode().replace("400.0", "-400.0")),
        "signal oven with an impossible range",
    ),
    "a text in place of a number": (
        lambda file: put(file, file[SIGNALS][()].decode().replace("400.0", '"x"')),
        "lacks some of its data",
    ),
    "another quantity": (
        lambda file: put(file, file[SIGNALS][()].decode().replace('"quantity": ""', '"quantity": "x"')),
        "of 'x'",
    ),
    "a column that is too short": (
        lambda file: (
            file.__delitem__("entry/channels/box/number"),
            file.__setitem__("entry/channels/box/number", np.zeros(3, np.int64)),
        ),
        "3 rows of .*number",
    ),
    "a name that is none": (
        lambda file: file.move("entry/channels/box", "entry/channels/a.b"),
        "a channel device with the name",
    ),
}


@pytest.mark.parametrize("harm", HARMS)
def test_a_damaged_table_of_a_channel_device_is_one_sentence(tmp_path, harm):
    path = write_channels(tmp_path / "r.h5", polled(), (2.0, 3.0))
    path.chmod(0o644)
    with h5py.File(path, "r+") as file:
        HARMS[harm][0](file)
    with pytest.raises(RunFileError, match=HARMS[harm][1]):
        RunFile(path)


def test_channels_are_described_as_the_rig_file_declares_them(tmp_path):
    with RunFile(write_channels(tmp_path / "r.h5", polled(), (2.0, 3.0))) as run:
        oven = run.channels["box"]["oven"]
        assert (oven.unit, oven.low, oven.high, oven.delay_s, oven.quantity) == ("°C", -50.0, 400.0, 0.5, "")
        assert run.identity("channels.box")["model"] == "m"
        assert len(run.columns("channels/box")["value_clip"]) == 200
        assert list(run.columns("channels/box", "time_s")) == ["time_s"]
        assert run.asked("channels.box") == {}
