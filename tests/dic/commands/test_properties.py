"""Tests of the command `dic properties` and its output."""

import cv2
import numpy as np
import pytest

from tests.command_line import refusal, run_dic
from tests.dic.properties.synthetic import with_yield_point

COLUMNS = ["--load", "Load:kN", "--strain", "Elongation:%"]
AREA = ["--area-mm2", 20]


@pytest.fixture(scope="module")
def curve(tmp_path_factory):
    """The record of a machine: two lines of headings, semicolons between the columns, decimal commas."""
    path = tmp_path_factory.mktemp("curve") / "steel.csv"
    strain, stress = with_yield_point()
    lines = ["Time;Load;Elongation", "(sec);(kN);(%)"]
    for k, (e, s) in enumerate(zip(strain, stress, strict=True)):
        seen = "" if np.isnan(e) else f"{100 * e:.5f}"
        lines.append(f"{0.1 * k:.1f};{s * 20 / 1000:.6f};{seen}".replace(".", ","))
    path.write_text("\n".join(lines) + "\n")
    return path


def test_values_are_printed_written_and_drawn(curve, tmp_path):
    outputs = ["--json", tmp_path / "p.json", "--plot", tmp_path / "p.png"]
    done = run_dic("properties", curve, *COLUMNS, *AREA, "--load-std-percent", 0.5, *outputs)
    assert done.status == 0, done
    report = done.report
    assert report["E_gpa"]["value"] == pytest.approx(200, rel=1e-3)
    assert report["ReH_mpa"]["value"] == pytest.approx(400, abs=0.1)
    assert report["Rm_mpa"]["std"] == pytest.approx(2.5, rel=0.01)
    assert report["A_percent"]["value"] is None
    assert report["not_counted"] == ["area", "strain calibration"]
    lines = {line.split()[0]: line for line in done.out.splitlines() if not line.startswith(" ")}
    assert lines["Rm"].split()[1:] == ["500.0", "±", "2.5", "MPa"]
    assert "extensometer" in lines["A"]
    assert cv2.imread(str(tmp_path / "p.png")).shape[2] == 3


def test_more_offsets_and_a_fixed_window_are_options(curve, tmp_path):
    options = ["--offset-percent", 0.1, "--offset-percent", 0.5, "--window-mpa", 40, 160]
    done = run_dic("properties", curve, *COLUMNS, *AREA, *options, "--json", tmp_path / "p.json")
    assert {"Rp02_mpa", "Rp01_mpa", "Rp05_mpa"} <= set(done.report)
    assert done.report["E_gpa"]["rule"] == "least squares between fixed stresses"


def test_a_record_without_an_elastic_line_ends_with_1(curve, tmp_path):
    done = run_dic(
        "properties", curve, *COLUMNS, *AREA, "--window-mpa", 900, 950, "--json", tmp_path / "p.json"
    )
    assert done.status == 1
    assert done.report["E_gpa"]["value"] is None
    assert done.report["Rm_mpa"]["value"] == pytest.approx(500)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--load", "Load:kN", "--strain", "Elongation", *AREA], "COLUMN:UNIT"),
        ([*COLUMNS, "--area-mm2", 0], "area: expected above 0 mm², got 0.0"),
        (["--load", "Load:N", "--strain", "Elongation:%", *AREA], "the unit kN of the file's heading"),
        ([*COLUMNS, *AREA, "--transverse", "Width:%"], "got 'Width'"),
    ],
)
def test_what_cannot_be_used_is_refused_in_one_sentence(curve, arguments, words):
    assert words in refusal("properties", curve, *arguments)


def test_earlier_results_are_not_replaced(curve, tmp_path):
    (tmp_path / "p.json").write_text("mine")
    sentence = refusal("properties", curve, *COLUMNS, *AREA, "--json", tmp_path / "p.json")
    assert "one that exists" in sentence
    assert (tmp_path / "p.json").read_text() == "mine"
