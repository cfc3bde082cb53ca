"""An acquisition takes the frames of free-running cameras that are nearest to their times."""

import tomllib
from dataclasses import replace
from enum import Enum

import h5py
import numpy as np
import pytest

from drivers.errors import LinkLost
from rig.protocol.acquire import AcquireProtocol
from tests.rig.conftest import FakeLoadFrame, FakeRig
from tests.rig.engine.fake_stream import FakeLoss, FakeReport, StreamingCamera
from tests.rig.engine.test_acquisition import BARE, beside, steps, with_tables


def streaming(tmp_path, every_s=0.5, duration_s=10, more=BARE, period_s=0.1, **box) -> FakeRig:
    text = with_tables(f"every_s = {every_s}", f"duration_s = {duration_s}", more)
    rig = beside(tmp_path, text, **box)
    rig.cameras = {name: StreamingCamera(rig.clock, period_s=period_s) for name in rig.cameras}
    return rig


def test_the_nearest_frame_of_each_camera_is_taken(tmp_path):
    rig = streaming(tmp_path)
    rig.cameras["off_axis"].period_s = 0.03
    outcome = rig.engine().run()
    assert outcome.is_good, outcome.reason
    assert outcome.timing.taken == 21
    with h5py.File(rig.path) as file:
        due_s = file["entry/steps/due_s"][()]
        for name, camera in rig.cameras.items():
            middle_s = file[f"entry/instrument/{name}/middle_s"][()]
            # rounding may choose either frame if both are equally near
            assert (np.abs(middle_s - due_s) <= camera.period_s / 2 + 1e-6).all()
            assert len(set(middle_s.tolist())) == 21


def test_a_camera_that_is_slightly_too_slow_misses_one_image_and_shifts_none(tmp_path):
    rig = streaming(tmp_path, every_s=0.1, duration_s=60, period_s=0.101, force_n=lambda t: 0.0)
    outcome = rig.engine().run()
    assert outcome.status == "completed", outcome.reason
    assert not outcome.is_good
    # in 60 s the camera takes 594 frames, and 601 are asked for
    assert outcome.timing.missing == pytest.approx(7, abs=1)
    # each time between two frames may be half a millisecond beyond the tolerance of half an interval
    assert outcome.timing.late <= 7
    columns, camera, _ = steps(rig.path)
    assert np.abs(camera["middle_s"] - columns["due_s"]).max() < 0.051


def test_a_camera_that_drops_out_comes_back_and_its_images_are_missing(tmp_path):
    rig = streaming(tmp_path)

    def on_next(number):
        if number == 50 and rig.cameras["off_axis"].opened == 1:
            rig.clock.sleep(2.0)
            raise LinkLost("cameras.off_axis", "stream", "a frame", "none", "plug it in")

    rig.cameras["off_axis"].on_next = on_next
    outcome = rig.engine(
        reopen={name: lambda camera=camera: camera for name, camera in rig.cameras.items()}
    ).run()
    assert outcome.status == "completed", outcome.reason
    assert not outcome.is_good
    # 2 s without frames, and then the camera is opened again
    assert outcome.timing.missing + outcome.timing.late == 5
    assert outcome.timing.late <= 1
    assert outcome.timing.taken + outcome.timing.missing == 21
    assert any("off_axis: an acquisition: the camera is back" in event for event in rig.events())


def test_a_camera_that_cannot_be_opened_again_ends_the_run_with_its_error(tmp_path):
    rig = streaming(tmp_path)

    def on_next(number):
        if number == 50:
            raise LinkLost("cameras.off_axis", "stream", "a frame", "none", "plug it in")

    rig.cameras["off_axis"].on_next = on_next
    outcome = rig.engine().run()
    assert outcome.status == "failed"
    assert "plug it in" in outcome.reason
    assert len(steps(rig.path)[0]["index"]) == 10


