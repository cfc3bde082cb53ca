"""The channels of a TIFF stack of a microscope: its pages are not one series of images then.

Sources: ImageJ writes ``channels=2`` into the description of the first page, and its pages are in the order
channel, slice, frame. OME-TIFF writes sizes and the order of the dimensions as XML (OME Data Model, 2016-06).
"""

import re
from math import prod

from dic.files.reading import Content
from dic.image.tiff_directory import read_entries

_DESCRIPTION = 270
_IMAGEJ = re.compile(r"^(images|channels|slices|frames)=(\d{1,9})\s*$", re.MULTILINE)
_OME = re.compile(r"<(?:\w+:)?Pixels\b[^>]*>")
_OME_SIZE = re.compile(r"\bSize([CZT])\s*=\s*[\"'](\d{1,9})[\"']")
_OME_ORDER = re.compile(r"\bDimensionOrder\s*=\s*[\"']XY([CZT]{3})[\"']")


def pages_by_channel(content: Content, pages: list[int]) -> list[list[int]]:
    """Return the numbers of the pages of each channel, from 1; one channel if the file says nothing else.

    Parameters
    ----------
    content : Content
    pages : list of int
        Positions of the directories of all pages.

    Raises
    ------
    Damage, struct.error
        If the first directory cannot be read.
    """
    whole = [list(range(1, len(pages) + 1))]
    stored = [entry.stored for entry in read_entries(content, pages[0], (_DESCRIPTION,))]
    text = stored[0].decode("utf-8", "replace") if stored else ""
    sizes, order = _described(text)
    channels = sizes.get("C", 1)
    if channels < 2 or prod(sizes.values()) != len(pages):
        return whole
    before = prod(sizes.get(name, 1) for name in order[: order.index("C")])
    return [[page for page in whole[0] if (page - 1) // before % channels == k] for k in range(channels)]


def _described(text: str) -> tuple[dict[str, int], str]:
    """Return the sizes of the dimensions C, Z and T, and their order, the fastest first."""
    if text.startswith("ImageJ="):
        found = {name: int(size) for name, size in _IMAGEJ.findall(text)}
        return {
            "C": found.get("channels", 1),
            "Z": found.get("slices", 1),
            "T": found.get("frames", 1),
        }, "CZT"
    pixels = _OME.search(text)
    order = _OME_ORDER.search(pixels[0]) if pixels else None
    if pixels is None or order is None or len(set(order[1])) < 3:
        return {}, "CZT"
    return {name: int(size) for name, size in _OME_SIZE.findall(pixels[0])}, order[1]
