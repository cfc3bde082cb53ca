"""The region file: polygons, holes and cracks in TOML or JSON."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from dic.errors import CorrelationError, MeasurementError, is_number, is_whole, joined
from dic.regions.drawn import NARROWEST_CRACK_PX, WIDEST_CRACK_PX, Crack, DrawnRegion, Outline
from dic.typing import Float

_KEYS = ("polygons", "polygon", "holes", "crack", "image_size_px")
_CRACK_KEYS = ("path", "width_px")
_STEP = "read region of interest"
_MOST = 1e6
_MOST_CORNERS = 100_000
_EXAMPLE = "give polygons = [[[10, 10], [200, 10], [200, 150]]]"
_CORNERS_A_LINE = 8


def region_of(content: object, source: str) -> DrawnRegion:
    """Return the region that the content of a TOML or JSON file describes.

    `content`: a mapping with ``polygons = [[[x, y], …], …]``, and optionally with ``holes`` in the same form,
    ``crack`` with tables of ``path = [[x, y], …]`` and ``width_px``, and ``image_size_px = [width, height]``.
    For a single polygon, ``polygon`` may be used instead of ``polygons``. `source`: the file, for error
    messages.

    Raises `CorrelationError` if there are unknown keys, or values that are no polygons or cracks. The message
    names all mistakes.
    """
    if not isinstance(content, Mapping):
        expected = f"a table with the keys {', '.join(_KEYS)}"
        raise CorrelationError(source, _STEP, expected, f"a {type(content).__name__}", _EXAMPLE)
    errors: list[MeasurementError] = [
        CorrelationError(source, "keys", f"one of {', '.join(_KEYS)}", str(key)[:40], "correct or remove it")
        for key in content
        if key not in _KEYS
    ]
    single, several = content.get("polygon"), content.get("polygons")
    if (single is None) == (several is None):
        got = "none" if single is None else "polygon and polygons"
        errors.append(CorrelationError(source, "polygons", "at least one polygon", got, _EXAMPLE))
    given = several if single is None else [single]
    polygons = _outlines(given, f"{source}, polygon", errors) if given is not None else []
    if several == []:
        errors.append(CorrelationError(source, "polygons", "at least one polygon", "none", _EXAMPLE))
    holes = _outlines(content.get("holes", []), f"{source}, hole", errors)
    cracks = _cracks(content.get("crack", []), source, errors)
    sizes = [(source, size) for size in _size(content.get("image_size_px"), source, errors)]
    if errors:
        raise joined(errors)
    return DrawnRegion(polygons, holes, cracks, sizes)


def outlines_of(polygons: Sequence[tuple[str, object]]) -> list[Outline]:
    """Convert polygons with labels to outlines.

    Raises `CorrelationError` if values are not at least three pairs of finite numbers. The message names all
    such polygons.
    """
    errors: list[MeasurementError] = []
    outlines = [one for label, corners in polygons for one in _outline(corners, label, errors)]
    if errors:
        raise joined(errors)
    return outlines


def region_text(polygons: Sequence[Float], image_size_px: tuple[int, int]) -> str:
    """Return polygons (corners, 2) as the text of a region file.

    `image_size_px`: width and height of the image on which the polygons were drawn.
    """
    lines = [
        "# Corners [x, y] in px from the centre of the first pixel, x to the right, y downwards.",
        "# A polygon inside another one is a hole; holes may also cross outlines.",
        f"image_size_px = [{image_size_px[0]}, {image_size_px[1]}]",
        "polygons = [",
        *(line for corners in polygons for line in _corner_lines(corners)),
        "]",
    ]
    return "\n".join([*lines, ""])


def _corner_lines(corners: Float) -> Iterator[str]:
    pairs = [f"[{x:g}, {y:g}]" for x, y in corners.tolist()]
    yield "  ["
    for first in range(0, len(pairs), _CORNERS_A_LINE):
        yield "    " + ", ".join(pairs[first : first + _CORNERS_A_LINE]) + ","
    yield "  ],"


def _outlines(given: object, label: str, errors: list[MeasurementError]) -> list[Outline]:
    if not isinstance(given, list):
        errors.append(CorrelationError(label, _STEP, "a list of polygons", f"{given!r:.40}", _EXAMPLE))
        return []
    return [one for k, corners in enumerate(given, 1) for one in _outline(corners, f"{label} {k}", errors)]


def _outline(corners: object, label: str, errors: list[MeasurementError]) -> list[Outline]:
    """Return the outline in a list; if it is no polygon, add an error and return an empty list."""
    places = _places(corners)
    if places is None:
        got, remedy = "other values", "give pairs of numbers [x, y] in px"
    elif len(places) < 3:
        got, remedy = f"{len(places)} corners", _EXAMPLE
    elif len(places) > _MOST_CORNERS:
        got, remedy = f"{len(places)} corners", f"give at most {_MOST_CORNERS} corners"
    else:
        return [Outline(label, places)]
    expected = f"a polygon with at least 3 and at most {_MOST_CORNERS} corners [x, y]"
    errors.append(CorrelationError(label, _STEP, expected, got, remedy))
    return []


def _cracks(given: object, source: str, errors: list[MeasurementError]) -> list[Crack]:
    example = "write [[crack]], path = [[100, 200], [300, 220]] and width_px = 4"
    if not isinstance(given, list) or not all(isinstance(one, dict) for one in given):
        errors.append(
            CorrelationError(source, "crack", "a table [[crack]] for each", "other values", example)
        )
        return []
    found = []
    for number, table in enumerate(given, 1):
        label, before = f"{source}, crack {number}", len(errors)
        errors += [
            CorrelationError(label, "keys", ", ".join(_CRACK_KEYS), str(key)[:40], "correct or remove it")
            for key in table
            if key not in _CRACK_KEYS
        ]
        path, width_px = _places(table.get("path")), table.get("width_px")
        if path is None or len(path) < 2 or (path == path[0]).all():
            got = "no pairs of numbers" if path is None else f"{len(np.unique(path, axis=0))}"
            errors.append(CorrelationError(label, "path", "at least 2 different places", got, example))
        if not is_number(width_px) or not NARROWEST_CRACK_PX <= width_px <= WIDEST_CRACK_PX:
            expected = f"from {NARROWEST_CRACK_PX:g} to {WIDEST_CRACK_PX:g} px"
            got = "none" if width_px is None else f"{width_px!r:.40}"
            errors.append(CorrelationError(label, "width_px", expected, got, "give width_px = 4"))
        if len(errors) == before and path is not None:
            found.append(Crack(label, path, float(table["width_px"])))
    return found


def _size(given: object, source: str, errors: list[MeasurementError]) -> list[tuple[int, int]]:
    if given is None:
        return []
    if isinstance(given, list) and len(given) == 2 and all(is_whole(side) and side > 0 for side in given):
        return [(int(given[0]), int(given[1]))]
    expected, remedy = "width and height of the image in px", "give image_size_px = [1024, 768]"
    errors.append(CorrelationError(source, "image_size_px", expected, f"{given!r:.40}", remedy))
    return []


def _places(given: Any) -> Float | None:
    """Return places as an array (n, 2); None if the values are no pairs of finite numbers."""
    if isinstance(given, np.ndarray):
        good = given.ndim == 2 and given.shape[1] == 2
        pairs = given.astype(np.float64) if good else None
    elif isinstance(given, list) and all(_is_pair(pair) for pair in given):
        pairs = np.array(given, np.float64).reshape(-1, 2)
    else:
        return None
    return pairs if pairs is not None and bool((np.abs(pairs) < _MOST).all()) else None


def _is_pair(pair: object) -> bool:
    return isinstance(pair, list) and len(pair) == 2 and all(is_number(value) for value in pair)
