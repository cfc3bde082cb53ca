"""Records of testing machines are read, or refused with one sentence."""

import numpy as np
import pytest

import dic

LOAD = np.arange(1, 31) * 0.4
STRAIN = np.arange(1, 31) * 0.0125
NAMES = {"load": "Load:kN", "strain": "Strain:%"}


def table(separator=";", comma=True, head="Time{0}Load{0}Strain\n(s){0}(kN){0}(%)\n", **changed):
    """Return a record of a machine as text; `changed` replaces cells by row and column, such as r3c1."""
    lines = []
    for k, (load, strain) in enumerate(zip(LOAD, STRAIN, strict=True)):
        cells = [f"{0.1 * k:.1f}", f"{load:.5f}", f"{strain:.6f}"]
        cells = [changed.get(f"r{k}c{at}", cell) for at, cell in enumerate(cells)]
        line = separator.join(cells)
        lines.append(line.replace(".", ",") if comma else line)
    return head.format(separator) + "\n".join(lines) + "\n"


def read(folder, text, encoding="utf-8", **names):
    path = folder / "curve.csv"
    path.write_bytes(text.encode(encoding))
    return dic.read_curve(path, **(NAMES | names))


@pytest.mark.parametrize(
    ("separator", "comma"),
    [
        (";", True),
        (";", False),
        ("\t", True),
        ("\t", False),
        (",", False),
        ("|", True),
        ("  ", True),
        (" ", False),
    ],
)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_any_separator_and_decimal_mark_is_read(tmp_path, separator, comma, encoding):
    curve = read(tmp_path, table(separator, comma), encoding)
    np.testing.assert_allclose(curve.load_n, 1000 * LOAD)
    np.testing.assert_allclose(curve.strain, STRAIN / 100)
    np.testing.assert_allclose(curve.time_s, 0.1 * np.arange(30))


def test_lines_of_text_above_the_headings_are_passed_over(tmp_path):
    head = "Institute of Testing, Prüfstelle 7\nArea{0}120,4\n\nTime{0}Load [kN]{0}Strain (%)\n"
    curve = read(tmp_path, table(head=head), "cp1252")
    np.testing.assert_allclose(curve.load_n, 1000 * LOAD)


def test_quoted_cells_are_read(tmp_path):
    lines = [
        "Load,Strain",
        *(f'"{a:.4f}","{b:.4f}"'.replace(".", ",") for a, b in zip(LOAD, STRAIN, strict=True)),
    ]
    curve = read(tmp_path, "\n".join(lines))
    np.testing.assert_allclose(curve.load_n, 1000 * LOAD)


def test_a_column_may_be_named_by_its_number(tmp_path):
    curve = read(tmp_path, table(head=""), load="2:kN", strain="3:%")
    np.testing.assert_allclose(curve.strain, STRAIN / 100)


@pytest.mark.parametrize(
    ("unit", "factor"), [("N", 1.0), ("MN", 1e6), ("lbf", 4.4482216), ("kgf", 9.80665), ("kip", 4448.2216)]
)
def test_units_of_load(tmp_path, unit, factor):
    curve = read(tmp_path, table(head="Time{0}Load{0}Strain\n"), load=f"Load:{unit}")
    np.testing.assert_allclose(curve.load_n, factor * LOAD, rtol=1e-7)


@pytest.mark.parametrize(
    ("unit", "factor"),
    [("1", 1.0), ("mm/mm", 1.0), ("%", 0.01), ("‰", 0.001), ("µε", 1e-6), ("\u03bcε", 1e-6)],
)
def test_units_of_strain(tmp_path, unit, factor):
    curve = read(tmp_path, table(head="Time{0}Load{0}Strain\n"), strain=f"Strain:{unit}")
    np.testing.assert_allclose(curve.strain, factor * STRAIN)


def test_extension_over_the_gauge_length_is_strain(tmp_path):
    curve = read(tmp_path, table(head="Time{0}Load{0}Strain\n"), strain="Strain:mm", gauge_length_mm=50.0)
    np.testing.assert_allclose(curve.strain, STRAIN / 50)


def test_strain_may_end_before_the_load(tmp_path):
    curve = read(tmp_path, table(**{f"r{k}c2": "" for k in range(20, 30)}))
    assert curve.measured == 20
    assert np.isnan(curve.strain[20:]).all()


