"""The found region is written as a mask, as polygons and as a picture, and can be read again."""

import json

import cv2
import numpy as np
import pytest

from dic import find_specimen, read_region
from dic.errors import OutputError
from dic.specimen import region_files, write_region
from dic.specimen.write import region_polygons
from tests.command_line import run_dic
from tests.dic.specimen.scenes import scene
from tests.image_files import write_image


@pytest.fixture
def folder(tmp_path):
    drawn = scene("plate_with_hole", 3)
    write_image(tmp_path / "reference.png", drawn.reference)
    write_image(tmp_path / "moved.png", drawn.moved)
    return tmp_path


def test_a_mask_gives_exactly_the_region_and_polygons_follow_its_outline(tmp_path):
    drawn = scene("plate_with_hole", 3)
    region = find_specimen(drawn.reference, 21).mask
    files = write_region(region, drawn.reference, tmp_path / "mask.png")
    np.testing.assert_array_equal(read_region(files.mask, (), region.shape), region)
    drawn_again = read_region(None, [str(files.polygons)], region.shape)
    different = (drawn_again != region).astype(np.uint8)
    # Nowhere do the polygons leave the outline by more than a pixel.
    assert not cv2.erode(different, np.ones((3, 3), np.uint8)).any()
    assert different.mean() < 0.005


def test_polygons_of_boxes_have_their_corners_and_holes():
    mask = np.zeros((60, 80), bool)
    mask[10:50, 20:70] = True
    mask[25:35, 30:40] = False
    outer, hole = sorted(region_polygons(mask), key=lambda corners: -np.ptp(corners))
    assert np.abs(np.sort(outer, axis=0)[[0, -1]] - [[19.75, 9.75], [69.25, 49.25]]).max() <= 0.5
    assert np.abs(np.sort(hole, axis=0)[[0, -1]] - [[29.25, 24.25], [39.75, 34.75]]).max() <= 0.5


def test_the_overlay_shows_the_image_and_darkens_what_is_left_out(tmp_path):
    drawn = scene("dark_room", 3)
    region = np.zeros(drawn.mask.shape, bool)
    region[100:200, 120:260] = True
    files = write_region(region, np.full(region.shape, 200, np.uint8) + drawn.mask, tmp_path / "m.png")
    overlay = cv2.imread(str(files.overlay))
    assert overlay[150, 180].tolist() == 3 * [int(overlay[150, 180, 0])]
    assert overlay[20:80, 20:80].max() < 100
    assert (overlay[100, 130:250] == [0, 140, 255]).all()


def test_a_mask_that_is_no_png_is_refused(tmp_path):
    with pytest.raises(OutputError, match=r"a name that ends with \.png"):
        region_files(tmp_path / "mask.tif")


def test_the_mask_given_back_gives_the_same_results(folder):
    def measure(*arguments: str) -> list[dict]:
        result = run_dic(
            "correlate", folder / "reference.png", folder / "moved.png", "--subset", 21, "--force",
            "--json", folder / "r.json", *arguments,
        )  # fmt: skip
        assert result.status == 0, result.err
        content = json.loads((folder / "r.json").read_text())
        return content["images"], content.get("specimen"), result.out

    found, specimen, text = measure("--write-mask", folder / "mask.png")
    assert specimen["surfaces"] == 1
    assert f"specimen found on {100 * specimen['share']:.0f} % of the image (1 surface); left out:" in text
    given, none, _ = measure("--roi", folder / "mask.png")
    assert (given, none) == (found, None)
    drawn, _, _ = measure("--polygon", folder / "mask.toml")
    assert drawn[0]["points"] == pytest.approx(found[0]["points"], rel=0.02)


def test_quality_writes_the_same_mask(folder):
    for command in (
        ("correlate", folder / "reference.png", folder / "moved.png", "--write-mask", folder / "a.png"),
        ("quality", folder / "reference.png", "--write-mask", folder / "b.png", "--json", folder / "q.json"),
    ):
        run_dic(*command)
    assert (folder / "a.png").read_bytes() == (folder / "b.png").read_bytes()
    assert json.loads((folder / "q.json").read_text())["specimen"]["surfaces"] == 1


def test_no_file_is_replaced_without_being_asked(folder):
    (folder / "mask.toml").write_text("precious")
    result = run_dic("quality", folder / "reference.png", "--write-mask", folder / "mask.png")
    assert result.status == 2
    assert "mask.toml" in result.err
    assert "--force" in result.err
    assert (folder / "mask.toml").read_text() == "precious"


def test_a_white_mask_is_the_whole_image(folder):
    write_image(folder / "white.png", np.full((320, 400), 255))
    assert read_region(folder / "white.png", (), (320, 400)).all()
