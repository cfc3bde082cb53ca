"""Channels and depths of a TIFF stack of a microscope: its pages are not one series of images then.

Sources: ImageJ writes ``channels=2`` into the description of the first page, and its pages are in the order
channel, slice, frame. OME-TIFF writes sizes and the order of the dimensions as XML (OME Data Model, 2016-06).
The library tifffile writes them as JSON, with the slowest dimension first.
"""

import json
import re
from math import prod

from dic.files.reading import Content
from dic.image.tiff import opened_page

_NAMES = {"C": "channels", "Z": "depths", "T": "times"}
_IMAGEJ = re.compile(r"^(images|channels|slices|frames)=(\d{1,9})\s*$", re.MULTILINE)
_OME = re.compile(r"<(?:\w+:)?Pixels\b[^>]*>")
_OME_SIZE = re.compile(r"\bSize([CZT])\s*=\s*[\"'](\d{1,9})[\"']")
_OME_ORDER = re.compile(r"\bDimensionOrder\s*=\s*[\"']XY([CZT]{3})[\"']")


def series_of_pages(content: Content, pages: list[int]) -> tuple[list[list[int]], str]:
    """Return the numbers of the pages of each series of images, from 1, and what the series are.

    There is one series unless the file says that its pages are channels, or planes at several depths of an
    image that was taken several times. ImageJ calls the pages of a simple stack slices, so depths alone are a
    series.

    `pages`: positions of the directories of all pages.

    Returns
    -------
    series : list of list of int
    what : str
        Such as "channels"; empty for one series.

    Raises
    ------
    Damage
        If the first directory cannot be read.
    """
    whole = list(range(1, len(pages) + 1))
    with opened_page(content) as first:
        sizes, order = _described(first.description)
    apart = [name for name in ("C", "Z") if sizes.get(name, 1) > 1]
    if apart == ["Z"] and sizes.get("T", 1) < 2:
        apart = []
    if not apart or prod(sizes.values()) != len(pages):
        return [whole], ""
    found: dict[tuple[int, ...], list[int]] = {}
    for page in whole:
        places, rest = {}, page - 1
        for name in order:
            rest, places[name] = divmod(rest, sizes.get(name, 1))
        found.setdefault(tuple(places[name] for name in apart), []).append(page)
    return list(found.values()), " and ".join(_NAMES[name] for name in apart)


def _described(text: str) -> tuple[dict[str, int], str]:
    """Return the sizes of the dimensions C, Z and T, and their order, the fastest first."""
    if text.startswith("ImageJ="):
        found = {name: int(size) for name, size in _IMAGEJ.findall(text)}
        return {
            "C": found.get("channels", 1),
            "Z": found.get("slices", 1),
            "T": found.get("frames", 1),
        }, "CZT"
    if text.startswith("{"):
        return _of_axes(text)
    pixels = _OME.search(text)
    order = _OME_ORDER.search(pixels[0]) if pixels else None
    if pixels is None or order is None or len(set(order[1])) < 3:
        return {}, "CZT"
    return {name: int(size) for name, size in _OME_SIZE.findall(pixels[0])}, order[1]


def _of_axes(text: str) -> tuple[dict[str, int], str]:
    """Return the sizes and the order from a description with the keys shape and axes, such as "TCYX"."""
    try:
        found = json.loads(text)
        axes, shape = str(found["axes"]), [int(size) for size in found["shape"]]
    except (ValueError, TypeError, KeyError):
        return {}, "CZT"
    sizes = {name: size for name, size in zip(axes, shape, strict=False) if name in _NAMES}
    order = "".join(name for name in reversed(axes) if name in sizes)
    return sizes, order + "".join(name for name in "CZT" if name not in order)
