"""Read numbers from a MATLAB file of version 7.3, which is an HDF5 file, in a process of its own.

MATLAB (MathWorks, "MAT-File Versions") stores a structure as a group with one member for each field. If the
structure is an array, each field is a data set of references to the values of the elements. A cell array is
such a data set too. The dimensions of an array are in reverse order. An empty array has the attribute
MATLAB_empty, and its data set has the dimensions of the array as its values.

`dic.hdf5.open` refuses references, because the files of this program have none. A damaged file can crash HDF5
or keep it busy, so another process, `python -m dic.hdf5.matlab`, reads the numbers.
"""

import io
import json
import subprocess
import sys
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from dic.hdf5.inspection import RefusedFileError, Walk, limit_memory, open_for_reading
from dic.hdf5.inspector import environment
from dic.hdf5.open import NotReadable
from dic.typing import Float

_TIMEOUT_S = 120.0
"""Longest wait for the numbers of one image."""


@dataclass(frozen=True)
class Element:
    """One element of a field of a structure."""

    count: int
    """Number of elements of the structure, or of the cell array in the field; 0 if there is no such field."""
    value: Float | None
    """The numbers of the element in MATLAB's order of dimensions; None if it is empty or has no numbers."""


def read_elements(path: Path, wanted: Mapping[str, int]) -> dict[str, Element]:
    """Return elements of fields of a MATLAB file of version 7.3, by the names of the fields.

    `wanted`: names of fields with the structures around them, such as "data/displacements/u", and the number
    of the element, from 1.

    Raises `NotReadable` if the file is damaged, or refused for one of the reasons of `dic.hdf5.inspection`.
    """
    command = [sys.executable, "-P", "-m", "dic.hdf5.matlab", str(path.absolute())]
    request = json.dumps(dict(wanted)).encode()
    try:
        ended = subprocess.run(
            command, input=request, capture_output=True, timeout=_TIMEOUT_S, env=environment(), check=False
        )
    except subprocess.TimeoutExpired as error:
        raise NotReadable(f"a file that was not read within {_TIMEOUT_S:g} s") from error
    if ended.returncode < 0:
        raise NotReadable(f"a damaged file: HDF5 crashed on it (signal {-ended.returncode})")
    if ended.returncode:
        raise NotReadable(ended.stderr.decode("utf-8", "replace").strip() or "a file that cannot be read")
    with np.load(io.BytesIO(ended.stdout)) as arrays:
        counts = dict(zip(wanted, arrays["counts"].tolist(), strict=True))
        values = {name: arrays.get(str(k)) for k, name in enumerate(wanted)}
    return {name: Element(counts[name], values[name]) for name in wanted}


def elements_of(file: Any, wanted: Mapping[str, int], walk: Walk) -> list[Element]:
    """Return elements of fields of an open file.

    Raises `RefusedFileError` if an object on the way holds something else than numbers in this file.
    """
    return [_element(file, name.split("/"), number, walk) for name, number in wanted.items()]


def _element(file: Any, names: list[str], number: int, walk: Walk) -> Element:
    place = file
    for name in names:
        # An empty structure is a data set, which has no members.
        if not isinstance(place, h5py.Group) or name not in place:
            return Element(0, None)
        if not isinstance(place.get(name, getlink=True), h5py.HardLink):
            raise RefusedFileError(f"the link {name} to another place or file")
        place = place[name]
    if not isinstance(place, h5py.Dataset):
        return Element(1, None)
    if place.dtype != h5py.ref_dtype:
        return Element(1, _numbers(place, walk) if number == 1 else None)
    references = place[()].ravel()
    value = file[references[number - 1]] if 1 <= number <= references.size else None
    return Element(references.size, _numbers(value, walk) if isinstance(value, h5py.Dataset) else None)


def _numbers(dataset: Any, walk: Walk) -> Float | None:
    if dataset.attrs.get("MATLAB_empty", 0) or dataset.dtype.kind not in "fiu":
        return None
    walk.dataset(dataset.id, dataset.name)
    return np.asarray(dataset[()], np.float64).T


def _answer(path: Path) -> None:
    """Read a request from standard input, and write the numbers to standard output."""
    wanted = json.loads(sys.stdin.buffer.read())
    with open_for_reading(path) as file:
        found = elements_of(file, wanted, Walk.of(path))
    arrays: dict[str, Any] = {str(k): each.value for k, each in enumerate(found) if each.value is not None}
    packed = io.BytesIO()
    np.savez(packed, counts=np.array([each.count for each in found]), **arrays)
    sys.stdout.buffer.write(packed.getvalue())


if __name__ == "__main__":
    with suppress(ImportError):  # Windows has no limits of a process
        limit_memory()
    try:
        _answer(Path(sys.argv[1]))
    except RefusedFileError as refusal:
        sys.exit(str(refusal))
    except Exception as error:
        # The type of the exception depends on the damage.
        sys.exit(f"a damaged file ({type(error).__name__})")
