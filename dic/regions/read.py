"""Read a region of interest from a text of the command line, or from a file of any of the known formats."""

import csv
import json
import re
from collections.abc import Sequence
from pathlib import Path

from dic.errors import CorrelationError
from dic.files.reading import read_text
from dic.files.toml import read_toml
from dic.regions.drawn import DrawnRegion
from dic.regions.file import outlines_of, region_of
from dic.regions.imagej import imagej_areas
from dic.regions.tables import EXPECTED as _EXPECTED_TABLE, read_corners
from dic.typing import PathLike

IMAGEJ = (".roi", ".zip")
REGION_FILES = (".toml", ".json", ".csv", *IMAGEJ)
"""Suffixes of files that contain regions; a file with another suffix is a mask image."""

_PAIR = r"[-+.\deE]+\s*,\s*[-+.\deE]+"
_TYPED = re.compile(rf"\s*{_PAIR}(\s+{_PAIR})*\s*")
_STEP = "read region of interest"
_EXPECTED = 'a polygon "x,y x,y x,y", or a region file with one of the endings ' + ", ".join(REGION_FILES)
_REMEDY = 'give at least 3 corners, for example "10,10 200,10 200,150"'
_BETTER = "correct it, or draw it by `dic draw`"


def is_region_file(path: PathLike) -> bool:
    """Return True if the suffix of a file shows that it is a region file, not a mask image."""
    return Path(path).suffix.lower() in REGION_FILES


def read_drawn_region(source: str) -> DrawnRegion:
    """Return the region that a text of the command line gives, or that a file contains.

    `source`: the corners of a polygon, "x,y x,y x,y …" in px, or the path of a file: a region file in TOML or
    JSON (`dic.regions.file.region_of`), a CSV table of corners, or areas of ImageJ.

    Raises `CorrelationError` if the file is missing, or does not contain a region.
    """
    if _TYPED.fullmatch(source):
        label = source if len(source) <= 40 else f"{source[:39]}…"
        return DrawnRegion(outlines_of([(f"polygon {label!r}", _typed_corners(source))]))
    path = Path(source)
    if not is_region_file(path):
        remedy = "give a region file; a mask image belongs to --roi"
        raise CorrelationError(source, _STEP, _EXPECTED, path.suffix or "no ending", remedy)
    if path.suffix.lower() == ".toml":
        return region_of(read_toml(path, CorrelationError, _STEP, _BETTER), source)
    try:
        if path.suffix.lower() in IMAGEJ:
            return _of_polygons(source, imagej_areas(path))
        return _of_text(source, path.suffix.lower())
    except OSError as error:
        raise CorrelationError(source, _STEP, _EXPECTED, error.strerror or str(error), _REMEDY) from error


def _typed_corners(text: str) -> list[list[float]] | None:
    """Return the corners in a text; None if a part of it, such as 1e1e1, is no number."""
    try:
        return [[float(value) for value in pair.split(",")] for pair in re.sub(r"\s*,\s*", ",", text).split()]
    except ValueError:
        return None


def _of_text(source: str, ending: str) -> DrawnRegion:
    try:
        text = read_text(source)
        if ending == ".csv":
            named = [(f"{source}, polygon {k}", one) for k, one in enumerate(read_corners(text), 1)]
            return _of_polygons(source, named)
        content = json.loads(text)
    except (ValueError, RecursionError, csv.Error) as error:
        expected = _EXPECTED_TABLE if ending == ".csv" else "a region file in JSON"
        got = f"one that cannot be understood ({' '.join(str(error).split())})"
        raise CorrelationError(source, _STEP, expected, got, _BETTER) from error
    return region_of(content, source)


def _of_polygons(source: str, polygons: Sequence[tuple[str, object]]) -> DrawnRegion:
    if not polygons:
        raise CorrelationError(source, _STEP, "at least one polygon", "none", _REMEDY)
    return DrawnRegion(outlines_of(polygons))
