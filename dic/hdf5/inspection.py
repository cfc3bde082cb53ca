"""Inspect an HDF5 file in a process of its own, because a damaged file can crash HDF5 or keep it busy.

The command `python -m dic.hdf5.inspection` reads paths of files and answers whether each file is good;
`serve` describes the lines of requests and answers. With a path as its argument, the command answers for this
file only. Every file is inspected in a process of its own. The inspection visits every object in the file.
The files of this program are trees of groups and data sets, each with one name. A file is refused if it holds
anything else: links to places outside the tree, data stored in other files, references to objects, or
declared sizes that the file cannot hold.
"""

import errno
import json
import os
import select
import sys
from contextlib import suppress
from math import prod
from pathlib import Path
from typing import Any

import h5py
import numpy as np

_IN_USE = (errno.EAGAIN,)
LOCKED = (
    "a file that another program has open for writing; close it there, or read it as it is by setting the "
    "environment variable HDF5_USE_FILE_LOCKING to FALSE"
)
_NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP)
_MEMORY_BYTES = 4 << 30
PROCESSOR_S = 8
"""Processor time that an inspection may take, however busy the machine is; a good file takes 0.1 s."""

_IDLE_S = 60.0
"""The process ends if it gets no request for this time."""
_REPORT_BYTES_MAX = 4096

_OBJECTS_MAX = 10_000
_ATTRIBUTES_MAX = 1_000
_DEPTH_MAX = 8
_RANK_MAX = 5
_ATTRIBUTE_BYTES_MAX = 1 << 20
_DECLARED_BYTES_MIN = 64 << 20
"""Number of bytes that even a small file may declare, because HDF5 stores no rows that are not written."""
_READ_BYTES_MAX = 16 << 20
_FILTERS = {h5py.h5z.FILTER_FLETCHER32, h5py.h5z.FILTER_DEFLATE, h5py.h5z.FILTER_SHUFFLE}


class RefusedFileError(Exception):
    """The file is refused. The message names the object that is the reason."""


def open_for_reading(path: Path) -> Any:
    """Open an HDF5 file, even one that is being written, or whose writer was killed.

    A file system without locks, such as some network drives, is read without one.

    Raises `OSError` if the file is truncated or not HDF5, or if another program has it open for writing.
    """
    try:
        return _opened(path)
    except OSError as error:
        # Network drives refuse locks with many errors. HDF5's own marks still tell of a program that writes.
        refused = "unable to lock file" in str(error) and error.errno not in _IN_USE
        if error.errno not in _NO_LOCKS and not refused:
            raise
        return _opened(path, locking=False)


def _opened(path: Path, **how: Any) -> Any:
    try:
        # The rows of a result file are chunks of their own, and hardly any is read twice in a row. HDF5 would
        # keep several rows of each data set.
        # Do not try SWMR mode (reading during writing) first: HDF5 would wait forever for the writer of a
        # truncated file.
        return h5py.File(path, "r", rdcc_nbytes=0, **how)
    except OSError as error:
        if "already open for write" not in str(error):
            raise
        return h5py.File(path, "r", swmr=True, rdcc_nbytes=0, **how)


def inspect(path: Path) -> None:
    """Visit all objects in a file, and read their attributes and small data sets.

    Raises `RefusedFileError` if the file contains an object that files of this program never contain. Raises
    `Exception` if the file is damaged. The type of the exception depends on the damage.
    """
    try:
        opened = open_for_reading(path)
    except OSError as error:
        raise RefusedFileError(
            LOCKED if error.errno in _IN_USE else "a file that was cut off or is no HDF5"
        ) from error
    with opened as file:
        Walk.of(path).group(h5py.h5g.open(file.id, b"/"), "/", 0)


