"""Regions of interest given as polygons, on the command line or in a TOML, JSON or CSV file."""

import csv
import json
import re
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dic.errors import CorrelationError
from dic.files.reading import read_text
from dic.typing import Float, Mask

_PAIR = r"[-+.\deE]+\s*,\s*[-+.\deE]+"
_TYPED = re.compile(rf"\s*{_PAIR}(\s+{_PAIR})*\s*")
_EXPECTED = (
    'corners as "x,y x,y x,y", or a file: TOML or JSON with polygon = [[x, y], ...] or'
    " polygons = [polygon, ...], or CSV with columns x_px, y_px and, for several, polygon"
)
_REMEDY = 'give at least 3 corners, for example "10,10 200,10 200,150"'


def read_polygons(source: str) -> list[Float]:
    """Return the polygons that a text of the command line gives, or that a file holds.

    Parameters
    ----------
    source : str
        The corners of a polygon, "x,y x,y x,y …" in px, or the path of a file.

    Returns
    -------
    list of ndarray, shape (corners, 2)
        The corners (x, y) of each polygon, at least three, px.

    Raises
    ------
    CorrelationError
        If the file is missing or does not hold polygons.
    """
    if _TYPED.fullmatch(source):
        found: Any = [[pair.split(",") for pair in re.sub(r"\s*,\s*", ",", source).split()]]
    else:
        found = _polygons_in(Path(source))
    try:
        polygons = [np.array(corners, np.float64) for corners in found]
    except (TypeError, ValueError) as error:
        raise _refusal(source, "values that are no pairs of numbers") from error
    for corners in polygons:
        if corners.ndim != 2 or corners.shape[1] != 2 or len(corners) < 3 or not np.isfinite(corners).all():
            raise _refusal(source, f"values of shape {corners.shape}, or fewer than 3 corners")
    if not polygons:
        raise _refusal(source, "no polygon")
    return polygons


def polygon_mask(polygons: Sequence[Float], shape: tuple[int, ...]) -> Mask:
    """Return a mask that is True at pixels whose centre lies inside an odd number of polygons.

    So a polygon inside another polygon is a hole.

    Parameters
    ----------
    polygons : sequence of ndarray, shape (corners, 2)
    shape : (int, int)
        Height and width of the image.
    """
    height, width = shape
    starts = np.concatenate(polygons)
    ends = np.concatenate([np.roll(corners, -1, axis=0) for corners in polygons])
    pixels = np.arange(width)
    mask = np.zeros((height, width), np.bool_)
    for y in range(height):
        # A corner exactly on this row belongs only to the edge below the row, so that no corner counts twice.
        crossed = (starts[:, 1] <= y) != (ends[:, 1] <= y)
        (x0, y0), (x1, y1) = starts[crossed].T, ends[crossed].T
        crossings = np.sort(x0 + (y - y0) / (y1 - y0) * (x1 - x0))
        mask[y] = np.searchsorted(crossings, pixels, side="right") % 2 == 1
    return mask


def _polygons_in(path: Path) -> Any:
    try:
        text = read_text(path)
        if path.suffix == ".csv":
            return _csv_polygons(text)
        content = tomllib.loads(text) if path.suffix == ".toml" else json.loads(text)
    except OSError as error:
        raise _refusal(str(path), error.strerror or str(error)) from error
    except (ValueError, KeyError, TypeError, RecursionError, csv.Error) as error:
        raise _refusal(str(path), f"a file that cannot be understood ({error})") from error
    if isinstance(content, dict) and len(content) == 1:
        name, value = content.popitem()
        if name in ("polygon", "polygons"):
            return [value] if name == "polygon" else value
    raise _refusal(str(path), "a file without polygon or polygons")


def _csv_polygons(text: str) -> list[list[tuple[float, float]]]:
    polygons: dict[str, list[tuple[float, float]]] = {}
    for row in csv.DictReader(text.splitlines()):
        corner = float(row["x_px"]), float(row["y_px"])
        polygons.setdefault(row.get("polygon") or "", []).append(corner)
    return list(polygons.values())


def _refusal(source: str, got: str) -> CorrelationError:
    return CorrelationError(source, "read region of interest", _EXPECTED, got, _REMEDY)
