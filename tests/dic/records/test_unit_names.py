"""Units in headings are known however they are spelled; the sizes are those of NIST SP 811, appendix B."""

import math

import pytest

import dic
from dic.records.headings import units_of
from tests.command_line import refusal
from tests.dic.records.test_foreign_tables import ROWS, numbers_of, slope_gpa, table

KGF_N, LBF_N = 9.80665, 4.4482216152605
SPELLED = {
    "Load (KGF)": KGF_N,
    "Force [Kg]": KGF_N,
    "Force (lbs.)": LBF_N,
    "Load (klbf)": 1000 * LBF_N,
    "Load <gf>": 1e-3 * KGF_N,
    "Load (dyn)": 1e-5,
    "Нагрузка, кН": 1e3,
    "Standardkraft {kN}": 1e3,
    "Force ('kN')": 1e3,
    "Force (kilonewtons)": 1e3,
    "Load.kN": 1e3,
    "LoadkN": 1e3,
    "load_kn": 1e3,
    "load_n": 1.0,
    "Kraft in kN": 1e3,
    "Load x10 (N)": 10.0,
    "Load x1000 N": 1e3,
    "Load 10^3 N": 1e3,
    "Load lb": LBF_N,
    "Time/min": 60.0,
    "Extension in": 25.4,
    "Strain x10^-6 (-)": 1e-6,
    "Load (10^3 N)": 1e3,
    "Load (x1000 N)": 1e3,
    "Stress (kgf/mm2)": KGF_N,
    "Stress (bar)": 0.1,
    "Strain (microstrain)": 1e-6,
    "Strain (mε)": 1e-3,
    "Strain (-)": 1.0,
    "Strain.percent": 1e-2,
}


@pytest.mark.parametrize("heading", SPELLED)
def test_size_of_a_unit_however_it_is_spelled(heading):
    (unit,) = units_of([heading])
    assert unit is not None
    assert unit.size == pytest.approx(SPELLED[heading], rel=1e-6)


@pytest.mark.parametrize(
    "heading",
    ["Load min", "Channel V", "Probe A", "Strain", "t", "Load (10 kN)", "Loadcell 100kN", "Gauge 50 mm"],
)
def test_words_of_a_name_are_no_units(heading):
    assert units_of([heading, "Time"])[0] is None


def test_letter_in_brackets_may_be_the_symbol_of_a_quantity(tmp_path):
    path = table(tmp_path / "a.csv", numbers_of(ROWS), headings=[["Zeit (t)", "Kraft (N)", "Dehnung (A)"]])
    curve = dic.read_curve(path, load="2:N", strain="3:%", time="1:s")
    assert slope_gpa(curve) == pytest.approx(70.0, rel=1e-3)


def test_ton_may_be_three_units():
    (unit,) = units_of(["Load (ton)"])
    assert unit is not None
    assert math.isnan(unit.size)


@pytest.mark.parametrize("heading", ["Load (KN)", "load_kn", "Load [kilonewton]"])
def test_unit_of_the_same_size_is_taken_and_another_is_refused(tmp_path, heading):
    rows = [[f"{t:.1f}", f"{n / 1000:.6f}", f"{e:.6f}"] for t, n, e in ROWS]
    path = table(tmp_path / "a.csv", rows, headings=[["Time (s)", heading, "Strain (%)"]])
    assert slope_gpa(dic.read_curve(path, load="2:kN", strain="3:%")) == pytest.approx(70.0, rel=1e-3)
    said = refusal("properties", path, "--load", "2:N", "--strain", "3:%", "--area-mm2", 20)
    assert "give --load '2:kN'" in said


def test_value_that_no_material_has_is_refused(tmp_path):
    path = table(tmp_path / "a.csv", numbers_of(ROWS), headings=[["Time", "Load", "Strain"]])
    said = refusal("properties", path, "--load", "2:kN", "--strain", "3:%", "--area-mm2", 20)
    assert "expected a modulus of at most 1250 GPa, which diamond has, got 7e+04 GPa" in said
    said = refusal("properties", path, "--load", "2:N", "--strain", "3:ue", "--area-mm2", 20)
    assert "expected strains that change by more than 20 µε" in said


def test_load_that_stands_for_none_is_refused(tmp_path):
    rows = [[f"{t:.1f}", "99999" if k == 70 else f"{n:.2f}", f"{e:.6f}"] for k, (t, n, e) in enumerate(ROWS)]
    path = table(tmp_path / "a.csv", rows, headings=[["Time", "Load", "Strain"]])
    said = refusal("properties", path, "--load", "2:N", "--strain", "3:%", "--area-mm2", 20)
    assert "got 99999 N at point 71" in said


def test_true_strain_is_not_taken_for_engineering_strain(tmp_path):
    path = table(tmp_path / "a.csv", numbers_of(ROWS), headings=[["Time", "Load", "True Strain (%)"]])
    said = refusal("properties", path, "--load", "2:N", "--strain", "3:%", "--area-mm2", 20)
    assert "--strain: expected engineering stress or strain, got the heading 'True Strain (%)'" in said
