"""Gauges are declared in a file without unknown keys; all mistakes in the file are reported together."""

import pytest

from dic import read_gauges
from dic.errors import GaugeError
from dic.gauges import Extensometer, LineCut, PointGauge, StrainGauge, TransverseExtensometer

GOOD = """
unit = "mm"

[[gauge]]
name = "axial"
kind = "extensometer"
start = [0, -12.5]
end = [0, 12.5]
patch = 2.0

[[gauge]]
name = "width"
kind = "transverse"
start = [-5, 0]
end = [5, 0]
patch = 1
spread = 20.0
lines = 64

[[gauge]]
name = "foil"
kind = "area"
centre = [0, 0]
size = [6.0, 3.0]
angle_deg = 30.0
direction_deg = 90

[[gauge]]
name = "patch"
kind = "area"
unit = "px"
corners = [[10, 10], [90, 10], [50, 90]]

[[gauge]]
name = "cut"
kind = "cut"
start = [-5, 0]
end = [5, 0]
places = 20
width = 1.5

[[gauge]]
name = "tip"
kind = "point"
at = [1, 2]
"""


def test_each_kind_is_read_as_it_is_declared(tmp_path):
    path = tmp_path / "gauges.toml"
    path.write_text(GOOD)
    assert read_gauges(path) == (
        Extensometer(name="axial", unit="mm", start=(0.0, -12.5), end=(0.0, 12.5), patch=2.0),
        TransverseExtensometer(
            name="width", unit="mm", start=(-5.0, 0.0), end=(5.0, 0.0), patch=1.0, spread=20.0, lines=64
        ),
        StrainGauge(
            name="foil", unit="mm", centre=(0.0, 0.0), size=(6.0, 3.0), angle_deg=30.0, direction_deg=90.0
        ),
        StrainGauge(name="patch", unit="px", corners=((10.0, 10.0), (90.0, 10.0), (50.0, 90.0))),
        LineCut(name="cut", unit="mm", start=(-5.0, 0.0), end=(5.0, 0.0), places=20, width=1.5),
        PointGauge(name="tip", unit="mm", at=(1.0, 2.0)),
    )


def test_text_of_an_option_declares_the_same_gauge():
    texts = [
        "axial=extensometer start=0,-12.5 end=0,12.5 patch=2 unit=mm",
        "patch=area corners=10,10;90,10;50,90",
        "width=transverse start=-5,0 end=5,0 patch=1 spread=20 lines=64 unit=mm",
    ]
    axial, patch, width = read_gauges(texts=texts)
    assert axial == Extensometer(name="axial", unit="mm", start=(0, -12.5), end=(0, 12.5), patch=2)
    assert patch == StrainGauge(name="patch", corners=((10, 10), (90, 10), (50, 90)))
    assert (width.lines, width.unit) == (64, "mm")


def test_all_mistakes_are_reported_together(tmp_path):
    path = tmp_path / "gauges.toml"
    path.write_text("""
speed = 3
[[gauge]]
name = "a"
kind = "extensometer"
start = [0, 0]
end = [0, 0]
patch = -1
[[gauge]]
name = "a"
kind = "transverse"
start = [0, 0]
end = [0, 9]
patch = 1
spread = 5
lines = 31
colour = "red"
[[gauge]]
name = "b"
kind = "ring"
[[gauge]]
name = "no blanks"
kind = "point"
""")
    with pytest.raises(GaugeError) as caught:
        read_gauges(path)
    message = str(caught.value)
    for words in (
        "got speed",
        "gauge 'a': end: expected another place than start",
        "patch: expected a number above 0, got -1",
        "gauge 2: keys of kind transverse: expected one of name, unit, start, end, patch, spread, lines, got",
        "gauge 3: kind: expected one of extensometer, transverse, area, cut, point, got 'ring'",
        "'a' twice",
        "gauge 4: keys of kind point: expected at, got none",
    ):
        assert words in message
    assert "\n" not in message


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("lines = 31", "lines: expected a whole number from 32 to 10000, got 31"),
        ("lines = 40.5", "lines: expected a whole number"),
        ("spread = 0", "spread: expected a number above 0"),
        ('start = "here"', "start: expected two finite numbers"),
        ("start = [nan, 1]", "start: expected two finite numbers"),
        ("end = [1, 2, 3]", "end: expected two finite numbers"),
        ('unit = "inch"', "unit: expected px or mm, got inch"),
        ("name = ''", "name: expected letters"),
        ("patch = true", "patch: expected a number above 0"),
    ],
)
def test_impossible_value_is_named_with_a_remedy(tmp_path, line, words):
    values = {
        "name": '"w"', "start": "[0, 0]", "end": "[0, 9]", "patch": "1", "spread": "5",
        **dict([line.split(" = ", 1)]),
    }  # fmt: skip
    path = tmp_path / "gauges.toml"
    text = "\n".join(f"{key} = {value}" for key, value in values.items())
    path.write_text(f'[[gauge]]\nkind = "transverse"\n{text}\n')
    with pytest.raises(GaugeError, match=words):
        read_gauges(path)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({}, "centre and size, or corners, got neither"),
        ({"centre": (1, 1)}, "centre and size, or corners, got centre"),
        (
            {"centre": (1, 1), "size": (1, 1), "corners": ((0, 0), (1, 0), (0, 1))},
            "three or more places, alone",
        ),
        ({"corners": ((0, 0), (1, 0))}, "three or more places"),
        ({"centre": (1, 1), "size": (0, 1)}, "a width and a height above 0"),
    ],
)
def test_area_is_a_rectangle_or_a_polygon(values, words):
    with pytest.raises(GaugeError, match=words):
        StrainGauge(name="a", **values)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", "a table [[gauge]] for each gauge, got none"),
        ("gauge = 3", "a table [[gauge]] for each gauge"),
        ("[[gauge]\n", "cannot be understood"),
        ("[gauge]\nname = 'a'", "a table [[gauge]] for each gauge"),
    ],
)
def test_file_without_gauges_is_refused(tmp_path, content, words):
    path = tmp_path / "gauges.toml"
    path.write_text(content)
    with pytest.raises(GaugeError) as caught:
        read_gauges(path)
    assert words in str(caught.value)


@pytest.mark.parametrize("text", ["", "axial", "a=extensometer start", "a=", "=point at=1,1"])
def test_text_that_is_no_gauge_is_refused(text):
    with pytest.raises(GaugeError):
        read_gauges(texts=[text])


def test_missing_file_and_no_gauge_at_all_are_refused(tmp_path):
    with pytest.raises(GaugeError, match="No such file"):
        read_gauges(tmp_path / "none.toml")
    with pytest.raises(GaugeError, match="at least one gauge, got none"):
        read_gauges()
