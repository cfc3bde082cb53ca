"""A run that recorded nothing does not keep its name from the next one, and nothing else is moved."""

import pytest

from rig.errors import RecordingError
from rig.recorder.room import make_room
from tests.rig.recorder.test_recorder import START, frame, record, step


def test_run_without_a_step_or_image_is_kept_under_another_name(tmp_path):
    path = tmp_path / "run.h5"
    assert make_room(path) is None
    for number in (1, 2):
        record(path).close("failed", "the camera is missing", START)
        assert make_room(path) == tmp_path / f"run.nothing-{number}.h5"
        assert not path.exists()


@pytest.mark.parametrize("kept", ["step", "image", "completed", "recorded", "text"])
def test_everything_else_is_left_alone(tmp_path, kept):
    path = tmp_path / "run.h5"
    recorder = None if kept == "text" else record(path)
    if recorder is None:
        path.write_text("no run")
    elif kept == "step":
        step(recorder, 0)
    elif kept == "image":
        recorder.frame("on_axis", frame(1))
    if recorder is not None and kept != "recorded":
        recorder.close("completed" if kept == "completed" else "failed", "", START)
    with pytest.raises(RecordingError, match="a run is never overwritten, not even with --force"):
        make_room(path)
    assert path.exists()
    if recorder is not None:
        recorder.close("failed", "", START)
