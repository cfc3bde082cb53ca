"""Tests of mean, scatter, outliers and planar anisotropy of several specimens with given properties."""

import csv
import math
from dataclasses import replace

import numpy as np
import pytest

import dic
from dic.campaigns.campaign import SpecimenTest, campaign_of
from dic.commands.campaign_text import campaign_lines
from dic.report.campaign_page import statistics_cells

NAMES = ("a", "b", "c", "d", "e")


@pytest.fixture(scope="module")
def one():
    """The properties from a short straight curve; the tests replace their values."""
    stress = np.concatenate([np.linspace(0, 400, 80), np.full(10, 400.0)])
    strain = np.concatenate([np.linspace(0, 0.002, 80), np.linspace(0.0021, 0.02, 10)])
    return dic.material_properties(
        dic.properties.Curve("one", 20 * stress, strain), dic.properties.PropertySettings(area_mm2=20.0)
    )


def with_values(one, **values):
    """Return the properties `one` with replaced values; each is given as value and standard deviation."""
    changed = dict(one.values)
    for name, (value, std) in values.items():
        changed[name] = replace(
            changed[name], value=value, std=std, flags=() if value is not None else ("gone",)
        )
    return replace(one, values=changed)


def test_mean_and_scatter_are_those_of_the_textbook(one):
    values = [(200.0, 1.0), (204.0, 2.0), (206.0, 2.0), (210.0, 4.0)]
    given = {n: with_values(one, E_gpa=pair) for n, pair in zip(NAMES, values, strict=False)}
    found = dic.campaigns.compare_specimens(given).groups[0].scatter["E_gpa"]
    assert found.mean == pytest.approx(205.0)
    # squares of the differences 5, 1, 1, 5 are 52 together
    assert found.std_between == pytest.approx(math.sqrt(52 / 3))
    assert found.standard_error == pytest.approx(math.sqrt(52 / 3) / 2)
    assert found.stated_std == pytest.approx(math.sqrt((1 + 4 + 4 + 16) / 4))
    assert (found.count, found.unit, found.outlying) == (4, "GPa", None)


def test_a_standard_deviation_that_would_be_rounded_to_zero_has_two_digits(one):
    values = [(400.0, 0.0123), (410.0, 0.0123)]
    given = {n: with_values(one, Rm_mpa=pair) for n, pair in zip(NAMES, values, strict=False)}
    cells = statistics_cells(dic.campaigns.compare_specimens(given).groups[0].scatter["Rm_mpa"])
    assert cells == ["405.0", "7.1", "5.0", "0.012"]


def test_a_large_standard_deviation_has_its_thousands_apart(one):
    given = {"a": with_values(one, Rm_mpa=(1e5, 2e4)), "b": with_values(one, Rm_mpa=(3e5, 2e4))}
    cells = statistics_cells(dic.campaigns.compare_specimens(given).groups[0].scatter["Rm_mpa"])
    # the differences from the mean are 100 000 each
    assert [cell.replace("\u202f", " ") for cell in cells] == [
        "200 000.0",
        "141 421.4",
        "100 000.0",
        "20 000.0",
    ]


def test_equal_specimens_do_not_scatter(one):
    # in floating point the mean of 0.1, 0.1, 0.1 is not exactly 0.1
    values = {name: with_values(one, Rm_mpa=(0.1, 1e-14)) for name in "abc"}
    found = dic.campaigns.compare_specimens(values).groups[0].scatter["Rm_mpa"]
    assert found.std_between > 0.0
    assert statistics_cells(found) == ["0.1", "0.0", "0.0", "1.0e-14"]


def test_a_specimen_without_a_value_is_left_out_of_the_mean(one):
    values = [(400.0, 1.0), (None, None), (410.0, 1.0)]
    given = {n: with_values(one, Rm_mpa=pair) for n, pair in zip(NAMES, values, strict=False)}
    found = dic.campaigns.compare_specimens(given).groups[0].scatter["Rm_mpa"]
    assert (found.names, found.mean) == (("a", "c"), 405.0)
    assert "too few" in found.outlier.reason


def test_a_single_specimen_has_no_scatter(one):
    found = (
        dic.campaigns.compare_specimens({"a": with_values(one, E_gpa=(200.0, None))})
        .groups[0]
        .scatter["E_gpa"]
    )
    assert (found.mean, found.std_between, found.standard_error, found.stated_std) == (
        200.0,
        None,
        None,
        None,
    )


