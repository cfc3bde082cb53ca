"""A test from images has a name in linked data that only the contents of its images determine."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

import dic
from dic.derived.ontology_facts import about_series
from tests.command_line import run_dic


def write_series(folder, names, shifts_px):
    """Measure a pattern that is shifted as a whole, and return the loaded result file.

    An image whose shift is None is dark and cannot be measured.
    """
    folder.mkdir()
    noise = np.random.default_rng(8).integers(0, 256, (100, 100)).astype(np.uint8)
    pattern = cv2.resize(noise, None, fx=3, fy=3, interpolation=cv2.INTER_CUBIC)
    for name, shift in zip(names, shifts_px, strict=True):
        grey = np.zeros_like(pattern) if shift is None else np.roll(pattern, shift, axis=1)
        cv2.imwrite(str(folder / name), grey[40:200, 40:200])
    images = [folder / name for name in names]
    done = run_dic("correlate", *images, "-o", folder / "r.h5", "--subset", 31, "--step", 25)
    assert done.status == (2 if None in shifts_px else 0), done
    return dic.load_series_result(folder / "r.h5")


def name_of(result, *, without=()):
    """Return the name of the test; the images with the given numbers count as failed."""
    images = [
        replace(image, measurement=None, correction=None, failure="not found") if k in without else image
        for k, image in enumerate(result.series.images)
    ]
    changed = replace(result, series=replace(result.series, images=images))
    gauge = dic.gauges.PointGauge(name="axial", at=(80.0, 80.0))
    return about_series(
        dic.measure_gauges(changed, [gauge]), "axial", "raw", {"specimen": {"name": "Zx7"}}
    ).name


@pytest.mark.extended
def test_the_name_of_a_series_depends_on_the_contents_of_its_images_alone(tmp_path):
    names = ["img000.png", "img001.png", "img002.png", "img003.png"]
    one = write_series(tmp_path / "load", names, (0, 1, 2, None))
    assert [image.failure is None for image in one.series.images] == [True, True, False]
    other = write_series(tmp_path / "reload", names, (0, 3, 2, None))
    renamed = write_series(tmp_path / "renamed", ["z.png", "y.png", "x.png", "w.png"], (0, 1, 2, None))
    fewer = write_series(tmp_path / "fewer", names[:3], (0, 1, 2))
    assert len({name_of(each) for each in (one, other, fewer)}) == 3
    assert name_of(renamed) == name_of(one)
    assert name_of(one, without=[0]) == name_of(one, without=[1]) == name_of(one)
