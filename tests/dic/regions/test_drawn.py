"""A region of polygons, holes and cracks covers the pixels that geometry says, and mistakes are named."""

import json
from itertools import pairwise

import numpy as np
import pytest

from dic import read_region
from dic.errors import CorrelationError
from dic.regions.polygons import line_mask
from dic.regions.read import read_drawn_region

SHAPE = (60, 80)
REGION = """
image_size_px = [80, 60]
polygons = [[[9.5, 9.5], [69.5, 9.5], [69.5, 49.5], [9.5, 49.5]]]
holes = [[[59.5, 19.5], [79.5, 19.5], [79.5, 29.5], [59.5, 29.5]]]

[[crack]]
path = [[20, 0], [20, 30]]
width_px = 3
"""


def mask_of(text, tmp_path, name="region.toml"):
    (path := tmp_path / name).write_text(text)
    return read_region(path, (), SHAPE)


def test_holes_may_cross_the_outline_and_cracks_are_lines_with_a_width(tmp_path):
    expected = np.zeros(SHAPE, bool)
    expected[10:50, 10:70] = True
    expected[20:30, 60:] = False
    expected[:31, 19:22] = False
    # The crack ends round: one pixel below its last place is 1.0 away, the pixels beside that one 1.41.
    expected[31, 19:22] = False
    np.testing.assert_array_equal(mask_of(REGION, tmp_path), expected)


def test_the_same_region_in_json(tmp_path):
    content = {
        "polygons": [[[9.5, 9.5], [69.5, 9.5], [69.5, 49.5], [9.5, 49.5]]],
        "holes": [[[59.5, 19.5], [79.5, 19.5], [79.5, 29.5], [59.5, 29.5]]],
        "crack": [{"path": [[20, 0], [20, 30]], "width_px": 3}],
    }
    expected = mask_of(REGION, tmp_path)
    np.testing.assert_array_equal(mask_of(json.dumps(content), tmp_path, "region.json"), expected)


def test_roi_and_polygon_take_the_same_files(tmp_path):
    (path := tmp_path / "region.toml").write_text(REGION)
    np.testing.assert_array_equal(read_region(None, [str(path)], SHAPE), read_region(path, (), SHAPE))


def test_a_bent_crack_covers_the_pixels_near_its_line():
    path, width_px = np.array([[5.0, 6.0], [40.0, 22.5], [33.0, 51.0]]), 5.0
    fine = np.concatenate([np.linspace(a, b, 4000) for a, b in pairwise(path)])
    y, x = np.mgrid[:60, :80]
    distance = np.min([np.hypot(x - px, y - py) for px, py in fine[::8]], axis=0)
    mask = line_mask(path, width_px, SHAPE)
    sure = np.abs(distance - 2.5) > 0.05
    np.testing.assert_array_equal(mask[sure], (distance < 2.5)[sure])
    assert mask.sum() > 200


def test_a_crack_of_one_pixel_separates_its_sides():
    import cv2

    for angle in np.radians(np.arange(0, 180, 7)):
        along = 200 * np.array([np.cos(angle), np.sin(angle)])
        crack = line_mask(np.array([[-1.0], [1.0]]) * along + [40.3, 30.6], 1.0, SHAPE)
        parts, _ = cv2.connectedComponents((~crack).astype(np.uint8), connectivity=4)
        assert parts == 3


def test_all_mistakes_of_a_file_are_named_together(tmp_path):
    text = """
    colour = "red"
    image_size_px = [80]
    polygons = [[[1, 1], [5, 5]], [[1, 1], [9, 1], ["a", 9]], [[1, 1], [9, 1], [9, inf]]]
    holes = 3
    [[crack]]
    path = [[1, 1]]
    width_px = 0
    length = 3
    """
    with pytest.raises(CorrelationError) as refusal:
        mask_of(text, tmp_path)
    message = str(refusal.value)
    for words in (
        "got colour",
        "image_size_px: expected width and height",
        "polygon 1: read region of interest: expected a polygon with at least 3",
        "polygon 2: ",
        "polygon 3: ",
        "hole: read region of interest: expected a list of polygons, got 3",
        "crack 1: keys: expected path, width_px, got length",
        "crack 1: path: expected at least 2 different places",
        "crack 1: width_px: expected from 1 to 1000 px, got 0",
    ):
        assert words in message
    assert "\n" not in message


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("holes = [[[1, 1], [9, 1], [9, 9]]]", "at least one polygon, got none"),
        ("polygons = []", "at least one polygon, got none"),
        ("polygon = [[1, 1], [9, 1], [9, 9]]\npolygons = []", "got polygon and polygons"),
        (
            "polygon = [[1, 1], [9, 9], [9, 1], [1, 9]]",
            r"polygon 1: check the outline: .* crossing at \(5, 5\)",
        ),
        (
            "polygons = [[[1, 1], [20, 1], [20, 20]], [[10, 5], [30, 5], [30, 9], [10, 9]]]",
            r"polygon 1: .* a crossing with .*polygon 2 at \(20, 5\)",
        ),
        ("polygon = [[1, 1], [90, 1], [9, 9]]", r"places inside the image of 80 x 60 px, got \(90, 1\)"),
        (
            "polygon = [[1, 1], [9, 1], [9, 9]]\n[[crack]]\npath = [[1, 1], [9, 99]]\nwidth_px = 2",
            r"crack 1: .* got \(9, 99\)",
        ),
        (
            "polygon = [[1, 1], [9, 1], [9, 9]]\nholes = [[[1, 1], [9, 9], [9, 1], [1, 9]]]",
            r"hole 1: check the outline",
        ),
        (
            "polygon = [[1, 1], [9, 1], [9, 9]]\nimage_size_px = [60, 80]",
            "a region drawn on an image of 80 x 60 px, got 60 x 80 px",
        ),
    ],
)
def test_regions_that_do_not_fit_are_refused(tmp_path, text, words):
    with pytest.raises(CorrelationError, match=words):
        mask_of(text, tmp_path)


def test_corners_may_include_the_outermost_pixels(tmp_path):
    assert mask_of("polygon = [[-1, -1], [80, -1], [80, 60], [-1, 60]]", tmp_path).all()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("x,y\n1,1\n9,1\n9,9\n", ""),
        ("X;Y\n1,0;1,0\n9;1\n9;9\n", ""),
        (" \tx_px\ty_px\n1\t1\t1\n2\t9\t1\n3\t9\t9\n", ""),
        ("x,y,z\n1,1,1\n", "unknown columns z"),
        ("x,x_px,y\n1,1,1\n", "two columns for x"),
        ("x\n1\n", "no column y"),
        ("x,y\n1,1\n9\n", "line 3 has 1 cells"),
        ("x,y\n1,1\n9,a\n", "line 3 has 'a' for a number"),
        ("x,y\n1,1\n9,1\n", "polygon 1: .* at least 3"),
        ("", "no column x and no column y"),
    ],
)
def test_tables_of_corners(tmp_path, text, words):
    (path := tmp_path / "corners.csv").write_text(text)
    if words:
        with pytest.raises(CorrelationError, match=words):
            read_drawn_region(str(path))
    else:
        (one,) = read_drawn_region(str(path)).polygons
        np.testing.assert_array_equal(one.corners, [[1, 1], [9, 1], [9, 9]])
