"""Tests of the search for missing numbers in the file names of a series."""

from pathlib import Path

import pytest

from dic.image.numbering import missing_numbers


@pytest.mark.parametrize(
    ("names", "missing"),
    [
        (["img000.png", "img001.png", "img002.png", "img004.png", "img007.png", "img008.png"],
         ["img003.png", "img005.png to img006.png"]),
        (["a0.tif", "a10.tif", "a20.tif", "a40.tif"], ["a30.tif"]),
        (["ref.png", "1.png", "2.png", "3.png", "5.png"], ["4.png"]),
        # Two cameras: each has numbers of its own.
        ([f"s-{k:04d}_{c}.tif" for k in (0, 1, 2, 3, 5) for c in (0, 1) if (k, c) != (3, 1)],
         ["s-0004_0.tif", "s-0003_1.tif to s-0004_1.tif"]),
        # Times of day do not count.
        (["i_120001.png", "i_120004.png", "i_120011.png", "i_120013.png"], []),
        (["img1.png", "img2.png", "img10.png"], []),
        (["img1.png"], []),
        (["a.png", "b.png"], []),
    ],
)  # fmt: skip
def test_missing_numbers_are_found_and_irregular_numbers_have_none(names, missing):
    assert missing_numbers(map(Path, names)) == missing
