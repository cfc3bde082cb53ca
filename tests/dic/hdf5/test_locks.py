"""Files on a file system without locks are read, and a file that another program writes is named as such."""

import errno

import h5py
import pytest

from dic.hdf5 import inspection
from dic.hdf5.open import NotReadable, open_hdf5


@pytest.fixture
def path(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["values"] = [1, 2, 3]
    return tmp_path / "a.h5"


@pytest.mark.parametrize("number", [errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP])
def test_file_system_without_locks_is_read_without_one(path, monkeypatch, number):
    opened = h5py.File

    def without_locks(*where, locking=None, **how):
        if locking is not False:
            raise OSError(number, f"unable to lock file, errno = {number}")
        return opened(*where, locking=locking, **how)

    monkeypatch.setattr(inspection.h5py, "File", without_locks)
    with inspection.open_for_reading(path) as file:
        assert list(file["values"]) == [1, 2, 3]


def test_file_that_another_program_has_open_for_writing_is_named(path):
    with h5py.File(path, "r+"), pytest.raises(NotReadable, match=r"another program .*HDF5_USE_FILE_LOCKING"):
        open_hdf5(path)
    with open_hdf5(path) as file:
        assert list(file["values"]) == [1, 2, 3]
