"""The file strain.csv has one line for each image, and opens in a spreadsheet program."""

import csv
import shutil
import subprocess
from pathlib import Path

import pytest

from dic.results.strain_table import write_strain_table


def mean(exx: float) -> dict[str, object]:
    values = {"exx": exx, "eyy": -exx / 4, "exy": 0.0, "e1": exx, "e2": -exx / 4, "direction_deg": 0.0}
    return values | {f"{name}_std": 1.25e-6 for name in values} | {"rotation_deg": 0.5, "points": 90}


def measured(name: str, **others: object) -> dict[str, object]:
    return {"file": name, "points": 120, "out_of_view": 30, "converged": 90, "raw": mean(0.001)} | others


CORRECTED = {"applied": True, "method": "tilt"} | mean(0.003)
DECLINED = {"applied": False, "method": "tilt", "reason": "it tears; look at it"}
ROWS = [
    measured("a.png", calibrated=mean(0.002), corrected=CORRECTED, load_n=1200.5, angle_deg=float("nan")),
    measured("b.png", calibrated=mean(0.002), corrected=DECLINED | mean(0.002), load_n=float("nan")),
    {"file": "c.png", "error": "c.png: read image: expected a whole image, got none"},
]


def read(path: Path, delimiter: str = ",") -> list[dict[str, str]]:
    with path.open(encoding="utf-8-sig", newline="") as file:
        return list(csv.DictReader(file, delimiter=delimiter))


@pytest.mark.parametrize("name", ["=cmd|' /C calc'!A0.png", "+1.png", "-2.png", "@SUM(A1).png"])
def test_name_of_an_image_never_becomes_a_formula(tmp_path, name):
    write_strain_table([measured(name)], tmp_path / "strain.csv")
    (line,) = read(tmp_path / "strain.csv")
    assert line["image"] == f"'{name}"
    assert float(line["raw_eyy"]) < 0.0


def test_each_image_has_a_line_with_what_was_measured(tmp_path):
    write_strain_table(ROWS, tmp_path / "strain.csv")
    first, second, third = read(tmp_path / "strain.csv")
    assert (first["image"], first["points"], first["converged"]) == ("a.png", "120", "90")
    assert float(first["converged_percent"]) == 60.0
    assert (float(first["load_n"]), second["load_n"]) == (1200.5, "")
    assert [float(first[f"{kind}_exx"]) for kind in ("raw", "calibrated", "corrected")] == [
        0.001,
        0.002,
        0.003,
    ]
    assert (
        float(first["raw_exx_std"]) == float(first["corrected_exx_std"]) == pytest.approx(1.25e-6, abs=5e-10)
    )
    assert (first["correction"], second["correction"]) == ("tilt", "it tears; look at it")
    assert "angle_deg" not in first
    assert [third[name] for name in ("image", "raw_exx", "problem")] == ["c.png", "", ROWS[2]["error"]]


def test_deviation_of_calibrated_strain_contains_the_motion_out_of_the_plane_or_is_missing(tmp_path):
    """Result files of earlier versions have the noise alone, and no name for its part."""
    whole = mean(0.002) | {"exx_std": 3e-4, "exx_std_images": 1e-6}
    write_strain_table([*ROWS[:2], measured("d.png", calibrated=whole)], tmp_path / "strain.csv")
    rows = read(tmp_path / "strain.csv")
    assert [row["calibrated_exx_std"] for row in rows] == ["", "", "0.000300000"]
    assert rows[1]["corrected_exx"] == ""


def test_columns_without_a_value_are_left_out(tmp_path):
    write_strain_table([measured("a.png")], tmp_path / "strain.csv")
    (row,) = read(tmp_path / "strain.csv")
    assert not [
        name for name in row if name.startswith(("calibrated", "corrected", "load", "step", "camera"))
    ]
    assert "problem" not in row


def test_decimal_commas_change_no_value(tmp_path):
    write_strain_table(ROWS, tmp_path / "point.csv")
    write_strain_table(ROWS, tmp_path / "comma.csv", decimal_comma=True)
    point, comma = read(tmp_path / "point.csv"), read(tmp_path / "comma.csv", ";")
    assert comma[0]["raw_exx"] == "0,001000000"
    names = [name for name in point[0] if name.endswith(("exx", "std", "percent", "load_n"))]
    assert [[row[name].replace(",", ".") for name in names] for row in comma] == [
        [row[name] for name in names] for row in point
    ]
    assert [row["correction"] for row in comma] == [row["correction"] for row in point]


def test_names_beyond_ascii_have_the_mark_that_spreadsheets_need(tmp_path):
    write_strain_table([measured("Prüfling.png")], tmp_path / "strain.csv")
    assert (tmp_path / "strain.csv").read_bytes().startswith(b"\xef\xbb\xbf")
    assert read(tmp_path / "strain.csv")[0]["image"] == "Prüfling.png"
    write_strain_table(ROWS, tmp_path / "strain.csv")
    assert not (tmp_path / "strain.csv").read_bytes().startswith(b"\xef")


@pytest.mark.extended
@pytest.mark.parametrize(("comma", "filter_"), [(False, "44,34,76,1,,1033"), (True, "59,34,76,1,,1031")])
def test_a_spreadsheet_reads_the_numbers_as_numbers(tmp_path, comma, filter_):
    """LibreOffice reads the table in the language of the decimal sign, and writes it with decimal points."""
    office = shutil.which("soffice") or shutil.which("libreoffice")
    if office is None:
        pytest.skip("LibreOffice is not on this machine")
    write_strain_table(ROWS, tmp_path / "strain.csv", decimal_comma=comma)
    command = [
        office,
        "--headless",
        # two programs with one profile would hand over to each other
        f"-env:UserInstallation={(tmp_path / 'profile').as_uri()}",
        f"--infilter=CSV:{filter_}",
        "--convert-to",
        "fods",
        "--outdir",
        tmp_path,
    ]
    subprocess.run([*command, tmp_path / "strain.csv"], check=True, capture_output=True, timeout=100)
    sheet = (tmp_path / "strain.fods").read_text(encoding="utf-8")
    assert 'office:value-type="float" office:value="0.001"' in sheet
    assert 'office:value="1200.5"' in sheet
