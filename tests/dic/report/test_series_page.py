"""Tests of `dic report` with a result file of `dic correlate`."""

import hashlib
import json
import re
from pathlib import Path

import h5py
import pytest

from dic.pipeline.result_file import load_series_result
from tests.command_line import refusal, run_dic
from tests.image_files import write_image

EXX = 0.004


@pytest.fixture(scope="module")
def measured(speckle, tmp_path_factory):
    """A result file of three images: one is shifted, one is stretched, and one shows another pattern."""
    folder = tmp_path_factory.mktemp("series")
    pattern, other = speckle(seed=3, shape=(160, 160)), speckle(seed=8, shape=(160, 160))
    pictures = {
        "ref": pattern.draw(),
        "moved": pattern.draw(lambda x, y: (x - 0.6, y)),
        "stretched": pattern.draw(lambda x, y: (x / (1 + EXX), y)),
        "other": other.draw(),
    }
    files = [write_image(folder / f"{name}.png", picture) for name, picture in pictures.items()]
    result = folder / "r.h5"
    assert run_dic("correlate", *files, "--subset", 21, "--step", 10, "-o", result).status == 2
    return result


def rows_of(page):
    """Return the texts of the cells of each row of a page, keyed by the image's name."""
    text = re.sub(r"</?span[^>]*>", "", page.read_text(encoding="utf-8"))
    rows = [re.findall(r"<td[^>]*>(.*?)</td>", row) for row in text.split("<tr")]
    return {cells[1]: cells for cells in rows if len(cells) > 2}


def number(cell):
    return float(cell.split(" ± ")[0].replace("\u202f", "").replace("−", "-"))


def test_page_shows_strains_failures_settings_and_where_the_results_come_from(measured, tmp_path):
    page = tmp_path / "report.html"
    assert run_dic("report", measured, "-o", page).status == 0
    text, rows = page.read_text(encoding="utf-8"), rows_of(page)
    # Green-Lagrange strain of a stretch by 0.4 %
    assert number(rows["stretched.png"][3]) == pytest.approx(1e6 * ((1 + EXX) ** 2 - 1) / 2, abs=100)
    assert abs(number(rows["moved.png"][3])) < 100
    assert rows["other.png"][3] == "–"
    assert "find the reference" in text.split("<td>other.png</td>")[1].split("</tr>")[1]
    assert "3 images, compared with ref.png; 1 could not be measured." in text
    assert hashlib.sha256((measured.parent / "ref.png").read_bytes()).hexdigest() in text
    assert "correlate" in text
    # strain of the last image, one component of all images, displacement of the last image, and a curve
    assert (text.count("data:image/png"), text.count("data:image/svg")) == (3, 1)


def test_title_is_what_was_measured_or_what_the_user_says_and_the_first_image_is_chosen(measured, tmp_path):
    page = tmp_path / "report.html"
    assert run_dic("report", measured, "-o", page).status == 0
    first = page.read_text(encoding="utf-8")
    assert "<h1>Strain in 2 of 3 images, moved to stretched</h1>" in first
    assert "Maps of strain of stretched.png" in first
    options = "--title", "Sheet 7", "--image", "moved", "--force"
    assert run_dic("report", measured, "-o", page, *options).status == 0
    text = page.read_text(encoding="utf-8")
    assert "<h1>Sheet 7</h1>" in text
    assert "Maps of strain of moved.png" in text
    said = refusal("report", measured, "-o", page, "--image", "other", "--force")
    assert "one measured image, got 'other', which could not be measured; give --image stretched.png" in said


def test_strains_above_one_percent_are_shown_in_percent(speckle, tmp_path):
    pattern = speckle(seed=3, shape=(160, 160))
    stretch = 1.02
    for name, moved in (("a", lambda x, y: (x, y)), ("b", lambda x, y: (x / stretch, y))):
        write_image(tmp_path / f"{name}.png", pattern.draw(moved))
    files = tmp_path / "a.png", tmp_path / "b.png"
    assert run_dic("correlate", *files, "--subset", 21, "--step", 10, "-o", tmp_path / "r.h5").status == 0
    assert run_dic("report", tmp_path / "r.h5", "-o", tmp_path / "r.html").status == 0
    row = rows_of(tmp_path / "r.html")["b.png"]
    assert number(row[3]) == pytest.approx(100 * (stretch**2 - 1) / 2, abs=0.01)
    assert "Mean strains in %" in (tmp_path / "r.html").read_text(encoding="utf-8")


def test_gauges_without_a_load_are_drawn_and_json_has_all_rows(measured, tmp_path):
    page, values = tmp_path / "report.html", tmp_path / "values.json"
    gauge = "across=extensometer start=40,80 end=120,80 patch=20"
    assert run_dic("report", measured, "--declare", gauge, "-o", page, "--json", values).status == 0
    assert "Strain of the gauges in all images" in page.read_text(encoding="utf-8")
    content = json.loads(values.read_text(encoding="utf-8"))
    assert content["tests"] == []
    rows = {Path(row["file"]).name: row for row in content["series"][0]["images"]}
    assert rows["stretched.png"]["raw"]["exx"] == pytest.approx(((1 + EXX) ** 2 - 1) / 2, abs=1e-4)
    assert "find the reference" in rows["other.png"]["error"]


def test_series_is_loaded_as_it_was_measured(measured):
    result = load_series_result(measured)
    assert [image.failure is None for image in result.series.images] == [True, True, False]
    moved = result.series.images[0].measurement
    digest = hashlib.sha256((measured.parent / "moved.png").read_bytes()).hexdigest()
    assert moved.digest == digest
    assert moved.field.region.shape == (160, 160)
    assert result.provenance.inputs == {
        str(measured.parent / "ref.png"): hashlib.sha256(
            (measured.parent / "ref.png").read_bytes()
        ).hexdigest()
    }


@pytest.mark.parametrize(
    ("missing", "word"),
    [("series/exx", "lacks some of its data"), ("series/reference", "earlier version")],
)
def test_file_without_a_part_is_one_sentence(measured, missing, word, tmp_path):
    cut = tmp_path / "cut.h5"
    cut.write_bytes(measured.read_bytes())
    with h5py.File(cut, "r+") as file:
        del file[missing]
    assert word in refusal("report", cut, "-o", tmp_path / "report.html")
    assert not (tmp_path / "report.html").exists()


def test_series_that_was_stopped_is_not_called_whole(measured, tmp_path):
    copy = tmp_path / "r.h5"
    copy.write_bytes(measured.read_bytes())
    with h5py.File(copy, "r+") as file:
        file.attrs["finished"] = 0
    page, values = tmp_path / "report.html", tmp_path / "values.json"
    assert run_dic("report", copy, "-o", page, "--json", values).status == 0
    assert "The series was stopped before its last image" in page.read_text(encoding="utf-8")
    assert json.loads(values.read_text(encoding="utf-8"))["series"][0]["unfinished"]


def test_command_for_runs_says_what_to_do_with_a_result_file(measured):
    assert "got a result file; give it to `dic report`" in refusal("process", measured)
