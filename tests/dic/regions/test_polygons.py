"""Tests of regions that are given as polygons."""

import numpy as np
import pytest

from dic.errors import CorrelationError
from dic.regions.polygons import polygon_mask
from dic.regions.read import read_drawn_region

TRIANGLE = [[2.5, 1.0], [9.5, 1.0], [2.5, 8.0]]
SQUARE = [[0, 0], [4, 0], [4, 4], [0, 4]]


def test_the_same_polygon_from_the_command_line_and_from_every_kind_of_file(tmp_path):
    (tmp_path / "a.toml").write_text(f"polygon = {TRIANGLE}")
    (tmp_path / "b.json").write_text(f'{{"polygons": [{TRIANGLE}]}}')
    (tmp_path / "c.csv").write_text("x_px,y_px\n" + "\n".join(f"{x},{y}" for x, y in TRIANGLE))
    sources = ["2.5,1 9.5,1 2.5,8", "2.5 , 1  9.5 , 1  2.5 , 8"]
    sources += [str(tmp_path / name) for name in ("a.toml", "b.json", "c.csv")]
    for source in sources:
        (polygon,) = read_drawn_region(source).polygons
        np.testing.assert_array_equal(polygon.corners, TRIANGLE)


def test_a_table_may_hold_several_polygons(tmp_path):
    rows = [f"{x},{y},outer" for x, y in SQUARE] + [f"{x},{y},inner" for x, y in TRIANGLE]
    (tmp_path / "p.csv").write_text("\n".join(["x_px,y_px,polygon", *rows]))
    polygons = read_drawn_region(str(tmp_path / "p.csv")).polygons
    assert [len(polygon.corners) for polygon in polygons] == [4, 3]


def test_a_triangle_covers_the_pixels_whose_centres_lie_inside():
    mask = polygon_mask([np.array(TRIANGLE)], (12, 12))
    y, x = np.mgrid[:12, :12]
    strictly_inside = (x > 2.5) & (y > 1) & (x + y < 10.5)
    on_the_edge = (y == 1) & (x > 2.5) & (x < 9.5)
    np.testing.assert_array_equal(mask & ~on_the_edge, strictly_inside)


def test_a_polygon_inside_another_is_a_hole():
    outer = np.array(SQUARE) * 5.0 - 0.5
    inner = np.array(SQUARE) * 2.0 + 4.5
    mask = polygon_mask([outer, inner], (30, 30))
    assert mask.sum() == 20 * 20 - 8 * 8
    assert not mask[5:13, 5:13].any()


def test_a_disc_of_many_corners_has_the_area_of_the_circle():
    angle = np.linspace(0, 2 * np.pi, 720, endpoint=False)
    disc = np.stack([50 + 40 * np.cos(angle), 50 + 40 * np.sin(angle)], axis=1)
    assert polygon_mask([disc], (100, 100)).sum() == pytest.approx(np.pi * 40**2, rel=5e-3)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("missing.toml", None),
        ("two.json", '{"polygon": [[1, 2], [3, 4]]}'),
        ("key.toml", "corners = [[1, 2], [3, 4], [5, 6]]"),
        ("list.json", "[1, 2, 3]"),
        ("bad.toml", "polygon = [[1, 2], [3"),
        ("ragged.json", '{"polygon": [[1, 2], [3], [5, 6]]}'),
        ("words.csv", "x_px,y_px\na,b\nc,d\ne,f\n"),
        ("columns.csv", "x,z\n1,2\n3,4\n5,6\n"),
        ("empty.csv", "x_px,y_px\n"),
        ("infinite.json", '{"polygon": [[1, 2], [3, Infinity], [5, 6]]}'),
        ("latin.csv", b"x,y\n1,1\n\xe9,1\n"),
        ("latin.json", b"\xff"),
        ("null.json", '{"polygons": null}'),
    ],
)
def test_what_is_no_polygon_is_refused_with_one_sentence(tmp_path, name, content):
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(CorrelationError, match="polygon") as refusal:
        read_drawn_region(str(path))
    assert name in str(refusal.value)
    assert "\n" not in str(refusal.value)
