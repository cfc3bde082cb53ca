import h5py
import pytest

from dic.runfile import superblock
from dic.runfile.superblock import Superblock, checksum, find, is_closed, mark_closed, parse


def test_checksum_is_that_of_bob_jenkins() -> None:
    # The values that lookup3.c itself states in driver5().
    assert checksum(b"") == 0xDEADBEEF
    assert checksum(b"Four score and seven years ago") == 0x17770551


@pytest.mark.parametrize("block", [0, 512, 4096])
def test_superblock_of_hdf5_is_read_and_written_as_it_is(tmp_path, block):
    path = tmp_path / "file.h5"
    with h5py.File(path, "w", libver="latest", userblock_size=block) as file:
        file["x"] = [1, 2, 3]
    assert find(path) == block
    stored = path.read_bytes()[block : block + superblock.SUPERBLOCK_BYTES]
    found = parse(stored)
    assert found.to_bytes() == stored
    assert (found.flags, found.base, found.end) == (0, block, path.stat().st_size)
    assert is_closed(path)


def test_file_whose_writer_died_opens_once_it_is_marked_as_closed(tmp_path):
    path, copy = tmp_path / "file.h5", tmp_path / "copy.h5"
    with h5py.File(path, "w", libver="latest") as file:
        data = file.create_dataset("x", (0,), "f8", maxshape=(None,), chunks=(4,))
        file.swmr_mode = True
        data.resize((3,))
        data[:] = [1, 2, 3]
        data.flush()
        copy.write_bytes(path.read_bytes())
    with pytest.raises(OSError, match="already open for write"):
        h5py.File(copy)
    assert not is_closed(copy)
    before = copy.read_bytes()
    assert mark_closed(copy)
    assert copy.read_bytes()[superblock.SUPERBLOCK_BYTES :] == before[superblock.SUPERBLOCK_BYTES :]
    with h5py.File(copy) as file:
        assert list(file["x"]) == [1, 2, 3]
    assert not mark_closed(copy)


@pytest.mark.parametrize("place", [0, 8, 11, 20, 44])
def test_damaged_superblock_is_refused(place):
    content = bytearray(Superblock(0, 512, 2**64 - 1, 5000, 48).to_bytes())
    content[place] ^= 4
    with pytest.raises(ValueError, match="superblock"):
        parse(bytes(content))


def test_superblock_that_was_cut_off_is_refused():
    with pytest.raises(ValueError, match="cut off"):
        parse(Superblock(0, 512, 2**64 - 1, 5000, 48).to_bytes()[:-1])
