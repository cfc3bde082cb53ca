"""Areas of ImageJ cover the pixels that ImageJ counts in them; other selections are refused by name."""

import zipfile

import cv2
import numpy as np
import pytest
from roifile import ROI_OPTIONS, ROI_TYPE, ImagejRoi, roiwrite

from dic import read_region
from dic.errors import CorrelationError
from dic.regions.polygons import line_mask
from dic.regions.read import read_drawn_region
from tests.dic.regions.imagej_bytes import (
    FREEHAND,
    LINE,
    OVAL,
    POINT,
    POLYGON,
    RECT,
    SPLINE_FIT,
    SUB_PIXEL,
    TRACED,
    roi_bytes,
)
from tests.places import ROOT

SHAPE = (40, 60)


WRITTEN = ROOT / "tests" / "dic" / "regions" / "imagej"
"""Files that ImageJ 1.53t has written, by `WriteAreas.java` beside them."""


def mask_of(path, shape=SHAPE):
    return read_region(path, (), shape)


def boxed(left, top, right, bottom):
    """The pixels of a rectangle as ImageJ counts them: `right` and `bottom` are the first ones outside."""
    mask = np.zeros(SHAPE, bool)
    mask[top:bottom, left:right] = True
    return mask


@pytest.mark.parametrize("path", sorted(WRITTEN.glob("*.png")), ids=lambda path: path.stem)
def test_areas_have_the_pixels_that_imagej_counts_in_them(path):
    """A pixel whose centre lies exactly on an edge may count for one of the two programs alone."""
    expected = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) > 0
    if path.stem == "exact-rectangle":
        # For its mask ImageJ rounds the edges to whole pixels, here 9.6 … 40.3 to 9 … 40: one row more.
        expected[9] = False
    roi = path.with_suffix(".roi")
    different = mask_of(roi, expected.shape) ^ expected
    outlines = [closed(one.corners) for one in read_drawn_region(str(roi)).polygons]
    on_edges = np.any([line_mask(outline, 0.02, expected.shape) for outline in outlines], axis=0)
    assert not (different & ~on_edges).any()


def closed(corners):
    return np.concatenate([corners, corners[:1]])


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("line", "of the kind line"),
        ("point", "of the kind point"),
        ("spline", "a spline through the corners"),
        ("rounded", "rounded corners"),
        ("text", "of the kind text"),
    ],
)
def test_selections_of_imagej_that_are_no_area_are_refused(name, words):
    with pytest.raises(CorrelationError, match=words):
        mask_of(WRITTEN / f"{name}.roi")


@pytest.mark.parametrize("kind", [POLYGON, FREEHAND, TRACED])
def test_whole_corners_of_a_polygon_are_corners_of_pixels(tmp_path, kind):
    path = tmp_path / "area.roi"
    path.write_bytes(roi_bytes(kind, (5, 10, 15, 30), [(0, 0), (20, 0), (20, 10), (0, 10)]))
    np.testing.assert_array_equal(mask_of(path), boxed(10, 5, 30, 15))


def test_rectangle_covers_its_pixels(tmp_path):
    path = tmp_path / "area.roi"
    path.write_bytes(roi_bytes(RECT, (0, 0, 40, 60)))
    assert mask_of(path).all()
    path.write_bytes(roi_bytes(RECT, (5, 10, 15, 30)))
    np.testing.assert_array_equal(mask_of(path), boxed(10, 5, 30, 15))


def test_exact_corners_have_priority_over_whole_ones(tmp_path):
    exact = [(10.4, 5.6), (30.6, 5.6), (30.6, 15.4), (10.4, 15.4)]
    whole = [(0, 0), (20, 0), (20, 10), (0, 10)]
    path = tmp_path / "area.roi"
    path.write_bytes(roi_bytes(POLYGON, (5, 10, 15, 30), whole, exact=exact, options=SUB_PIXEL))
    # Pixel n has its centre at n + 0.5 in ImageJ: columns 10 to 30 and rows 6 to 14 lie inside.
    np.testing.assert_array_equal(mask_of(path), boxed(10, 6, 31, 15))


def test_oval_has_the_pixels_of_the_ellipse(tmp_path):
    path = tmp_path / "area.roi"
    path.write_bytes(roi_bytes(OVAL, (4, 8, 34, 52)))
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]] + 0.5
    radius = np.hypot((x - 30.0) / 22.0, (y - 19.0) / 15.0)
    mask = mask_of(path)
    assert mask[radius < 0.998].all()
    assert not mask[radius > 1.0].any()
    assert mask.sum() == pytest.approx(np.pi * 22 * 15, rel=0.01)