@pytest.mark.parametrize(
    ("text", "names", "words"),
    [
        (table(), {"load": "Load"}, "a column and its unit, COLUMN:UNIT"),
        (table(), {"load": "Load:"}, "a column and its unit, COLUMN:UNIT"),
        (table(), {"load": "Load:kg"}, "one of the units N, kN"),
        (table(), {"strain": "Strain:mm"}, "the gauge length with --gauge-length-mm"),
        (table(), {"load": "Load:N"}, "the unit kN of the file's heading, got N"),
        (table(), {"load": "Force:kN"}, "one of the columns 'Time', 'Load', 'Strain', got 'Force'"),
        (
            table(),
            {"strain": "Strain:mm", "gauge_length_mm": 0.0},
            "gauge length: expected above 0 mm, got 0",
        ),
        (
            table(**{f"r{k}c2": "" for k in range(30)}),
            {},
            "column 'Strain': expected numbers, got an empty column",
        ),
        (table(r4c1="off"), {}, "column 'Load': expected numbers, got 'off' in line 7"),
        (table(r0c1="off"), {}, "column 'Load': expected numbers, got 'off' in line 3"),
        (table(r0c1="off", r0c2="x"), {}, "first lines: expected numbers below the headings, got 'off x'"),
        (table(r4c1="1.234,5"), {}, "column 'Load': expected numbers, got '1,234,5' in line 7"),
        (table(r4c1="", comma=False), {}, "load: expected a number at each point, got an empty cell"),
        (table(r4c2=""), {}, "strain: expected numbers without gaps"),
        (table(r9c0="0.2"), {}, "time that does not run backwards, got 0.2 s after 0.8 s at point 10"),
        (table(head="Time{0}Load{0}Load\n"), {}, "one column of this name, got 2 columns of this name"),
        (table(r5c1="1;5"), {}, "line 8: expected 3 cells as in the other lines, got 4"),
        ("only text\nand more text\n", {}, "lines of numbers, separated by"),
        ("", {}, "lines of numbers, separated by"),
        ("\n".join(f"{k}" for k in range(30)), {}, "lines of numbers, separated by"),
        (table()[:150], {}, "at least 10 points, got"),
    ],
)
def test_what_is_wrong_with_a_table_is_said_in_one_sentence(tmp_path, text, names, words):
    with pytest.raises(dic.errors.CurveError) as caught:
        read(tmp_path, text, **names)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_two_decimal_marks_in_one_column_are_refused(tmp_path):
    text = table(comma=False, r4c1="2,0")
    with pytest.raises(dic.errors.CurveError, match="a decimal point or a decimal comma, got both"):
        read(tmp_path, text)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(dic.errors.CurveError, match=r"none\.csv: read the record: expected a text file"):
        dic.read_curve(tmp_path / "none.csv", **NAMES)


@pytest.mark.parametrize(
    ("load", "strain", "words"),
    [
        (-LOAD, STRAIN, "compression: loads from -12 N to -0.4 N"),
        (LOAD - 9, STRAIN, "compression"),
        (LOAD, -STRAIN, "strain that grows with the load"),
        (LOAD, 0 * STRAIN, "strain that changes"),
        (LOAD[:5], STRAIN[:5], "at least 10 points, got 5"),
        (LOAD[:-1], STRAIN, "columns of one length"),
        (LOAD, np.where(STRAIN > 0.05, STRAIN, np.nan), "numbers without gaps"),
        (LOAD, np.where(STRAIN < 0.1, STRAIN, np.nan), "at least 10 numbers"),
    ],
)
def test_what_is_no_tensile_test_is_refused(load, strain, words):
    with pytest.raises(dic.errors.CurveError) as caught:
        dic.properties.Curve("record", load, strain)
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"area_mm2": 0.0}, "area: expected above 0 mm², got 0"),
        ({"area_mm2": -1.0}, "area: expected above 0 mm²"),
        ({"area_mm2": float("nan")}, "area: expected above 0 mm²"),
        ({"area_mm2": 1.0, "load_std_percent": -1.0}, "standard deviation of the load"),
        ({"area_mm2": 1.0, "offsets_percent": (0.0,)}, "offset"),
        ({"area_mm2": 1.0, "window_mpa": (100.0, 50.0)}, "window"),
        ({"area_mm2": 1.0, "hardening_percent": (20.0, 10.0)}, "range of hardening"),
    ],
)
def test_impossible_settings_are_refused(settings, words):
    with pytest.raises(dic.errors.CurveError) as caught:
        dic.properties.PropertySettings(**settings)
    assert words in str(caught.value)
