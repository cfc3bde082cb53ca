"""Tests with images of other laboratories: a plate with a hole, a necking specimen, a rotation by 170°."""

import numpy as np
import pytest

from tests.command_line import run_dic


def run(tmp_path, *arguments):
    result = run_dic("correlate", *arguments, "--json", tmp_path / "report.json")
    assert result.status == 0, result
    return result.report["images"]


def check_converged(images, share):
    for image in images:
        assert image["converged"] >= share * image["points"], image


def test_the_plate_with_a_hole(real_images, tmp_path):
    files = sorted((real_images / "ohtcfrp").glob("ohtcfrp_*.png"))
    images = run(tmp_path, *files, "--roi", real_images / "ohtcfrp" / "roi.png")
    assert len(images) == 11
    check_converged(images, 0.99)
    # Loaded along y in steps: the strain grows and the plate contracts across.
    eyy = [image["raw"]["eyy"] for image in images]
    assert eyy == sorted(eyy)
    assert images[-1]["raw"]["exx"] < 0 < eyy[-1]


@pytest.mark.extended
def test_the_necking_specimen(real_images, tmp_path):
    files = sorted((real_images / "tension").glob("img_*.tif"))
    images = run(tmp_path, *files, "--csv", tmp_path / "csv")
    assert len(images) == 4
    check_converged(images, 0.99)
    last = np.genfromtxt(tmp_path / "csv" / "img_4.csv", delimiter=",", skip_header=1, usecols=(2,))
    assert np.nanpercentile(last, 5) == pytest.approx(-41, abs=1)


def test_the_turn_by_170_degrees(real_images, tmp_path):
    folder = real_images / "rotation170"
    images = run(tmp_path, folder / "rotation_000.tif", folder / "rotation_170.tif")
    check_converged(images, 0.99)
    assert images[0]["start"] == "features"
    assert images[0]["raw"]["rotation_deg"] == pytest.approx(170.0, abs=0.05)
    # The picture was turned by computer: nothing strained it.
    assert abs(images[0]["raw"]["exx"]) < 20e-6
    assert abs(images[0]["raw"]["eyy"]) < 20e-6
