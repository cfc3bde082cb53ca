"""Make random commands with one bad input each; the same seed gives the same commands."""

import random
import re
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from tests.fuzz.bad_files import ANY, AREAS, CURVES, GAUGES, IMAGES, JSONS, PNGS, POLYGONS, REGIONS, Maker
from tests.fuzz.bad_hdf5 import HDF5
from tests.fuzz.bad_options import bad_options
from tests.fuzz.bad_toml import TOMLS
from tests.fuzz.commands import COMMANDS

KINDS: dict[str, Mapping[str, Maker]] = {
    "image": PNGS,
    "deformed": PNGS,
    # a person may draw on an image without texture
    "picture": {kind: maker for kind, maker in PNGS.items() if kind != "flat"},
    "grid": PNGS,
    "mask": PNGS,
    "tiff": IMAGES,
    "bmp": IMAGES,
    "polygons": POLYGONS,
    "areas": AREAS,
    "region": REGIONS,
    "alignment": JSONS,
    "heartbeat": JSONS,
    "gauges": GAUGES,
    "curve": CURVES,
    # a byte order mark is allowed here, as in other files that only dic reads
    "campaign": {kind: maker for kind, maker in TOMLS.items() if kind != "not UTF-8"},
    "peer": {},
    "protocol": TOMLS,
    "tension": TOMLS,
    "rig": TOMLS,
    "calibration": HDF5,
    "run": HDF5,
    "results": HDF5,
}
"""The special ways to make each kind of file bad; `ANY` has the ways for all files."""

SHARE_OF_OPTIONS = 0.25


@dataclass(frozen=True)
class BadInput:
    """A command line that must be refused, and a description of its bad input."""

    what: str
    arguments: list[str]


def draw(count: int, good: Mapping[str, Path], folder: Path, seed: int) -> Iterator[BadInput]:
    """Yield `count` bad inputs; the files of each are made only when it is yielded."""
    for number in range(count):
        chance = random.Random(zlib.crc32(f"{seed} {number}".encode()))
        command = chance.choice(list(COMMANDS))
        place = folder / f"bad{number}"
        if chance.random() < SHARE_OF_OPTIONS and (options := list(_options(command))):
            bad = chance.choice(options)
            what = f"{command}: {bad[0]} {bad[1][:20]!r}"
            yield BadInput(what, _filled(COMMANDS[command] + bad, good, place))
            continue
        names = [name for name in re.findall(r"{(\w+)}", " ".join(COMMANDS[command])) if name in good]
        name = chance.choice(names)
        kind, make = chance.choice(list((ANY | dict(KINDS[name])).items()))
        bad_file = make(good[name], place.with_suffix(good[name].suffix), chance)
        yield BadInput(
            f"{command}: {name} {kind}", _filled(COMMANDS[command], {**good, name: bad_file}, place)
        )


def _options(command: str) -> Iterator[list[str]]:
    program, name, *_ = COMMANDS[command]
    return bad_options(program, name)


def _filled(arguments: list[str], files: Mapping[str, Path], place: Path) -> list[str]:
    new = place.with_name(f"{place.name}.new")
    return [argument.format(new=new, **files) for argument in arguments]
