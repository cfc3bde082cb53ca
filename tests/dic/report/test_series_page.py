"""Tests of `dic report` with a result file of `dic correlate`."""

import hashlib
import re

import h5py
import pytest

from dic.pipeline.series_result_file import load_series_result
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


def test_page_shows_strains_failures_settings_and_where_the_results_come_from(measured, tmp_path):
    page = tmp_path / "report.html"
    assert run_dic("report", measured, "-o", page).status == 0
    text = re.sub(r"</?span[^>]*>", "", page.read_text(encoding="utf-8"))
    rows = {
        cells[0]: cells
        for cells in (re.findall(r"<td[^>]*>(.*?)</td>", row) for row in text.split("<tr>"))
        if cells
    }
    # Green-Lagrange strain of a stretch by 0.4 %
    exx = float(rows["stretched.png"][2].split(" ± ")[0].replace("\u202f", "").replace(" ", ""))
    assert exx == pytest.approx(1e6 * ((1 + EXX) ** 2 - 1) / 2, abs=100)
    assert abs(float(rows["moved.png"][2].split(" ± ")[0].replace("−", "-"))) < 100
    assert rows["other.png"][2] == "–"
    assert "find the reference" in rows["other.png"][-1]
    assert hashlib.sha256((measured.parent / "ref.png").read_bytes()).hexdigest() in text
    assert "correlate" in text
    assert text.count("data:image/png") == 2


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
