"""Read the values of result files, in order to compare two files."""

from pathlib import Path

import h5py
import numpy as np


def bits(path: Path) -> dict[str, bytes]:
    """Return the bits of every dataset and attribute of a result file, by name."""
    found: dict[str, bytes] = {}

    def add(name: str, item: h5py.HLObject) -> None:
        if isinstance(item, h5py.Dataset):
            values = item[()]
            found[name] = (
                repr(values.tolist()).encode() if item.dtype.kind == "O" else np.asarray(values).tobytes()
            )
        found.update({f"{name} {key}": repr(value).encode() for key, value in item.attrs.items()})

    with h5py.File(path) as file:
        file.visititems(add)
    return found


def results(path: Path) -> dict[str, bytes]:
    """Return the bits of all results of a file, without the attributes that describe the command."""
    ways = ("provenance command", "provenance/file", "provenance/sha256")
    return {name: value for name, value in bits(path).items() if name not in ways}
