"""The maps of a series have one scale for all images, and show the last measurement of each image."""

import cv2
import numpy as np
import pytest

import dic
from dic.derived.series_maps import MapFiles, SeriesMaps
from tests.dic.pictures.fields import SHAPE, stretched

GREY = np.full(SHAPE, 128.0, np.float32)
SETTINGS = dic.pictures.MapSettings(quantities=("u",), axes="off", opacity=1.0)


@pytest.fixture
def pictures(tmp_path):
    """A function that draws maps of measurements, given as (image number, strain), and reads the pictures."""

    def draw(*added, settings=SETTINGS):
        files = [tmp_path / f"{number}.png" for number in range(3)]
        maps = SeriesMaps(GREY, MapFiles(files, {"exx": tmp_path / "sheet.png"}), settings)
        for number, strain in added:
            maps.add(number, "", dic.measure(stretched(strain)), None)
        left = maps.pictures_left
        maps.draw()
        drawn = [cv2.imread(str(file)) for file in files if file.exists()]
        assert left == len(drawn) * (settings.scale == "series") + 1
        return drawn

    return draw


@pytest.mark.extended
def test_an_image_added_again_replaces_the_first_and_leaves_no_trace_in_the_scale(pictures):
    plain = pictures((0, 0.001), (1, 0.002))
    corrected = pictures((0, 0.5), (1, 0.9), (0, 0.001), (1, 0.002))
    for one, other in zip(plain, corrected, strict=True):
        np.testing.assert_array_equal(one, other)


def test_equal_images_look_alike_only_on_one_scale(pictures):
    series = pictures((0, 0.001), (1, 0.002))
    assert (series[0] != series[1]).any()
    own = pictures(
        (0, 0.001), (1, 0.001), settings=dic.pictures.MapSettings(quantities=("u",), scale="image")
    )
    np.testing.assert_array_equal(own[0], own[1])


@pytest.mark.parametrize("scale", ["series", "image"])
def test_a_contact_sheet_alone_is_that_beside_maps(tmp_path, pictures, scale):
    settings = dic.pictures.MapSettings(quantities=("u",), axes="off", scale=scale)
    pictures((0, 0.001), (1, 0.002), settings=settings)
    maps = SeriesMaps(GREY, MapFiles([], {"exx": tmp_path / "alone.png"}), settings)
    for number, strain in ((0, 0.001), (1, 0.002)):
        maps.add(number, "", dic.measure(stretched(strain)), None)
    assert maps.pictures_left == 1
    maps.draw()
    assert (tmp_path / "alone.png").read_bytes() == (tmp_path / "sheet.png").read_bytes()
