"""A new file for HDF5 whose errors are raised after a write, and never within HDF5.

If a write fails, for example because the disk is full, HDF5 cannot close the file: it reports every buffered
object, and then ends the program with a crash. So HDF5 writes to `NewFile`, which keeps in memory what no
longer fits on the disk. HDF5 then closes the file as usual, and the writer asks `NewFile` for the error.

A file can be read after each `commit`, even if the program is killed at any time afterwards; see
`dic.hdf5.commit`.
"""

from collections.abc import Callable
from io import SEEK_CUR, SEEK_END, SEEK_SET, FileIO, RawIOBase
from pathlib import Path
from typing import Any

from dic.hdf5.commit import overwrite, write_at
from dic.typing import PathLike

INDEX_CACHE_BYTES = 2**20
"""Size of HDF5's cache of metadata, in bytes of the file; a series of images needs about 0.7 MB at a time."""


class NewFile:
    """A new HDF5 file, and the first error of writing it.

    `path`: the file is created, or emptied if it exists. `shown`: name of the file in errors, for a temporary
    file. Default: `path`. `track_order`: True to keep the order in which the objects of the file are created.

    `hdf5`: the open file.

    Raises `OSError` if the file cannot be created.
    """

    def __init__(self, path: Path, shown: PathLike | None = None, *, track_order: bool = False) -> None:
        import h5py

        name = str(shown or path)
        try:
            file = path.open("w+b", buffering=0)
        except OSError as error:
            error.filename = name
            raise
        self._bytes = _Bytes(file, name)
        try:
            # Turn off the cache, because each row is written once as a whole. The cache would keep a megabyte
            # of rows for each dataset.
            self.hdf5: Any = h5py.File(self._bytes, "w", rdcc_nbytes=0, track_order=track_order)
            _limit_index_cache(self.hdf5.id)
        except BaseException:
            self._bytes.close()
            raise

    def require_written(self) -> None:
        """Raise the first `OSError` of writing, if there was one."""
        if self._bytes.error is not None:
            raise self._bytes.error

    def commit(self) -> None:
        """Write everything to the disk; the file can be read in this state until the next commit.

        Raises `OSError` if something could not be written. The file then keeps the state of the last commit.
        """
        self.hdf5.flush()
        self._bytes.commit()

    def descriptor(self) -> int:
        """Return the descriptor of the open file."""
        return self._bytes.fileno()

    def close(self) -> None:
        """Close the file.

        Raises `OSError` if the file is not complete.
        """
        try:
            self.hdf5.close()
            if self._bytes.committed:
                self._bytes.commit()
        finally:
            self._bytes.close()
        self.require_written()


def _limit_index_cache(file_id: Any) -> None:
    """Limit the cache in which HDF5 keeps the index of chunks.

    New rows need only the newest part of the index. By default the cache holds the indices of hundreds of
    rows and takes tens of megabytes, because an entry is several times larger in memory than in the file.
    """
    config = file_id.get_mdc_config()
    config.set_initial_size = True
    config.initial_size = config.min_size = config.max_size = INDEX_CACHE_BYTES
    file_id.set_mdc_config(config)


class _Bytes(RawIOBase):
    """The file object to which h5py writes. After an error, it keeps new bytes in memory.

    Bytes that the last commit wrote stay as they are in the file until the next commit. What HDF5 writes over
    them, which is its index, is in memory until then.
    """

    def __init__(self, file: FileIO, shown: str) -> None:
        self.error: OSError | None = None
        """The first error of writing."""
        self.committed = 0
        """Size of the file at the last commit; 0 before the first one."""
        self._file, self._shown = file, shown
        self._at = self._size = 0
        self._kept: dict[tuple[int, int], bytes] = {}

    def fileno(self) -> int:
        return self._file.fileno()

    def seek(self, offset: int, whence: int = SEEK_SET, /) -> int:
        self._at = offset + {SEEK_SET: 0, SEEK_CUR: self._at, SEEK_END: self._size}[whence]
        return self._at

    def tell(self) -> int:
        return self._at

    def readinto(self, buffer: Any, /) -> int:
        wanted = memoryview(buffer).cast("B")
        count = max(0, min(len(wanted), self._size - self._at))
        wanted[:count] = bytes(count)
        self._file.seek(self._at)
        done = 0
        while done < count and (more := self._file.readinto(wanted[done:count])):
            done += more
        for (start, length), data in self._kept.items():
            first, last = max(start, self._at), min(start + length, self._at + count)
            if first < last:
                wanted[first - self._at : last - self._at] = data[first - start : last - start]
        self._at += count
        return count

    def write(self, data: Any, /) -> int:
        given = memoryview(data).cast("B")
        kept = max(0, min(self.committed - self._at, len(given)))
        self._keep(self._at, given[:kept])
        rest, at = given[kept:], self._at + kept
        if self.error is None:
            self._try(lambda: write_at(self._file, at, rest))
        if self.error is not None:
            self._keep(at, rest)
        self._at += len(given)
        self._size = max(self._size, self._at)
        return len(given)

    def truncate(self, size: int | None = None, /) -> int:
        self._size = self._at if size is None else size
        if self.error is None and self._size >= self.committed:
            self._try(lambda: self._file.truncate(self._size))
        return self._size

    def commit(self) -> None:
        """Make the file what HDF5 has written, as a whole; see `dic.hdf5.commit`."""
        if self.error is None:
            self._try(lambda: overwrite(self._file, self._size, self._kept))
        if self.error is not None:
            raise self.error
        self.committed = self._size
        self._kept.clear()

    def close(self) -> None:
        self._file.close()
        super().close()

    def _keep(self, at: int, data: memoryview) -> None:
        """Keep bytes in memory; they come after all earlier ones at the same place."""
        if len(data):
            self._kept.pop((at, len(data)), None)
            self._kept[at, len(data)] = bytes(data)

    def _try(self, work: Callable[[], object]) -> None:
        """Do some work on the file, and keep its error."""
        try:
            work()
        except OSError as error:
            self.error = error
            error.filename = self._shown
