"""Tables as testing machines and spreadsheets write them are read rightly, or refused with the reason.

The material is elastic with 70 GPa, on an area of 20 mm².
"""

import json

import pytest

import dic
from tests.command_line import refusal, run_dic

STRAINS = [2e-5 * k for k in range(200)]
ROWS = [(0.1 * k, 70_000.0 * 20.0 * strain, 100.0 * strain) for k, strain in enumerate(STRAINS)]
NAMES = ["Time", "Load", "Strain"]
UNITS = ["s", "N", "%"]


def number(value: float, decimals: int, point: str = ".", between: str = "") -> str:
    return f"{value:,.{decimals}f}".replace(",", "T").replace(".", point).replace("T", between)


def table(path, rows, separator=";", headings=(NAMES, UNITS)):
    lines = [separator.join(line) for line in (*headings, *rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def slope_gpa(curve: dic.properties.Curve) -> float:
    return float((curve.load_n[-1] - curve.load_n[0]) / 20.0 / (curve.strain[-1] - curve.strain[0]) / 1000.0)


@pytest.mark.parametrize(
    ("decimals", "point", "between"),
    [(0, ".", ","), (0, ",", "."), (2, ",", "."), (1, ".", "'"), (0, ".", " "), (1, ",", "\u202f")],
)
def test_marks_between_thousands_are_known_by_the_marks_of_the_other_numbers(
    tmp_path, decimals, point, between
):
    rows = [
        (number(t, 2, point), number(n, decimals, point, between), number(e, 6, point))
        for t, n, e in ROWS
        if n >= 1000.0
    ]
    curve = dic.read_curve(table(tmp_path / "a.csv", rows), load="Load:N", strain="Strain:%")
    assert slope_gpa(curve) == pytest.approx(70.0, rel=1e-3)


def test_quoted_numbers_with_commas_between_thousands_are_read(tmp_path):
    rows = [[f'"{number(value, 4, between=",")}"' for value in row] for row in ROWS]
    curve = dic.read_curve(table(tmp_path / "a.csv", rows, ","), load="Load:N", strain="Strain:%")
    assert slope_gpa(curve) == pytest.approx(70.0, rel=1e-6)


@pytest.mark.parametrize(
    ("headings", "unit"),
    [
        ([["Time", "Force (daN)", "Strain"]], "daN"),
        ([["Time", "Force [kp]", "Strain"]], "kp"),
        ([["Time", "Force KN", "Strain"]], "KN"),
        ([["Time", "Force/kN", "Strain"]], "kN"),
        ([NAMES, ["s", "lbs", "%"]], "lbs"),
        ([NAMES, ["s", "t", "-"]], "t"),
        ([NAMES, ["Sec", "psi", "mm/mm"]], "psi"),
    ],
)
def test_unit_that_contradicts_the_heading_is_refused(tmp_path, headings, unit):
    rows = [[f"{value:.5f}" for value in row] for row in ROWS]
    said = refusal("properties", table(tmp_path / "a.csv", rows, headings=headings), "--load", "2:N",
                   "--strain", "3:%", "--area-mm2", 20)  # fmt: skip
    assert f"the unit {unit} of the file's heading, got N" in said


@pytest.mark.parametrize("name", ["t", "V", "N", "Load min", "bar"])
def test_short_name_of_a_column_is_no_unit(tmp_path, name):
    rows = [[f"{value:.5f}" for value in row] for row in ROWS]
    path = table(tmp_path / "a.csv", rows, headings=[["A", name, "eps"]])
    assert slope_gpa(dic.read_curve(path, load=f"{name}:N", strain="eps:%")) == pytest.approx(70.0, rel=1e-3)


@pytest.mark.parametrize("headings", [[["Load", "Strain"]], [["Kraft", "Dehnung"], ["N", "%"]], []])
def test_commas_between_columns_and_before_decimals_are_refused(tmp_path, headings):
    rows = [[number(n, 2, ","), number(e, 5, ",")] for _, n, e in ROWS]
    path = table(tmp_path / "a.csv", rows, ",", headings)
    for load, strain in (("1:N", "3:%"), ("Load:N", "Strain:%")):
        said = refusal("properties", path, "--load", load, "--strain", strain, "--area-mm2", 20)
        assert "commas between the columns or before the decimals, got both" in said


def test_fewer_headings_than_columns_are_refused(tmp_path):
    rows = [[f"{value:.5f}" for value in row] for row in ROWS]
    path = table(tmp_path / "a.csv", rows, ",", [["Load", "Strain"]])
    said = refusal("properties", path, "--load", "Load:N", "--strain", "Strain:%", "--area-mm2", 20)
    assert "expected one heading for each column, got 2 headings above 3 columns" in said


def test_blocks_with_repeated_headings_are_read_one_after_the_other(tmp_path):
    rows = [[f"{value:.5f}" for value in row] for row in ROWS]
    again = [["Data Acquisition", "Time:", "30", "Sec", "x"], NAMES, ["Sec", "N", "%"]]
    path = table(tmp_path / "a.txt", [*rows[:100], *again, *rows[100:]], "\t", again)
    curve = dic.read_curve(path, load="Load:N", strain="Strain:%", time="1:s")
    assert len(curve.load_n) == 200
    other = [["Data Acquisition"], ["Time", "Strain", "Load"]]
    path = table(tmp_path / "b.txt", [*rows[:100], *other, *rows[100:]], "\t", again)
    said = refusal("properties", path, "--load", "Load:N", "--strain", "Strain:%", "--area-mm2", 20)
    assert "line 105: expected blocks with the same headings, got another block" in said


def test_shorter_test_beside_a_longer_one_is_read_to_its_end(tmp_path):
    rows = [[f"{value:.5f}" for value in row] for row in ROWS]
    both = [
        [*long, *(short if k < 150 else ["", "", ""])]
        for k, (long, short) in enumerate(zip(rows, rows, strict=True))
    ]
    path = table(tmp_path / "a.csv", both, ",", [NAMES * 2, UNITS * 2])
    assert len(dic.read_curve(path, load="5:N", strain="6:%", time="4:s").load_n) == 150


@pytest.mark.parametrize(
    ("heading", "load"), [("Time (s) Load (N) Strain (%)", "Load:N"), ("Time (s) Load in N Strain", None)]
)
def test_headings_of_several_words_between_spaces(tmp_path, heading, load):
    rows = [[f"{value:.5f}" for value in row] for row in ROWS]
    path = table(tmp_path / "a.txt", rows, " ", [[heading]])
    assert slope_gpa(dic.read_curve(path, load="2:N", strain="3:%")) == pytest.approx(70.0, rel=1e-3)
    if load is not None:
        assert slope_gpa(dic.read_curve(path, load=load, strain="Strain:%")) == pytest.approx(70.0, rel=1e-3)
    else:
        said = refusal("properties", path, "--load", "Load:N", "--strain", "3:%", "--area-mm2", 20)
        assert "6 words above 3 columns; give the number of the column, from 1 to 3" in said


@pytest.mark.parametrize(("unit", "size"), [("MPa", 1.0), ("N/mm²", 1.0), ("ksi", 6.894757293168)])
def test_table_of_stress_needs_no_area_and_gives_the_same_modulus(tmp_path, unit, size):
    rows = [[f"{n / 20.0 / size:.6f}", f"{e:.6f}"] for _, n, e in ROWS]
    path = table(tmp_path / "a.csv", rows, headings=[[f"Stress ({unit})", "Strain (%)"]])
    words = ("properties", path, "--strain", "Strain:%")
    done = run_dic(*words, "--stress", f"Stress:{unit}", "--json", tmp_path / "a.json")
    assert done.status == 0
    found = json.loads((tmp_path / "a.json").read_text())
    assert found["E_gpa"]["value"] == pytest.approx(70.0, rel=1e-4)
    assert found["area_mm2"] is None
    for named in (f"Stress:{unit}", "Stress:N"):
        said = refusal(*words, "--load", named, "--area-mm2", 20)
        assert f"--stress 'Stress:{unit}'" in said
    assert "a column of load or of stress, and its unit, got both" in refusal(
        *words, "--load", "1:N", "--stress", f"1:{unit}", "--area-mm2", 20
    )


def numbers_of(rows, decimals=5):
    return [[f"{value:.{decimals}f}" for value in row] for row in rows]


def test_results_above_the_table_and_headers_of_programs_are_no_part_of_it(tmp_path):
    rows = numbers_of(ROWS)
    results = [["Specimen", "Maximum Load", "Modulus"], ["", "(kN)", "(GPa)"], ["1", "5.573", "70.0"]]
    header = [
        ["LabVIEW Measurement", "Writer", "lab"],
        ["Channels", "2", ""],
        ["Samples", "200", "200"],
        ["Delta_X", "0.1", "0.1"],
        ["***End***"],
    ]
    for k, above in enumerate((results, header)):
        path = table(tmp_path / f"{k}.csv", rows, "\t", [*above, NAMES, UNITS])
        for load, strain in (("Load:N", "Strain:%"), ("2:N", "3:%")):
            curve = dic.read_curve(path, load=load, strain=strain)
            assert len(curve.load_n) == len(ROWS)
            assert slope_gpa(curve) == pytest.approx(70.0, rel=1e-3)


@pytest.mark.parametrize("event", [["Stop", "Pause", "unload"], ["0.45", "NaN", "NaN"]])
@pytest.mark.parametrize("headings", [[NAMES, UNITS], []])
def test_line_of_text_within_a_test_drops_no_line_of_it(tmp_path, event, headings):
    rows = numbers_of(ROWS)
    path = table(tmp_path / "a.csv", [*rows[:8], event, *rows[8:]], headings=headings)
    said = refusal("properties", path, "--load", "2:N", "--strain", "3:%", "--area-mm2", 20)
    assert f"in line {len(headings) + 9}" in said


def test_short_first_block_under_the_same_headings_is_read(tmp_path):
    rows = numbers_of(ROWS)
    path = table(tmp_path / "a.csv", [*rows[:5], NAMES, UNITS, *rows[5:]])
    assert len(dic.read_curve(path, load="Load:N", strain="Strain:%").load_n) == len(ROWS)


def test_column_that_ends_early_between_spaces_takes_no_other_column(tmp_path):
    rows = [[*row, "9.9"] if k < 150 else [*row[:2], "9.9"] for k, row in enumerate(numbers_of(ROWS))]
    path = table(tmp_path / "a.txt", rows, " ", [[*NAMES, "Disp"]])
    said = refusal("properties", path, "--load", "Load:N", "--strain", "Strain:%", "--area-mm2", 20)
    assert "line 152: expected 4 cells as in the other lines, got 3" in said


def test_numbers_with_three_decimals_and_an_exponent_are_no_thousands(tmp_path):
    rows = [[f"{value:.3E}" for value in row] for row in ROWS[1:]]
    path = table(tmp_path / "a.csv", rows)
    curve = dic.read_curve(path, load="Load:N", strain="Strain:%")
    assert curve.load_n[-1] == pytest.approx(ROWS[-1][1], rel=1e-3)


def test_block_with_other_units_is_refused(tmp_path):
    rows = numbers_of(ROWS)
    path = table(tmp_path / "a.csv", [*rows[:100], NAMES, ["s", "kN", "%"], *rows[100:]], "\t")
    said = refusal("properties", path, "--load", "Load:N", "--strain", "Strain:%", "--area-mm2", 20)
    assert "line 104: expected blocks with the same headings, got another block, 's kN %'" in said


def test_longer_test_beside_a_shorter_one_is_read_without_separators_behind_it(tmp_path):
    rows = numbers_of(ROWS)
    both = [
        [*long, *(short if k < 150 else [])] for k, (long, short) in enumerate(zip(rows, rows, strict=True))
    ]
    path = table(tmp_path / "a.csv", both, ",", [NAMES * 2, UNITS * 2])
    assert len(dic.read_curve(path, load="2:N", strain="3:%", time="1:s").load_n) == 200
    assert len(dic.read_curve(path, load="5:N", strain="6:%", time="4:s").load_n) == 150


def test_indian_groups_and_signs_of_typesetters_are_numbers(tmp_path):
    def grouped(value: float) -> str:
        text = f"{value:.0f}"
        return text if len(text) < 6 else f"{text[:-5]},{text[-5:-3]},{text[-3:]}"

    rows = [
        [f"{t:.1f}", grouped(1000.0 * n), f"{100 * e - 1:.5f}".replace("-", "\u2212")]
        for t, n, e in ((t, n, e / 100) for t, n, e in ROWS)
        if n > 100.0
    ]
    path = table(tmp_path / "a.csv", rows, headings=[NAMES, ["s", "mN", "%"]])
    assert slope_gpa(dic.read_curve(path, load="Load:mN", strain="Strain:%")) == pytest.approx(70.0, rel=1e-3)


def test_numbers_with_one_comma_and_none_below_one_are_refused(tmp_path):
    rows = [[f"{10 * t:.0f}", f"{n:,.0f}", f"{1e4 * e:.0f}"] for t, n, e in ROWS if n >= 1000.0]
    path = table(tmp_path / "a.csv", rows, headings=[NAMES, ["s", "N", "µε"]])
    said = refusal("properties", path, "--load", "Load:N", "--strain", "Strain:µε", "--area-mm2", 20)
    assert "no number below 1, which may be 1008" in said
