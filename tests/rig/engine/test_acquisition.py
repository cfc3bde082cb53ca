"""Images beside a machine that is closed: at times, events of a channel or on request."""

import tomllib
from dataclasses import replace

import h5py
import numpy as np
import pytest

from drivers.errors import DeviceTimeout
from drivers.signals import Signal
from rig.devices import OpenedTrigger
from rig.engine import acquisition
from rig.protocol.acquire import AcquireProtocol
from tests.rig.channels.fake_box import FORCE, FakeBox, FakeLine
from tests.rig.conftest import FakeRig

SHORTEST = """
kind = "acquire"
title = "beside the old machine"
[acquire]
every_s = 0.5
[end]
duration_s = 10
"""
BARE = 'grid_images = "never"\nreference = false\n'
RATE_N_S = 500.0


def beside(tmp_path, text=BARE + SHORTEST, force_n=lambda t: RATE_N_S * t, **box) -> FakeRig:
    protocol = AcquireProtocol.model_validate(tomllib.loads(text))
    rig = FakeRig(protocol, tmp_path / "run.h5", definition=text)
    rig.channels = {"box": FakeBox(rig.clock, force_n, **box)}
    rig.measured = {"load": "force"}
    return rig


def with_tables(acquire: str, end: str, more: str = BARE) -> str:
    return f'{more}kind = "acquire"\ntitle = "t"\n[acquire]\n{acquire}\n[end]\n{end}\n'


def steps(path):
    with h5py.File(path) as file:
        columns = {name: data[()] for name, data in file["entry/steps"].items()}
        camera = {name: file[f"entry/instrument/on_axis/{name}"][()] for name in ("middle_s", "step")}
        box = {name: data[()] for name, data in file["entry/channels/box"].items() if data.ndim}
    return columns, camera, box


def test_six_lines_record_images_at_a_rate_with_their_times_and_every_sample(tmp_path):
    rig = beside(tmp_path)
    outcome = rig.engine().run()
    assert outcome.status == "completed", outcome.reason
    assert outcome.is_good
    columns, camera, box = steps(rig.path)
    assert columns["kind"].tolist() == [b"reference", *[b"acquired"] * 20]
    np.testing.assert_allclose(np.diff(columns["due_s"]), 0.5, atol=1e-9)
    # The camera exposes for 1 ms within the 20 ms of a grab, which is all that is known.
    np.testing.assert_allclose(camera["middle_s"] - columns["due_s"], 0.01, atol=0.03)
    assert (np.diff(box["number"]) == 1).all()
    # The box shows every 20 ms what was true 0.1 s before.
    np.testing.assert_allclose(box["value_force"], RATE_N_S * (box["time_s"] - FORCE.delay_s), atol=1e-6)
    assert outcome.timing.reached_s == pytest.approx(0.5, abs=0.02)


def test_grid_and_reference_come_before_or_after(tmp_path):
    rig = beside(tmp_path, SHORTEST)
    assert rig.engine().run().is_good
    assert steps(rig.path)[0]["kind"].tolist()[:5] == [
        b"grid",
        b"reference",
        b"acquired",
        b"acquired",
        b"acquired",
    ]
    assert rig.calls == ["ATTACH_GRID", "REMOVE_GRID"]
    after = beside(tmp_path / "x", 'grid_images = "after"\nreference = false\n' + SHORTEST)
    after.path.parent.mkdir()
    assert after.engine().run().is_good
    found = steps(after.path)[0]
    assert found["kind"].tolist()[-1] == b"grid"
    assert (np.diff(found["index"]) == 1).all()


def test_a_camera_that_is_too_slow_is_told_and_labelled_with_true_times(tmp_path):
    rig = beside(tmp_path)
    for camera in rig.cameras.values():
        camera.on_grab = lambda count, frame: (
            rig.clock.sleep(1.18),
            replace(frame, received_s=rig.clock.now_s()),
        )[1]
    outcome = rig.engine().run()
    assert outcome.status == "completed"
    assert not outcome.is_good
    assert outcome.timing.missing > 5
    columns, camera, _ = steps(rig.path)
    np.testing.assert_allclose(camera["middle_s"][columns["frames_on_axis"]], columns["time_s"], atol=1e-6)
    assert any("are missing" in event for event in rig.events())


def test_images_at_increments_end_at_a_drop_and_a_late_load_is_allowed_for(tmp_path):
    def force_n(t):
        return min(RATE_N_S * t, 9000.0) if t < 25.0 else 100.0

    text = with_tables(
        'increment = { channel = "channels.force", by = 500 }',
        'drop = { channel = "channels.force", fraction = 0.5, least = 5000 }',
    )
    rig = beside(tmp_path, text, force_n)
    outcome = rig.engine().run()
    assert outcome.is_good, rig.events()
    due_s = steps(rig.path)[0]["due_s"]
    loads_n = np.array([force_n(t) for t in due_s])
    # an increment is seen at the next sample, 20 ms later
    np.testing.assert_allclose(np.diff(loads_n[1:18]), 500.0, atol=RATE_N_S * 0.021)
    assert any("fell from 9000 to 100" in event for event in rig.events())


