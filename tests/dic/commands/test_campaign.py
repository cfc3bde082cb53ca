"""Tests of the command `dic campaign` and its output."""

import csv
import sys

import cv2
import numpy as np
import pytest

from tests.command_line import refusal, run_dic
from tests.pdf_files import page_texts, require_pango

AREA_MM2 = 20.0
COLUMNS = ["--load", "Load:kN", "--strain", "Strain:%", "--area-mm2", AREA_MM2]
MODULI_GPA = {"s1": 200.0, "s2": 202.0, "s10": 207.0}


def write_curve(path, e_gpa):
    """Write a record: a line of the given slope up to 400 MPa, then hardening to 500 MPa, then a fall."""
    strain = np.concatenate([np.linspace(0, 0.4 / e_gpa, 120), np.linspace(0.0025, 0.1, 60)])
    stress = np.concatenate([np.linspace(0, 400, 120), np.linspace(402, 500, 50), np.linspace(499, 480, 10)])
    rows = zip(stress * AREA_MM2 / 1e3, 100 * strain, strict=True)
    path.write_text("Load;Strain\n(kN);(%)\n" + "".join(f"{load:.9f};{e:.9f}\n" for load, e in rows))


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "tests").mkdir()
    for name, e_gpa in MODULI_GPA.items():
        write_curve(tmp_path / "tests" / f"{name}.csv", e_gpa)
    return tmp_path / "tests"


@pytest.mark.extended
def test_equal_tables_need_no_toml_file(folder, tmp_path):
    outputs = {name: folder / f"all.{name}" for name in ("csv", "json")} | {"plot": tmp_path / "p.png"}
    options = [word for name, path in outputs.items() for word in (f"--{name}", path)]
    done = run_dic("campaign", folder, *COLUMNS, *options, "--report", tmp_path / "r.html")
    assert done.status == 0, done
    (group,) = done.report["groups"]
    found = group["quantities"]["E_gpa"]
    assert group["specimens"] == ["s1", "s2", "s10"]
    # differences -3, -1, 4: their squares are 26 together
    assert found["mean"] == pytest.approx(203.0, rel=1e-4)
    assert found["std_between"] == pytest.approx(np.sqrt(26 / 2), rel=1e-2)
    assert group["quantities"]["Rm_mpa"]["mean"] == pytest.approx(500.0, abs=0.01)
    assert all(len(each["sha256"]) == 64 for each in done.report["specimens"])
    rows = list(csv.DictReader((folder / "all.csv").read_text("utf-8-sig").splitlines()))
    assert [row["specimen"] for row in rows if row["line"] == "specimen"] == ["s1", "s2", "s10"]
    assert cv2.imread(str(tmp_path / "p.png")).shape[2] == 3
    page = (tmp_path / "r.html").read_text()
    assert "All specimens" in page
    assert "data:image/png" in page
    tables = done.out.rpartition("\n\n")[0]
    assert max(map(len, tables.splitlines())) <= 80
    # the tables of a second call are no specimens
    again = run_dic("campaign", folder, *COLUMNS, *options[:4], "--force")
    assert [each["name"] for each in again.report["specimens"]] == ["s1", "s2", "s10"]


@pytest.mark.extended
def test_the_report_is_also_a_pdf_file_with_its_title_on_each_page(folder, tmp_path):
    require_pango()
    page, pdf = tmp_path / "r.html", tmp_path / "r.pdf"
    assert run_dic("campaign", folder, *COLUMNS, "--report", page, "--pdf", pdf).status == 0
    pages = page_texts(pdf)
    assert all(folder.name in text for text in pages)
    assert [text.endswith(f"{number} / {len(pages)}") for number, text in enumerate(pages, 1)] == [
        True
    ] * len(pages)
    assert "--report" in refusal("campaign", folder, *COLUMNS, "--pdf", tmp_path / "alone.pdf")


def test_a_pdf_file_that_cannot_be_written_is_refused_before_any_output(folder, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "weasyprint", None)
    outputs = {name: tmp_path / f"all.{name}" for name in ("csv", "json", "report", "pdf")}
    options = [word for name, path in outputs.items() for word in (f"--{name}", path)]
    said = refusal("campaign", folder, *COLUMNS, *options)
    assert "write PDF: expected the library WeasyPrint" in said
    assert not any(path.exists() for path in outputs.values())


