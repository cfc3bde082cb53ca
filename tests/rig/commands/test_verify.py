from datetime import UTC, datetime

import h5py
import numpy as np
import pytest

from dic.errors import RunFileError
from rig.commands.verify import verify_run

START = datetime(2026, 1, 1, tzinfo=UTC)


def test_completed_run_has_no_problems(rotation):
    rotation.engine().run()
    found = verify_run(rotation.path)
    assert found.problems == []
    assert found.steps == 18
    assert {name: (c.valid, c.in_steps) for name, c in found.cameras.items()} == {
        "on_axis": (18, 18),
        "off_axis": (18, 18),
    }


def test_failed_run_says_why_and_how_far_it_came(rotation):
    def explode(count, frame):
        if count == 6:
            raise OSError("USB gone")
        return frame

    rotation.cameras["off_axis"].on_grab = explode
    assert rotation.engine().run().status == "failed"
    found = verify_run(rotation.path)
    assert (found.status, found.steps) == ("failed", 5)
    assert "USB gone" in found.problems[0]
    assert (found.cameras["on_axis"].valid, found.cameras["on_axis"].in_steps) == (6, 5)


def test_changed_pixel_fails_its_checksum(rotation):
    rotation.engine().run()
    with h5py.File(rotation.path) as file:
        chunk = file["entry/instrument/on_axis/data"].id.get_chunk_info(4)
    content = bytearray(rotation.path.read_bytes())
    content[chunk.byte_offset] ^= 1
    rotation.path.write_bytes(content)
    found = verify_run(rotation.path)
    assert found.cameras["on_axis"].damaged == [4]
    assert found.problems == ["on_axis: images 4 cannot be read or fail their checksum"]


def test_image_of_a_finished_step_that_was_never_completed_is_missing(rotation):
    rotation.engine().run()
    with h5py.File(rotation.path, "r+") as file:
        file["entry/instrument/on_axis/valid"][4] = 0
    assert verify_run(rotation.path).problems == [
        "on_axis: images 4 of finished steps are missing",
        "the digest of the file is wrong: something was changed after the run",
    ]


@pytest.mark.parametrize("fraction", [0.0, 0.001, 0.05, 0.5, 0.95])
def test_cut_off_file_is_one_sentence_or_says_what_is_missing(rotation, fraction):
    rotation.engine().run()
    content = rotation.path.read_bytes()
    rotation.path.write_bytes(content[: int(fraction * len(content))])
    try:
        problems = verify_run(rotation.path).problems
    except RunFileError as error:
        problems = [str(error)]
    assert problems
    assert "\n" not in problems[0]


def test_missing_and_foreign_files_are_one_sentence(tmp_path):
    with pytest.raises(RunFileError, match="no such file"):
        verify_run(tmp_path / "none.h5")
    (tmp_path / "text.h5").write_text("no HDF5")
    with pytest.raises(RunFileError, match="cut off or is no HDF5"):
        verify_run(tmp_path / "text.h5")
    with h5py.File(tmp_path / "other.h5", "w", libver="latest") as file:
        file["x"] = np.zeros(3)
    with pytest.raises(RunFileError, match="an HDF5 file of another kind"):
        verify_run(tmp_path / "other.h5")