class Walk:
    """Visit all objects in a file. All data sets together may declare at most `declared_bytes_max` bytes."""

    def __init__(self, declared_bytes_max: int) -> None:
        self._left_bytes = self._declared_bytes_max = declared_bytes_max
        self._seen: set[Any] = set()

    @classmethod
    def of(cls, path: Path) -> "Walk":
        """Return the walk through a file, with the number of bytes that its data sets may declare."""
        # Count the stored blocks, because the size of a sparse file is larger than its content.
        return cls(2 * os.stat(path).st_blocks * 512 + _DECLARED_BYTES_MIN)  # noqa: PTH116

    def group(self, identifier: Any, name: str, depth: int) -> None:
        """Visit a group and all groups and data sets in it."""
        self._enter(identifier, name, depth)
        for key in identifier:
            place = f"{name.rstrip('/')}/{key.decode()}"
            if identifier.links.get_info(key).type != h5py.h5l.TYPE_HARD:
                raise RefusedFileError(f"the link {place} to another place or file")
            child = h5py.h5o.open(identifier, key)
            if isinstance(child, h5py.h5g.GroupID):
                self.group(child, place, depth + 1)
            elif isinstance(child, h5py.h5d.DatasetID):
                self._enter(child, place, depth + 1)
                self.dataset(child, place)
            else:
                raise RefusedFileError(f"the data type {place}, which is neither a group nor a data set")

    def _enter(self, identifier: Any, name: str, depth: int) -> None:
        info = h5py.h5o.get_info(identifier)
        if depth > _DEPTH_MAX or len(self._seen) >= _OBJECTS_MAX:
            raise RefusedFileError(f"too many groups and data sets, at {name}")
        if info.addr in self._seen or info.rc != 1:
            raise RefusedFileError(f"{name}, which has two names in the file")
        self._seen.add(info.addr)
        if info.num_attrs > _ATTRIBUTES_MAX:
            raise RefusedFileError(f"{info.num_attrs} attributes of {name}")
        for number in range(info.num_attrs):
            self._attribute(h5py.h5a.open(identifier, index=number), name)

    def _attribute(self, attribute: Any, name: str) -> None:
        place = f"attribute {attribute.name.decode()} of {name}"
        kind, space = attribute.get_type(), attribute.get_space()
        _require_plain(kind, place)
        size = space.get_simple_extent_npoints() * kind.get_size()
        if size > _ATTRIBUTE_BYTES_MAX:
            raise RefusedFileError(f"{place}, of {size} bytes")
        # The type and the size of the attribute are acceptable, so read the value as well.
        if size:
            attribute.read(np.empty(space.shape, kind.dtype))

    def dataset(self, dataset: Any, name: str) -> None:
        """Refuse a data set that is no plain data in this file; read its values if they are few."""
        kind, space, properties = dataset.get_type(), dataset.get_space(), dataset.get_create_plist()
        _require_plain(kind, name)
        if properties.get_external_count():
            raise RefusedFileError(f"{name}, whose data are stored in another file")
        layout = properties.get_layout()
        if layout == h5py.h5d.VIRTUAL:
            raise RefusedFileError(f"{name}, whose data are views of other files")
        for number in range(properties.get_nfilters()):
            if properties.get_filter(number)[0] not in _FILTERS:
                raise RefusedFileError(f"{name}, compressed by an unknown filter")
        if space.get_simple_extent_type() == h5py.h5s.NULL or len(space.shape) > _RANK_MAX:
            dimensions = "no" if space.get_simple_extent_type() == h5py.h5s.NULL else len(space.shape)
            raise RefusedFileError(f"{name}, of {dimensions} dimensions")
        size = prod(space.shape) * kind.get_size()
        chunk = prod(properties.get_chunk()) * kind.get_size() if layout == h5py.h5d.CHUNKED else 0
        self._left_bytes -= size
        if max(size, chunk) > self._declared_bytes_max or self._left_bytes < 0:
            raise RefusedFileError(
                f"{name}, with {max(size, chunk)} bytes declared in a file that holds far less"
            )
        if layout == h5py.h5d.CHUNKED:
            dataset.chunk_iter(lambda _: None)
        if 0 < size <= _READ_BYTES_MAX and len(space.shape) < 3:
            dataset.read(h5py.h5s.ALL, h5py.h5s.ALL, np.empty(space.shape, kind.dtype))


def _require_plain(kind: Any, place: str) -> None:
    """Refuse a data type if it is not a number, a truth value or a text."""
    plain = isinstance(kind, h5py.h5t.TypeIntegerID | h5py.h5t.TypeFloatID | h5py.h5t.TypeStringID)
    if not plain and not isinstance(kind, h5py.h5t.TypeEnumID):
        raise RefusedFileError(f"{place}, which is neither a number nor a text")


def _report(path: Path) -> str:
    """Return the reason why a file is refused, or an empty text if the file is good."""
    try:
        inspect(path)
    except RefusedFileError as refusal:
        return " ".join(str(refusal).split())
    except Exception as error:
        return f"a damaged file ({type(error).__name__})"
    return ""


def _inspect_in_child(path: Path) -> tuple[int, str]:
    """Inspect a file in a child process; return the child's exit status and its report.

    If a signal ended the child, the status is the negative number of this signal. This process has one
    thread, so forking is safe. This process has loaded HDF5, so forking is quick.
    """
    import resource  # Windows lacks this module, but never calls this function

    read_end, write_end = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(read_end)
        status = 1
        try:
            resource.setrlimit(resource.RLIMIT_CPU, (PROCESSOR_S, PROCESSOR_S + 1))
            os.write(write_end, _report(path).encode("utf-8", "replace")[:_REPORT_BYTES_MAX])
            status = 0
        finally:
            os._exit(status)
    os.close(write_end)
    with os.fdopen(read_end, "rb") as pipe:
        said = pipe.read().decode("utf-8", "replace")
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), said


def limit_memory() -> None:
    """Limit the memory of this process, so that a damaged file cannot fill that of the machine.

    Raises `ImportError` on Windows, where a process has no such limits.
    """
    import resource

    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    with suppress(ValueError, OSError):  # macOS cannot limit the address space
        resource.setrlimit(resource.RLIMIT_AS, (_MEMORY_BYTES, _MEMORY_BYTES))


def serve(requests: int, answers: int) -> None:
    """Inspect file after file, until the other program ends or sends nothing for a minute.

    A request is a JSON text with the path of a file, on a line of its own. The answer is a JSON list on one
    line. The list holds the exit status of the inspecting process, negative for a signal, and its report.
    """
    limit_memory()
    with os.fdopen(requests, "rb", buffering=0) as incoming:
        while select.select([incoming], [], [], _IDLE_S)[0]:
            line = incoming.readline()
            if not line:
                return
            answer = _inspect_in_child(Path(json.loads(line)))
            os.write(answers, json.dumps(answer).encode() + b"\n")


def answer_once(path: Path) -> None:
    """Inspect one file in this process, and print the answer, on a system that cannot copy a process."""
    print(json.dumps((0, _report(path)[:_REPORT_BYTES_MAX])))


if __name__ == "__main__":
    if len(sys.argv) > 1:
        answer_once(Path(sys.argv[1]))
    else:
        serve(0, 1)
