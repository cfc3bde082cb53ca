"""The description of a campaign: a strict TOML file."""

import math
from pathlib import Path

import pytest

import dic

GOOD = """
[defaults]
load = "Load:kN"
strain = "Strain:%"
width_mm = 20.0
thickness_mm = 6.0
width_std_mm = 0.02
thickness_std_mm = 0.01
load_std_percent = 0.3

[[specimen]]
name = "first"
file = "a.csv"

[[specimen]]
file = "b.csv"
area_mm2 = 119.0
offsets_percent = [0.1]
strain = "3:mm"
gauge_length_mm = 50
"""


def read(folder: Path, text: str):
    (folder / "campaign.toml").write_text(text)
    return dic.campaigns.read_campaign(folder)


def test_defaults_hold_unless_a_specimen_says_otherwise(tmp_path):
    first, second = read(tmp_path, GOOD)
    assert (first.name, first.file, first.settings.area_mm2) == ("first", tmp_path / "a.csv", 120.0)
    # the errors of both sides are independent: 6 · 0.02 and 20 · 0.01 mm²
    assert first.settings.area_std_mm2 == pytest.approx(math.hypot(0.12, 0.2))
    assert first.source == dic.campaigns.CurveColumns("Load:kN", "Strain:%")
    assert (second.name, second.settings.area_mm2, second.settings.area_std_mm2) == ("b", 119.0, None)
    assert second.settings.load_std_percent == 0.3
    assert second.settings.offsets_percent == (0.2, 0.1)
    assert second.source == dic.campaigns.CurveColumns("Load:kN", "3:mm", gauge_length_mm=50)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("load_std", "lod_std", ["[defaults]: keys: expected one of", "'lod_std_percent'"]),
        ('file = "a.csv"', 'file = "a.csv"\ngauge = "x"', ["'first': keys of a table", "'gauge'"]),
        ("119.0", '"big"', ["'b.csv': area_mm2: expected a number, got 'big'"]),
        ("119.0", "nan", ["area_mm2: expected a number, got nan"]),
        ("119.0", "0.0", ["'b.csv': area: expected above 0 mm², got 0.0"]),
        ("119.0", "119.0\nwidth_mm = 1.0", ["area_mm2, or the sides, got area_mm2 and width_mm"]),
        ("[0.1]", "0.1", ["offsets_percent: expected a list of numbers, got 0.1"]),
        ("[0.1]", "[0.1]\nwindow_mpa = [1, 2, 3]", ["window: expected a lower and a higher stress"]),
        ('"b.csv"', '"a.csv"', ["a file of its own for each specimen", "twice"]),
        ('file = "b.csv"', 'name = "first"\nfile = "b.csv"', ["a name of its own for each specimen"]),
        ('file = "b.csv"', 'file = "b.csv"\ndirection_deg = 45', ["a direction of each specimen, or none"]),
        ('file = "b.csv"', 'file = "b.csv"\ndirection_deg = 200', ["at least 0° and below 180°, got 200"]),
        ('file = "b.csv"', 'name = "x"', ["'x': file: expected the name of a file, got none"]),
        ('load = "Load:kN"', "", ["load: expected a column and its unit, got none"]),
        ("thickness_mm = 6.0", "", ["area_mm2, or width_mm and thickness_mm"]),
        ("thickness_std_mm = 0.01", "", ["width_std_mm and thickness_std_mm, got one of them"]),
        ("[defaults]", "gain = 3\n[defaults]", ["top of the file", "'gain'"]),
        (
            "[defaults]",
            '[defaults]\nrecord = "m.csv"',
            ["keys that the file of a specimen can use, got record"],
        ),
        (GOOD, "", ["a table [[specimen]] for each specimen"]),
        (GOOD, "specimen = 3", ["a table [[specimen]] for each specimen"]),
        (GOOD, "a = [", ["one that cannot be understood"]),
    ],
)
def test_what_is_wrong_with_the_file_is_said_in_one_sentence(tmp_path, old, new, words):
    assert old in GOOD
    with pytest.raises(dic.errors.CurveError) as caught:
        read(tmp_path, GOOD.replace(old, new, 1))
    assert [word for word in words if word not in str(caught.value)] == []
    assert "\n" not in str(caught.value)


def test_all_unknown_keys_are_told_together(tmp_path):
    text = GOOD.replace("load_std", "lod_std").replace("area_mm2", "aera_mm2").replace("[[", "x = 1\n[[", 1)
    with pytest.raises(dic.errors.CurveError) as caught:
        read(tmp_path, text)
    for key in ("'lod_std_percent'", "'aera_mm2'", "'x'"):
        assert key in str(caught.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(
        dic.errors.CurveError, match=r"campaign\.toml: read the campaign: expected a TOML file"
    ):
        dic.campaigns.read_campaign(tmp_path)


def test_tables_of_a_folder_are_taken_in_natural_order(tmp_path):
    for name in ("s10.csv", "s2.csv", "s2.txt"):
        (tmp_path / name).write_text("")
    columns, settings = (
        dic.campaigns.CurveColumns("1:kN", "2:%"),
        dic.properties.PropertySettings(area_mm2=20.0),
    )
    listed = dic.campaigns.list_specimens(tmp_path, columns, settings)
    assert [specimen.name for specimen in listed] == ["s2", "s10"]
    left = dic.campaigns.list_specimens(tmp_path, columns, settings, leave_out=[tmp_path / "s10.csv"])
    assert [specimen.name for specimen in left] == ["s2"]
    with pytest.raises(dic.errors.CurveError, match=r"a folder with files \*\.dat, got none"):
        dic.campaigns.list_specimens(tmp_path, columns, settings, pattern="*.dat")