def test_a_specimen_that_fails_is_told_and_the_others_stand(folder, tmp_path):
    (folder / "s3.csv").write_text("nothing\n")
    done = run_dic(
        "campaign", folder, *COLUMNS, "--json", tmp_path / "c.json", "--report", tmp_path / "r.html"
    )
    assert done.status == 1
    assert done.err.count("\n") == 1
    assert "error: specimen 's3'" in done.err
    names = {each["name"]: each["failure"] for each in done.report["specimens"]}
    assert [name for name, failure in names.items() if failure is None] == ["s1", "s2", "s10"]
    assert done.report["groups"][0]["quantities"]["E_gpa"]["count"] == 3
    assert names["s3"] in (tmp_path / "r.html").read_text()


def test_a_toml_file_stands_for_the_options(folder, tmp_path):
    text = '[defaults]\nload = "Load:kN"\nstrain = "Strain:%"\narea_mm2 = 20\n'
    for order, name in enumerate(MODULI_GPA):
        text += f'[[specimen]]\nfile = "{name}.csv"\ndirection_deg = {45 * order}\n'
    (folder / "campaign.toml").write_text(text)
    done = run_dic("campaign", folder, "--json", tmp_path / "c.json")
    assert [each["direction_deg"] for each in done.report["specimens"]] == [0, 45, 90]
    assert "no strain ratio at 0°" in done.report["anisotropy"]["r_mean"]["flags"][0]
    assert "campaign.toml alone, got both" in refusal("campaign", folder, *COLUMNS)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (COLUMNS[2:], "give --load COLUMN:UNIT"),
        (COLUMNS[:4], "the area of the cross-section"),
        ([*COLUMNS, "--files", "*.dat"], "a folder with files *.dat, got none"),
        ([*COLUMNS, "--files", ""], "--files: expected a pattern of files in the folder, got ''"),
        ([*COLUMNS, "--files", "/*.csv"], "--files: expected a pattern of files in the folder, got '/*.csv'"),
        ([*COLUMNS[2:], "--load", "Force:kN"], "3 that failed"),
        ([*COLUMNS, "--decimal-comma"], "--csv beside it"),
    ],
)
def test_what_cannot_be_used_is_refused_in_one_sentence(folder, arguments, words):
    assert words in refusal("campaign", folder, *arguments)


def test_inputs_and_earlier_results_are_not_replaced(folder, tmp_path):
    (tmp_path / "c.json").write_text("mine")
    assert "one that exists" in refusal("campaign", folder, *COLUMNS, "--json", tmp_path / "c.json")
    assert (tmp_path / "c.json").read_text() == "mine"


AREAS_MM2 = {"Zx2": (120.444, 0), "Zy1": (120.679, 90), "Zy3": (120.663, 90), "Zd2": (120.715, 45)}


def test_means_of_four_real_curves_are_those_of_the_laboratory(real_images, tmp_path):
    """BAM's own values of the four curves have these means: E 204 GPa, ReH 396.25 MPa, Rm 508 MPa."""
    text = '[defaults]\nload = "Load:kN"\nstrain = "Extensometer elongation:%"\n'
    for name, (area_mm2, direction) in AREAS_MM2.items():
        file = real_images / "tensile-s355" / f"{name}.csv"
        text += f'[[specimen]]\nfile = "{file}"\narea_mm2 = {area_mm2}\ndirection_deg = {direction}\n'
    (tmp_path / "campaign.toml").write_text(text)
    done = run_dic("campaign", tmp_path, "--json", tmp_path / "c.json")
    assert done.status == 0, done
    whole, across = done.report["groups"]
    assert whole["quantities"]["E_gpa"]["mean"] == pytest.approx(204.0, abs=1.5)
    assert whole["quantities"]["ReH_mpa"]["mean"] == pytest.approx(396.25, abs=1.5)
    assert whole["quantities"]["Rm_mpa"]["mean"] == pytest.approx(508.0, abs=0.5)
    # the laboratory's values of E differ by 199, 210, 206 and 201 GPa
    assert whole["quantities"]["E_gpa"]["std_between"] == pytest.approx(
        np.std([199, 210, 206, 201], ddof=1), abs=1.5
    )
    assert (across["direction_deg"], across["specimens"]) == (90, ["Zy1", "Zy3"])