def test_a_trigger_of_one_sample_is_not_missed_and_begins_and_takes_images(tmp_path):
    def level(t):
        return 5.0 if t > 3.0 and (t % 1.0) < 0.02 else 0.0

    volts = Signal("sync", "V", -11.0, 11.0)
    text = with_tables(
        'trigger = { channel = "channels.sync", above = 2.5 }\n'
        'begin = { channel = "channels.sync", above = 2 }',
        "images = 6",
    )
    rig = beside(tmp_path, text, level, signals=(volts,))
    rig.measured = {}
    line = FakeLine(rig.clock)
    rig.triggers = {"logger": OpenedTrigger(line, "exposure")}
    outcome = rig.engine().run()
    assert outcome.timing.taken == 6
    np.testing.assert_allclose(np.diff(steps(rig.path)[0]["due_s"]), 1.0, atol=0.021)
    assert len(line.pulses_s) == 6


def test_the_operator_asks_for_images_and_ends_them(tmp_path):
    rig = beside(tmp_path, with_tables("on_request = true", "on_request = true"))
    engine = rig.engine()

    def force_n(t):
        # A person presses keys at these times.
        if any(abs(t - at_s) < 0.01 for at_s in (2.0, 3.0, 7.0)):
            engine.request_image()
        if t > 9.0:
            engine.request_end()
        return 0.0

    rig.channels["box"].force_n = force_n
    assert engine.run().is_good
    assert len(steps(rig.path)[0]["due_s"]) == 3


def test_logarithmic_times(tmp_path):
    text = with_tables("logarithmic = { first_s = 1, per_decade = 2 }", "duration_s = 100")
    rig = beside(tmp_path, text, lambda t: 100.0)
    assert rig.engine().run().is_good
    due_s = steps(rig.path)[0]["due_s"]
    np.testing.assert_allclose(due_s - due_s[0], [0.0, 1.0, 10**0.5, 10.0, 10**1.5, 100.0], rtol=1e-6)


def silent(count, samples):
    if count > 100:
        raise DeviceTimeout("channels.box", "read", "an answer", "none", "check the cable")
    return samples


FAULTS = {
    "out of range": (
        lambda count, s: replace(s, values=s.values + 1e6 * (count > 100)),
        "within -1000 to 20000 N",
    ),
    "no value": (
        lambda count, s: replace(s, values=s.values * (np.nan if count > 100 else 1.0)),
        "no valid value",
    ),
    "silent": (silent, "check the cable"),
    "samples twice": (lambda count, s: replace(s, first=s.first - (count > 100)), "mend the driver"),
    "a driver's own error": (lambda count, s: s if count <= 100 else 1 / 0, "ZeroDivisionError"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_of_a_channel_ends_the_run_with_all_samples_before_it(tmp_path, fault):
    on_read, words = FAULTS[fault]
    rig = beside(tmp_path, on_read=on_read)
    outcome = rig.engine().run()
    assert outcome.status == "failed"
    assert words in outcome.reason
    assert len(steps(rig.path)[2]["number"]) >= 100


def test_lost_samples_are_told_and_leave_a_gap(tmp_path):
    rig = beside(tmp_path, on_read=lambda count, s: replace(s, first=s.first + 3 * (count > 100)))
    outcome = rig.engine().run()
    assert (outcome.status, outcome.is_good) == ("completed", False)
    assert ["channels.box: 3 samples were lost" in sentence for sentence in outcome.shortfalls] == [True]
    assert any("3 samples before sample 103 were lost" in event for event in rig.events())
    assert np.diff(steps(rig.path)[2]["number"]).max() == 4


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (with_tables("every_s = 1\ntimes_s = [1.0]", "duration_s = 5"), "exactly one of"),
        (with_tables("every_s = 1", ""), "at least one of"),
        (with_tables("times_s = [2.0, 1.0]", "duration_s = 5"), "times_s must rise"),
        (with_tables('trigger = { channel = "force", above = 1 }', "images = 5"), "channels."),
        (
            with_tables('trigger = { channel = "channels.force" }', "images = 5"),
            "exactly one of above and below",
        ),
        (with_tables("every_s = 1\nevery_ms = 3", "duration_s = 5"), "every_ms"),
    ],
)
def test_mistakes_in_the_tables_are_named(text, words):
    with pytest.raises(ValueError, match=words):
        AcquireProtocol.model_validate(tomllib.loads(text))


def test_an_event_during_another_wait_of_the_engine_is_seen(tmp_path, monkeypatch):
    """While an image waits for a slow disk, the samples are read by that wait."""
    text = with_tables(
        "every_s = 1", 'reaches = { channel = "channels.force", above = 900 }\nduration_s = 20'
    )
    rig = beside(tmp_path, text, lambda t: 1000.0 if 3.30 < t < 3.34 else 0.0)
    record = acquisition.record_frame

    def slow(run, camera, frame, keep_s):
        if 3.0 < run.clock.now_s() < 3.2:
            for _ in range(50):
                run.read()
                run.calls.pause(0.02)
        return record(run, camera, frame, keep_s)

    monkeypatch.setattr(acquisition, "record_frame", slow)
    outcome = rig.engine().run()
    assert any("channels.force above 900 was reached" in event for event in rig.events())
    assert outcome.timing.taken < 8
