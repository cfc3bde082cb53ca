"""Make bad files from good ones. Each bad file is certainly bad, so each must be refused."""

import os
import random
import socket
import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

from tests.dic.regions.imagej_bytes import LINE, POLYGON, RECT, roi_bytes

Maker = Callable[[Path, Path, random.Random], Path]
"""Type of a function that makes a bad file from a good one, and returns its path."""

_DEEP = 100_000


def _missing(good: Path, place: Path, chance: random.Random) -> Path:
    return place


def _empty(good: Path, place: Path, chance: random.Random) -> Path:
    place.touch()
    return place


def _folder(good: Path, place: Path, chance: random.Random) -> Path:
    place.mkdir()
    return place


def _pipe(good: Path, place: Path, chance: random.Random) -> Path:
    os.mkfifo(place)
    return place


def _socket(good: Path, place: Path, chance: random.Random) -> Path:
    short = Path(os.path.relpath(place))
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(str(short))
    return place


def _circle(good: Path, place: Path, chance: random.Random) -> Path:
    other = place.with_name(place.name + ".other")
    place.symlink_to(other.name)
    other.symlink_to(place.name)
    return place


def _dangling(good: Path, place: Path, chance: random.Random) -> Path:
    place.symlink_to("nowhere")
    return place


def _endless(good: Path, place: Path, chance: random.Random) -> Path:
    place.symlink_to(chance.choice(["/dev/zero", "/dev/urandom", "/dev/full"]))
    return place


def _sparse(good: Path, place: Path, chance: random.Random) -> Path:
    place.write_bytes(good.read_bytes()[:64])
    os.truncate(place, 2**42)
    return place


def _noise(good: Path, place: Path, chance: random.Random) -> Path:
    place.write_bytes(b"\xff" + chance.randbytes(chance.randrange(1, 5000)))
    return place


def _other_kind(good: Path, place: Path, chance: random.Random) -> Path:
    """Write a good file of another kind."""
    kinds = [path for path in good.parent.iterdir() if path.is_file() and path.suffix != good.suffix]
    images = {".png", ".tif", ".bmp"}
    others = [path for path in kinds if not {path.suffix, good.suffix} <= images]
    place.write_bytes(chance.choice(sorted(others)).read_bytes())
    return place


def _cut(good: Path, place: Path, chance: random.Random) -> Path:
    content = good.read_bytes()
    place.write_bytes(content[: chance.randrange(1, len(content) - 2)])
    return place


ANY: dict[str, Maker] = {
    "missing": _missing,
    "empty": _empty,
    "a folder": _folder,
    "a pipe": _pipe,
    "a socket": _socket,
    "a circle of links": _circle,
    "a link to nowhere": _dangling,
    "a device": _endless,
    "four terabytes": _sparse,
    "noise": _noise,
    "of another kind": _other_kind,
}


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def _bomb(good: Path, place: Path, chance: random.Random) -> Path:
    """Write a small PNG, TIFF or BMP file that declares an image larger than the memory."""
    side = chance.randrange(12_000, 2**31 - 1)
    if good.suffix == ".bmp":
        header = struct.pack("<2sIHHIIiiHHIIiiII", b"BM", 0, 0, 0, 54, 40, side, side, 1, 8, 1, 0, 0, 0, 0, 0)
        place.write_bytes(header + b"\0" * 100)
    elif good.suffix == ".tif":
        strip = zlib.compress(b"\0" * 2**20)
        entries = [(256, 4, side), (257, 4, side), (258, 3, 8), (259, 3, 8), (262, 3, 1), (273, 4, 8)]
        entries += [(277, 3, 1), (278, 4, side), (279, 4, len(strip))]
        table = struct.pack("<H", len(entries)) + b"".join(
            struct.pack("<HHIHxx" if kind == 3 else "<HHII", tag, kind, 1, value)
            for tag, kind, value in entries
        )
        start = 8 + len(strip)
        place.write_bytes(b"II*\0" + struct.pack("<I", start) + strip + table + b"\0" * 4)
    else:
        rows = zlib.compress(b"\0" * chance.choice([10, 2**24]))
        header = struct.pack(">IIBBBBB", side, side, *chance.choice([(8, 0), (16, 6), (8, 3)]), 0, 0, 0)
        parts = (_chunk(b"IHDR", header), _chunk(b"IDAT", rows), _chunk(b"IEND", b""))
        place.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(parts))
    return place


def _flat(good: Path, place: Path, chance: random.Random) -> Path:
    """Write an image of one grey level, which has no texture and no grid, and is no mask."""
    side = chance.choice([1, 8, 31, 64, 480])
    rows = zlib.compress((b"\0" + b"\x80" * side) * side)
    header = struct.pack(">IIBBBBB", side, side, 8, 0, 0, 0, 0)
    parts = (_chunk(b"IHDR", header), _chunk(b"IDAT", rows), _chunk(b"IEND", b""))
    place.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(parts))
    return place