def test_files_of_another_writer_are_read(tmp_path):
    corners = np.array([[10.25, 5.25], [50.5, 8.0], [30.0, 35.75]], np.float32)
    whole = np.array([[20, 10], [25, 10], [25, 14]])
    (area := ImagejRoi.frompoints(corners, name="plate")).tofile(tmp_path / "plate.roi")
    hole = ImagejRoi.frompoints(whole, name="hole")
    assert area.options & ROI_OPTIONS.SUB_PIXEL_RESOLUTION
    roiwrite(tmp_path / "RoiSet.zip", [area, hole])
    (only,) = read_drawn_region(str(tmp_path / "plate.roi")).polygons
    np.testing.assert_allclose(only.corners, corners - 0.5)
    both = read_drawn_region(str(tmp_path / "RoiSet.zip")).polygons
    np.testing.assert_allclose(both[1].corners, whole - 0.5)
    assert both[1].label.endswith("RoiSet.zip, hole.roi")
    mask = read_region(tmp_path / "RoiSet.zip", (), SHAPE)
    assert mask_of(tmp_path / "plate.roi")[11, 23]
    assert not mask[11, 23]


def test_area_of_several_parts_is_read_with_its_hole(tmp_path):
    # How ImageJ keeps composite areas: 0 x y moves, 1 x y draws a line, 4 closes.
    outer = [0, 5, 5, 1, 45, 5, 1, 45, 35, 1, 5, 35, 4]
    inner = [0, 15, 15, 1, 25, 15, 1, 25, 25, 1, 15, 25, 4]
    roi = ImagejRoi(roitype=ROI_TYPE.RECT, left=5, top=5, right=45, bottom=35)
    roi.multi_coordinates = np.array(outer + inner, np.float32)
    roi.shape_roi_size = len(roi.multi_coordinates)
    roi.tofile(tmp_path / "composite.roi")
    expected = boxed(5, 5, 45, 35) & ~boxed(15, 15, 25, 25)
    np.testing.assert_array_equal(mask_of(tmp_path / "composite.roi"), expected)
    roi.multi_coordinates = np.array([0, 5, 5, 2, 45, 5, 45, 35, 4], np.float32)
    roi.shape_roi_size = len(roi.multi_coordinates)
    roi.tofile(tmp_path / "curved.roi")
    with pytest.raises(CorrelationError, match="curved edges"):
        mask_of(tmp_path / "curved.roi")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (roi_bytes(LINE, (0, 0, 9, 9)), "a selection of the kind line"),
        (roi_bytes(POINT, (5, 5, 5, 5), [(0, 0)]), "a selection of the kind point"),
        (roi_bytes(RECT, (0, 0, 9, 9), arc=4), "rounded corners"),
        (roi_bytes(POLYGON, (0, 0, 9, 9), [(0, 0), (9, 0), (9, 9)], options=SPLINE_FIT), "a spline"),
        (roi_bytes(POLYGON, (0, 0, 9, 9), [(0, 0), (9, 0)]), "at least 3 .* corners"),
        (roi_bytes(POLYGON, (0, 0, 9, 9), [(0, 0), (9, 0), (9, 9)])[:70], "a damaged file"),
        (b"Iout", "a damaged file"),
        (b"\x89PNG" + bytes(100), "a damaged file"),
        (b"", "a damaged file"),
        (roi_bytes(POLYGON, (0, 0, 9, 9), [(0, 0), (90, 0), (9, 9)]), "inside the image of 60 x 40 px"),
    ],
)
def test_what_is_no_area_is_refused_with_one_sentence(tmp_path, content, words):
    (path := tmp_path / "area.roi").write_bytes(content)
    with pytest.raises(CorrelationError, match=words) as refusal:
        mask_of(path)
    assert "area.roi" in str(refusal.value)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("members", "words"),
    [
        ({}, "at least one polygon, got none"),
        ({"notes.txt": b"hello"}, r"notes.txt: .* without the ending \.roi"),
        ({"a.roi": b"Iout"}, r"a\.roi: .* a damaged file"),
    ],
)
def test_archive_without_areas_is_refused(tmp_path, members, words):
    with zipfile.ZipFile(tmp_path / "set.zip", "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    with pytest.raises(CorrelationError, match=words):
        mask_of(tmp_path / "set.zip")


def test_damaged_archive_is_refused(tmp_path):
    area = roi_bytes(RECT, (5, 10, 15, 30))
    with zipfile.ZipFile(tmp_path / "set.zip", "w") as archive:
        archive.writestr("a.roi", area)
    content = bytearray((tmp_path / "set.zip").read_bytes())
    content[content.index(area) + 9] ^= 1
    for damaged in (bytes(content), bytes(content[:60]), b"PK"):
        (tmp_path / "set.zip").write_bytes(damaged)
        with pytest.raises(CorrelationError, match=r"a damaged \.zip file"):
            mask_of(tmp_path / "set.zip")
