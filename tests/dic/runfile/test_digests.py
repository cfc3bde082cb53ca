"""The user block of a run file, also of the size that earlier versions wrote."""

import hashlib

import pytest

from dic.runfile.digests import UserBlock, file_digest, read_user_block


@pytest.mark.parametrize("size", [512, 4096])
def test_text_before_the_data_tells_where_they_begin(tmp_path, size):
    path = tmp_path / "run.h5"
    text = f"offaxis run file; HDF5 begins at byte {size}\nsuperblock 0102\nsha256 {'ab' * 32}\n".encode()
    path.write_bytes(text.ljust(size, b"\0") + b"sha256 0123\n" + bytes(5000))
    block = read_user_block(path)
    assert block == UserBlock(b"\1\2", "ab" * 32, size)
    whole = hashlib.sha256(b"sha256 0123\n" + bytes(5000)).hexdigest()
    assert file_digest(path, [], block.size) == whole


@pytest.mark.parametrize(
    "text", [b"", b"offaxis run file; HDF5 begins at byte 1024\nsuperblock 01\n", b"\x89HDF"]
)
def test_other_beginning_is_no_user_block(tmp_path, text):
    path = tmp_path / "run.h5"
    path.write_bytes(text.ljust(6000, b"\0"))
    assert read_user_block(path) is None