def test_an_outlier_is_marked_and_stays_in_the_mean(one, tmp_path):
    values = (199.31, 199.53, 200.19, 200.82, 201.92, 201.95, 202.18, 245.57)
    given = {f"s{k}": with_values(one, E_gpa=(value, 0.5)) for k, value in enumerate(values)}
    campaign = dic.campaigns.compare_specimens(given)
    found = campaign.groups[0].scatter["E_gpa"]
    assert (found.outlying, found.count) == ("s7", 8)
    assert found.mean == pytest.approx(sum(values) / 8)
    dic.campaigns.write_campaign_table(campaign, tmp_path / "t.csv")
    rows = list(csv.DictReader((tmp_path / "t.csv").read_text("utf-8-sig").splitlines()))
    assert [row["specimen"] for row in rows if row["outlier_of"] == "E_gpa"] == ["s7"]
    means = {row["line"]: row["E_gpa"] for row in rows if row["line"] != "specimen"}
    assert float(means["mean"]) == pytest.approx(sum(values) / 8, abs=1e-5)
    dic.report.write_campaign_report(campaign, tmp_path / "r.html")
    assert "245.57<b>†</b><br><small>± 0.50</small>" in (tmp_path / "r.html").read_text()


def test_different_kinds_of_strain_are_stated_and_warned_of(one, tmp_path):
    def tests(*kinds):
        pairs = zip("ab", kinds, strict=True)
        return [SpecimenTest(name, "", None, one, strain_kind=kind, left_out=2) for name, kind in pairs]

    assert campaign_of(tests("raw", "raw")).warnings == []
    assert campaign_of(tests("", "")).warnings == []
    mixed = campaign_of(tests("corrected", "calibrated"))
    (warning,) = mixed.as_dict()["warnings"]
    assert "different kinds of strain (corrected: a; calibrated: b)" in warning
    lines = list(campaign_lines(mixed))
    assert {"strain: corrected, a", "strain: calibrated, b", f"warning: {warning}"} <= set(lines)
    assert "images without a reading: 2 of a, 2 of b" in lines
    told = [(each["strain_kind"], each["left_out"]) for each in mixed.as_dict()["specimens"]]
    assert told == [("corrected", 2), ("calibrated", 2)]
    dic.campaigns.write_campaign_table(mixed, tmp_path / "t.csv")
    rows = list(csv.DictReader((tmp_path / "t.csv").read_text("utf-8-sig").splitlines()))
    assert [row["strain_kind"] for row in rows if row["line"] == "specimen"] == ["corrected", "calibrated"]
    dic.report.write_campaign_report(mixed, tmp_path / "r.html")
    page = (tmp_path / "r.html").read_text()
    assert warning in page
    assert "<td>calibrated, without 2 images</td>" in page


def test_planar_anisotropy_is_that_of_the_mean_ratio_of_each_direction(one):
    ratios = {"a": (1.6, 0.02), "b": (2.0, 0.02), "c": (1.2, 0.02), "d": (2.2, 0.02)}
    directions = {"a": 0, "b": 0, "c": 45, "d": 90}
    given = {name: with_values(one, r=pair) for name, pair in ratios.items()}
    campaign = dic.campaigns.compare_specimens(given, directions)
    # r0 is 1.8 with the standard error 0.4 / √2 / √2 = 0.2; r45 and r90 have the stated 0.02
    found = campaign.anisotropy
    assert found["r_mean"].value == pytest.approx((1.8 + 2 * 1.2 + 2.2) / 4)
    assert found["r_mean"].std == pytest.approx(math.hypot(0.2 / 4, 0.02 / 2, 0.02 / 4))
    assert found["delta_r"].value == pytest.approx((1.8 + 2.2) / 2 - 1.2)
    assert found["delta_r"].std == pytest.approx(math.hypot(0.2 / 2, 0.02, 0.02 / 2))
    assert [group.direction_deg for group in campaign.groups] == [None, 0]
    assert campaign.groups[1].scatter["r"].mean == pytest.approx(1.8)


def test_without_a_direction_of_the_three_there_is_a_reason(one):
    given = {name: with_values(one, r=(1.5, 0.1)) for name in "ab"}
    found = dic.campaigns.compare_specimens(given, {"a": 0, "b": 90}).anisotropy
    assert found["r_mean"].value is None
    assert "no strain ratio at 45°" in found["r_mean"].flags[0]
    assert dic.campaigns.compare_specimens(given).anisotropy == {}


@pytest.mark.parametrize(
    ("directions", "words"),
    [({"a": 0}, "a direction of each specimen, or none"), ({"a": 0, "b": 180}, "below 180°, got 180")],
)
def test_impossible_directions_are_refused(one, directions, words):
    with pytest.raises(dic.errors.CurveError, match=words):
        dic.campaigns.compare_specimens({"a": one, "b": one}, directions)


def test_no_specimen_is_refused():
    with pytest.raises(dic.errors.CurveError, match="at least one specimen, got none"):
        dic.campaigns.compare_specimens({})