def test_a_camera_that_drops_out_again_and_again_ends_the_run(tmp_path):
    rig = streaming(tmp_path, duration_s=100)

    def on_next(number):
        if number % 50 == 0:
            raise LinkLost("cameras.off_axis", "stream", "a frame", "none", "plug it in")

    rig.cameras["off_axis"].on_next = on_next
    outcome = rig.engine(
        reopen={name: lambda camera=camera: camera for name, camera in rig.cameras.items()}
    ).run()
    assert outcome.status == "failed"
    assert "plug it in" in outcome.reason


def test_no_stop_waits_for_a_stream_to_close(tmp_path):
    def broken(count, samples):
        return replace(samples, values=samples.values + 1e6 * (count > 100))

    rig = streaming(tmp_path, on_read=broken)
    rig.load_frame = FakeLoadFrame(rig.clock, rig.calls)
    held_s = []
    rig.load_frame.on_hold = lambda: held_s.append(rig.clock.now_s())
    for camera in rig.cameras.values():
        camera.on_close = lambda: rig.clock.sleep(4.0)
    outcome = rig.engine().run()
    assert outcome.status == "failed"
    # sample 101 is read after 2 s
    assert held_s[0] < 2.2


def test_lost_frames_of_a_stream_are_told(tmp_path):
    class Kind(Enum):
        GAP = "the camera's counter jumped"

    rig = streaming(tmp_path)
    rig.cameras["off_axis"].report = FakeReport((FakeLoss(Kind.GAP, 3), FakeLoss(Kind.GAP, 2)))
    assert rig.engine().run().is_good
    assert any("lost: 5 (the camera's counter jumped)" in event for event in rig.events())


def test_frames_whose_times_stand_still_do_not_hang_the_run(tmp_path):
    rig = streaming(tmp_path)
    camera = rig.cameras["off_axis"]
    real = camera.stream

    def stream(capacity):
        opened = real(capacity)
        take = opened.next
        opened.next = lambda timeout_s: replace(take(timeout_s), middle_s=0.05)
        return opened

    camera.stream = stream
    outcome = rig.engine().run()
    assert outcome.status == "failed"
    assert "whose times do not advance" in outcome.reason


def test_a_frame_of_another_format_is_a_fault(tmp_path):
    rig = streaming(tmp_path)
    camera = rig.cameras["off_axis"]
    camera.info = replace(camera.info, width_px=9)
    outcome = rig.engine().run()
    assert outcome.status == "failed"
    assert "announces a format" in outcome.reason


def test_a_bad_image_that_ends_the_run_is_on_file(tmp_path):
    more = BARE.replace("reference = false", "reference = false\nimages = { on_bad_image = 'stop' }")
    rig = streaming(tmp_path, more=more)
    camera = rig.cameras["off_axis"]
    real = camera.stream

    def stream(capacity):
        opened = real(capacity)
        take = opened.next

        def damaged(timeout_s):
            frame = take(timeout_s)
            return replace(frame, flags=4 if frame.sequence >= 30 else 0)

        opened.next = damaged
        return opened

    camera.stream = stream
    outcome = rig.engine().run()
    assert outcome.status == "failed"
    assert "the flags 0x4" in outcome.reason
    with h5py.File(rig.path) as file:
        assert file["entry/instrument/off_axis/flags"][-1] == 4


def test_a_late_load_does_not_lose_the_frame_at_its_time(tmp_path):
    """An event that the channel shows 0.1 s later must get the frame of its own time."""
    text = with_tables('increment = { channel = "channels.force", by = 500 }', "images = 10")
    rig = beside(tmp_path, text)
    rig.cameras = {name: StreamingCamera(rig.clock, period_s=0.01) for name in rig.cameras}
    outcome = rig.engine().run()
    assert outcome.is_good, outcome.reason
    columns, camera, _ = steps(rig.path)
    assert np.abs(camera["middle_s"] - columns["due_s"]).max() < 0.006


def test_protocol_of_the_shortest_interval():
    table = tomllib.loads(with_tables("every_s = 0.0001", "duration_s = 5"))
    with pytest.raises(ValueError, match=r"greater than or equal to 0\.001"):
        AcquireProtocol.model_validate(table)
