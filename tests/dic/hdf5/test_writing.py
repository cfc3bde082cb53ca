"""If the disk becomes full while HDF5 writes, there is one error, no crash and no file that seems good."""

import resource
from contextlib import closing

import h5py
import numpy as np
import pytest

from dic.hdf5.writing import INDEX_CACHE_BYTES, NewFile
from tests.full_disk import full_disk

ROWS, DATASETS = 20, 4


def fill(file):
    for k in range(DATASETS):
        file.create_dataset(f"d{k}", (0, 30, 30), "f8", maxshape=(None, 30, 30), chunks=(1, 30, 30))
    for n in range(ROWS):
        for k in range(DATASETS):
            dataset = file[f"d{k}"]
            dataset.resize(n + 1, axis=0)
            dataset[n] = n + k


def write(path, most_bytes):
    """Write a file on a disk that has room for `most_bytes`; return the error or None."""
    try:
        with full_disk(most_bytes), closing(NewFile(path)) as file:
            fill(file.hdf5)
    except OSError as error:
        return error
    return None


def test_file_has_the_bytes_that_hdf5_writes_by_itself(tmp_path):
    with h5py.File(tmp_path / "plain.h5", "w", rdcc_nbytes=0) as plain:
        fill(plain)
    file = NewFile(tmp_path / "new.h5")
    fill(file.hdf5)
    file.close()
    assert (tmp_path / "new.h5").read_bytes() == (tmp_path / "plain.h5").read_bytes()
    with h5py.File(tmp_path / "new.h5") as read:
        for k in range(DATASETS):
            expected = np.broadcast_to((np.arange(ROWS) + k)[:, None, None], (ROWS, 30, 30))
            np.testing.assert_array_equal(read[f"d{k}"][:], expected)


def test_every_full_disk_raises_one_error_that_names_the_file(tmp_path):
    path = tmp_path / "new.h5"
    assert write(path, resource.RLIM_INFINITY) is None
    size = path.stat().st_size
    assert write(path, size) is None
    some = np.random.default_rng(2).integers(1, size, 12).tolist()
    for most_bytes in (0, 7, *some, size - 1):
        error = write(path, most_bytes)
        assert error is not None, most_bytes
        assert error.filename == str(path)
        assert error.strerror == "File too large"


def test_file_that_cannot_be_created_is_refused(tmp_path):
    with pytest.raises(FileNotFoundError):
        NewFile(tmp_path / "missing" / "new.h5")


@pytest.mark.parametrize("limited", [False, True])
def test_memory_for_the_index_of_a_long_series_has_a_limit(tmp_path, limited):
    path = tmp_path / "new.h5"
    with closing(NewFile(path).hdf5 if limited else h5py.File(path, "w", rdcc_nbytes=0)) as file:
        rows = 40_000
        dataset = file.create_dataset("d", (rows, 1, 1), "f8", chunks=(1, 1, 1))
        for n in range(rows):
            dataset.id.write_direct_chunk((n, 0, 0), bytes(8))
        *_, in_use, _ = file.id.get_mdc_size()
        assert (in_use <= INDEX_CACHE_BYTES) == limited
        assert dataset[rows - 1, 0, 0] == 0
