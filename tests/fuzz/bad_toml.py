"""Make bad protocols and rig files by a change of one value, key or table in a good file."""

import random
from pathlib import Path

from tests.fuzz.bad_files import Maker

_NUMBERS = ("nan", "inf", "-inf", "-1e9", "1e400", '"0.1"', "true", "[]", "{}", "1979-05-27", "-1")
_TEXTS = ('""', "3", "nan", "[]", '"a\\u0000b"', '"two\\nlines"', f'"{"x" * 70_000}"')
_BROKEN = ("key", "= 3", "a = [", '"', "[[", "a = 1\na = 2", "\\", "a.b = 1\na = 2", "\x00", "a = 0x")


def _lines(good: Path) -> list[str]:
    return good.read_text(encoding="utf-8").splitlines()


def _numbers(lines: list[str]) -> list[int]:
    return [n for n, line in enumerate(lines) if "=" in line and line.split("=")[1].strip()[:1].isdigit()]


def _bad_number(good: Path, place: Path, chance: random.Random) -> Path:
    lines = _lines(good)
    # -5.0 is a limit that may be any number, and a seed may be 0
    free = ("angle_m", "seed", "axis_slope")
    n = chance.choice([n for n in _numbers(lines) if not lines[n].strip().startswith(free)])
    lines[n] = f"{lines[n].split('=')[0]}= {chance.choice(_NUMBERS)}"
    place.write_text("\n".join(lines), encoding="utf-8")
    return place


def _bad_text(good: Path, place: Path, chance: random.Random) -> Path:
    lines = _lines(good)
    n = chance.choice([n for n, line in enumerate(lines) if '= "' in line])
    lines[n] = f"{lines[n].split('=')[0]}= {chance.choice(_TEXTS)}"
    place.write_text("\n".join(lines), encoding="utf-8")
    return place


def _unknown_key(good: Path, place: Path, chance: random.Random) -> Path:
    lines = _lines(good)
    n = chance.choice([n for n, line in enumerate(lines) if line.startswith("[")])
    lines.insert(n + 1, chance.choice(["dwel_s = 1", '"" = 1', '"a b" = {}', "ключ = 1", "x.y.z = 1"]))
    place.write_text("\n".join(lines), encoding="utf-8")
    return place


def _broken(good: Path, place: Path, chance: random.Random) -> Path:
    lines = _lines(good)
    lines.insert(chance.randrange(len(lines)), chance.choice(_BROKEN))
    place.write_text("\n".join(lines), encoding="utf-8")
    return place


def _deep(good: Path, place: Path, chance: random.Random) -> Path:
    text = chance.choice(
        ["a = " + "[" * 50_000, "[" + ".".join("a" * 5_000) + "]\nb = 1", "a = {b = " * 5_000]
    )
    place.write_text(text, encoding="utf-8")
    return place


def _not_utf8(good: Path, place: Path, chance: random.Random) -> Path:
    encoding = chance.choice(["utf-16", "utf-8-sig"])
    place.write_bytes(good.read_text(encoding="utf-8").encode(encoding))
    return place


def _many_digits(good: Path, place: Path, chance: random.Random) -> Path:
    lines = _lines(good)
    n = chance.choice(_numbers(lines))
    lines[n] = f"{lines[n].split('=')[0]}= {'9' * 5000}"
    place.write_text("\n".join(lines), encoding="utf-8")
    return place


TOMLS: dict[str, Maker] = {
    "a bad number": _bad_number,
    "a bad text": _bad_text,
    "an unknown key": _unknown_key,
    "no TOML": _broken,
    "nested deeply": _deep,
    "not UTF-8": _not_utf8,
    "a number of 5000 digits": _many_digits,
}
