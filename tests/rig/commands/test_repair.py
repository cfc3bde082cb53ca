"""After `rig repair`, run files that HDF5 refused to open can be opened, with every image unchanged."""

import shutil
import stat
from pathlib import Path

import h5py
import pytest

from dic.errors import RunFileError
from dic.runfile import superblock
from dic.runfile.digests import BLOCK_BYTES
from dic.runfile.reader import RunFile
from dic.runfile.schema import LATER
from rig.commands.repair import repair_run
from rig.commands.verify import verify_run
from rig.protocol.step import ProtocolStep, RigReading
from rig.recorder import Recorder, StepRecord
from tests.command_line import run_rig
from tests.run_files import CAMERAS, HEADER, START, take, write_run

HDF5 = slice(BLOCK_BYTES, BLOCK_BYTES + superblock.SUPERBLOCK_BYTES)


@pytest.fixture(scope="module")
def good(tmp_path_factory) -> Path:
    return write_run(tmp_path_factory.mktemp("run") / "run.h5")


@pytest.fixture
def cut_off(tmp_path) -> Path:
    """A run file as a killed program leaves it: a copy that was made during the recording."""
    recorder = Recorder(tmp_path / "recorded.h5", HEADER, CAMERAS)
    for index, kind in enumerate(["grid", "reference"]):
        frames = {name: (recorder.frame(name, take(info, index)), 1) for name, info in CAMERAS.items()}
        recorder.step(StepRecord(ProtocolStep(index, kind), RigReading(1.0), frames)).result(60.0)
    path = tmp_path / "run.h5"
    shutil.copyfile(tmp_path / "recorded.h5", path)
    recorder.close("aborted", "test", START)
    return path


def pixels(path: Path) -> list[bytes]:
    with RunFile(path) as run:
        return [run.image(name, step).tobytes() for name in run.cameras for step in run.steps]


def only_the_superblock_differs(before: bytes, after: bytes) -> bool:
    return before[: HDF5.start] + before[HDF5.stop :] == after[: HDF5.start] + after[HDF5.stop :]


def test_killed_run_opens_everywhere_after_its_repair(cut_off):
    before, images = cut_off.read_bytes(), pixels(cut_off)
    with pytest.raises(OSError, match="already open for write"):
        h5py.File(cut_off)
    done = run_rig("repair", cut_off)
    assert done.status == 0
    assert "marked as open for writing; repaired" in done.out
    with h5py.File(cut_off) as file:
        assert list(file["entry/steps/complete"]) == [1, 1]
    assert pixels(cut_off) == images
    assert only_the_superblock_differs(before, cut_off.read_bytes())
    assert verify_run(cut_off).problems == [
        "the run is running, or was cut off; 2 of 0 planned steps are on file"
    ]
    assert repair_run(cut_off).changes == []


def test_file_shorter_than_its_superblock_says_opens(good, tmp_path):
    """What a limit on the size of files left: the end was announced and never written."""
    path = tmp_path / "run.h5"
    content = bytearray(good.read_bytes())
    stored = superblock.parse(bytes(content[HDF5]))
    content[HDF5] = superblock.Superblock(0, stored.base, stored.extension, 10**9, stored.root).to_bytes()
    path.write_bytes(content)
    with pytest.raises(RunFileError, match="cut off"):
        verify_run(path)
    assert repair_run(path).changes == [f"the file should have had 1000000000 bytes and has {len(content)}"]
    assert path.read_bytes() == good.read_bytes()


@pytest.mark.parametrize("damage", [b"\0" * 48, b"\x89HDF\r\n\x1a\n" + b"\xff" * 40])
def test_destroyed_superblock_is_restored_from_its_copy(good, tmp_path, damage):
    path = tmp_path / "run.h5"
    content = bytearray(good.read_bytes())
    content[HDF5] = damage
    path.write_bytes(content)
    assert "restored from its copy" in repair_run(path).changes[0]
    assert path.read_bytes() == good.read_bytes()
    assert verify_run(path).problems == []


def test_read_only_file_stays_read_only(good, tmp_path):
    path = tmp_path / "run.h5"
    content = bytearray(good.read_bytes())
    content[HDF5] = bytes(48)
    path.write_bytes(content)
    path.chmod(0o444)
    repair_run(path)
    assert stat.S_IMODE(path.stat().st_mode) == 0o444


def test_run_that_is_being_recorded_is_left_alone(tmp_path):
    path = tmp_path / "run.h5"
    recorder = Recorder(path, HEADER, CAMERAS)
    with pytest.raises(RunFileError, match="being recorded"):
        repair_run(path)
    assert "is being recorded" in verify_run(path).problems[0]
    recorder.close("aborted", "test", START)
    assert repair_run(path).changes == []


def test_file_that_cannot_be_repaired_stays_as_it_was(good, tmp_path):
    path = tmp_path / "run.h5"
    content = good.read_bytes()[:2000]
    path.write_bytes(content)
    with pytest.raises(RunFileError):
        repair_run(path)
    assert path.read_bytes() == content


def test_file_of_an_earlier_program_is_read_and_verified(good, tmp_path):
    """Without user block, digests, settings and provenance, but with HDF5's own checksums."""
    path = tmp_path / "run.h5"
    later = {item.name for item in LATER}
    with h5py.File(good) as new, h5py.File(path, "w", libver="latest") as old:
        old.attrs.update(new.attrs)

        def copy(name: str, item: h5py.Group | h5py.Dataset) -> None:
            if item.name.split("/")[-1] in later and item.parent.name != "/entry/steps":
                return
            if isinstance(item, h5py.Group):
                made = old.create_group(name)
            else:
                made = old.create_dataset(
                    name, data=item[()], dtype=item.dtype, fletcher32=name.endswith("data")
                )
            made.attrs.update(item.attrs)

        new.visititems(copy)
    assert pixels(path) == pixels(good)
    found = verify_run(path)
    assert (found.problems, found.digest) == ([], "none")
    with RunFile(path) as run:
        assert run.info.direction_deg is None
