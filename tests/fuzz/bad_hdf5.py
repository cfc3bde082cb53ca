"""Make bad HDF5 files: a dataset of a good file becomes a link, or is declared larger than any disk."""

import random
from pathlib import Path
from typing import Any

import h5py

from tests.fuzz.bad_files import Maker

TEBIBYTE = 2**40


def _datasets(file: Any) -> list[str]:
    names: list[str] = []
    file.visititems(lambda name, item: names.append(name) if isinstance(item, h5py.Dataset) else None)
    return sorted(names)


def _replaced(good: Path, place: Path, chance: random.Random, what: str) -> Path:
    place.write_bytes(good.read_bytes())
    with h5py.File(place, "r+") as file:
        name = chance.choice(_datasets(file))
        del file[name]
        if what == "elsewhere":
            file[name] = h5py.ExternalLink(str(good), name)
        elif what == "circle":
            file[name] = h5py.SoftLink(f"/{name}")
        elif what == "dangling":
            file[name] = h5py.SoftLink("/nowhere")
        elif what == "huge":
            file.create_dataset(name, shape=(8 * TEBIBYTE,), dtype="u1", chunks=(2**20,))
        elif what == "stored elsewhere":
            outside = [("/etc/hostname", 0, h5py.h5f.UNLIMITED)]
            file.create_dataset(name, shape=(8,), dtype="u1", external=outside)
    return place


def _maker(what: str) -> Maker:
    return lambda good, place, chance: _replaced(good, place, chance, what)


def _cut(good: Path, place: Path, chance: random.Random) -> Path:
    content = good.read_bytes()
    place.write_bytes(content[: chance.randrange(1, len(content) // 2)])
    return place


HDF5: dict[str, Maker] = {
    "cut off": _cut,
    "a link into another file": _maker("elsewhere"),
    "a link to itself": _maker("circle"),
    "a link to nothing": _maker("dangling"),
    "eight tebibytes": _maker("huge"),
    "stored in another file": _maker("stored elsewhere"),
}