def _flipped(good: Path, place: Path, chance: random.Random) -> Path:
    """Change one byte in the second half of a PNG, which a checksum covers."""
    content = bytearray(good.read_bytes())
    content[chance.randrange(len(content) // 2, len(content) - 20)] ^= chance.randrange(1, 256)
    place.write_bytes(content)
    return place


IMAGES: dict[str, Maker] = {"cut off": _cut, "a bomb": _bomb, "flat": _flat}
PNGS: dict[str, Maker] = IMAGES | {"damaged": _flipped}


def _texts(*texts: str) -> Maker:
    def make(good: Path, place: Path, chance: random.Random) -> Path:
        place.write_text(chance.choice(texts), encoding="utf-8")
        return place

    return make


POLYGONS: dict[str, Maker] = {
    "a cell missing": _texts("x_px,y_px,polygon\n1,1,a\n5\n9,9,a\n", "x_px,y_px\n1,1\n,5\n9,9\n"),
    "a column missing": _texts("x_px,z_px\n1,1\n5,5\n5,9\n", "1,1\n5,5\n5,9\n"),
    "no numbers": _texts("x_px,y_px\na,b\nc,d\ne,f\n", "x_px,y_px\nnan,1\n5,5\n5,inf\n"),
    "too few corners": _texts("x_px,y_px\n1,1\n5,5\n"),
    "beside the image": _texts("x_px,y_px\n9000,9000\n9100,9000\n9100,9100\n"),
    "a quote that never ends": _texts('x_px,y_px\n"1,1\n5,5\n5,9\n' + "x" * 200_000),
    "null characters": _texts("x_px,y_px\n1,1\n\0,5\n5,9\n"),
}


REGIONS: dict[str, Maker] = {
    "deep": _texts("polygons = " + "[" * _DEEP),
    "an unknown key": _texts("polygon = [[1, 1], [90, 1], [9, 90]]\ncolour = 3\n"),
    "no polygon": _texts("", "polygons = []\n", "polygons = 3\n", "polygon = {}\n", "holes = [[[1, 1]]]\n"),
    "no pairs": _texts("polygon = [[1, 1], [90], [9, 90]]\n", "polygon = [['a', 1], [90, 1], [nan, 90]]\n"),
    "crossing edges": _texts("polygon = [[10, 10], [300, 300], [300, 10], [10, 300]]\n"),
    "beside the image": _texts("polygon = [[10, 10], [9000, 10], [10, 300]]\n"),
    "no crack": _texts(
        "polygon = [[1, 1], [90, 1], [9, 90]]\ncrack = 3\n",
        "polygon = [[1, 1], [90, 1], [9, 90]]\n[[crack]]\npath = [[1, 1], [1, 1]]\nwidth_px = -1\n",
    ),
}


def _roi(*values: bytes) -> Maker:
    """Return a maker of an archive with one of the given contents as its area."""

    def make(good: Path, place: Path, chance: random.Random) -> Path:
        with zipfile.ZipFile(place, "w") as archive:
            archive.writestr("area.roi", chance.choice(values))
        return place

    return make


AREAS: dict[str, Maker] = {
    "cut off": _cut,
    "damaged": _roi(b"", b"Iout", b"Iout" + bytes(70), b"Iout" + b"\xff" * 80, b"PK" * 50),
    "no area": _roi(roi_bytes(LINE, (0, 0, 9, 9)), roi_bytes(POLYGON, (0, 0, 9, 9), [(0, 0), (9, 9)])),
    "beside the image": _roi(roi_bytes(RECT, (0, 0, 9000, 9000))),
    "a bomb": _roi(bytes(2**25)),
}


def _alignment(**values: str) -> str:
    unit = "[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]"
    good = {"slopes": "[0, 0, 0, 0]", "covariance": unit, "pivot_mm": "[0, 0]"}
    entries = ", ".join(f'"{name}": {value}' for name, value in (good | values).items())
    return f'{{"file_format": "offaxis-alignment", {entries}}}'


JSONS: dict[str, Maker] = {
    "deep": _texts("[" * _DEEP, '{"slopes": ' + "[" * _DEEP + "]" * _DEEP + "}"),
    "a list": _texts("[]", "3", "null", '"text"', "{}", "[[1, 2], [3, 4]]"),
    "a number of many digits": _texts(_alignment(slopes="9" * 5000)),
    "wrong shapes": _texts(_alignment(slopes="[1]"), _alignment(covariance="[]"), _alignment(pivot_mm="3")),
    "not finite": _texts(_alignment(slopes="[NaN, 0, 0, 0]"), _alignment(pivot_mm="[Infinity, 0]")),
    "no covariance": _texts(_alignment(covariance="[" + ", ".join(["[1, 2, 3, 4]"] * 4) + "]")),
    "text in numbers": _texts(_alignment(slopes='"abcd"'), _alignment(covariance="{}")),
    "cut off": _cut,
}

GAUGES: dict[str, Maker] = {
    "no gauge": _texts("unit = 'px'\n", "gauge = []\n", "[gauge]\nname = 'a'\n"),
    "an unknown key": _texts("[[gauge]]\nname = 'a'\nkind = 'point'\nat = [240, 240]\nsize = 3\n"),
    "a missing key": _texts("[[gauge]]\nname = 'a'\nkind = 'extensometer'\nstart = [240, 240]\n"),
    "no number": _texts("[[gauge]]\nname = 'a'\nkind = 'point'\nat = ['x', nan]\n"),
    "one name twice": _texts(2 * "[[gauge]]\nname = 'a'\nkind = 'point'\nat = [240, 240]\n"),
    "beside the image": _texts("[[gauge]]\nname = 'a'\nkind = 'point'\nat = [9000, 240]\n"),
    "deep": _texts("a = " + "[" * _DEEP),
}

CURVES: dict[str, Maker] = {
    "an empty column": _texts("Load,Strain\n" + "".join(f"{k},\n" for k in range(50))),
    "text in numbers": _texts("Load,Strain\n" + "".join(f"{k},{k if k != 30 else 'x'}\n" for k in range(50))),
    "another unit": _texts("Load (N),Strain\n" + "".join(f"{k},{k}\n" for k in range(50))),
    "time that runs backwards": _texts(
        "Time,Load,Strain\n" + "".join(f"{abs(25 - k)},{k},{k}\n" for k in range(50))
    ),
    "compression": _texts("Load,Strain\n" + "".join(f"{-k},{-k}\n" for k in range(50))),
    "a column missing": _texts("Load,Extension\n" + "".join(f"{k},{k}\n" for k in range(50))),
}
