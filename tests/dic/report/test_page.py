"""The report is complete, escapes malicious texts, and is identical in each repetition."""

import re
from dataclasses import replace
from pathlib import Path

import pytest

from dic.errors import RunFileError
from dic.report import write_report
from tests.dic.report.page import Page, written
from tests.dic.report.runs import EVIL, INFO, tension_run, uncorrected


def test_page_needs_nothing_from_outside(rotation_html: str) -> None:
    page = Page(rotation_html)
    assert all(uri.startswith("data:image/") for uri in page.values("src"))
    assert len(page.values("src")) >= 2 + 2 * (
        4 + 1
    )  # the test's two figures; maps and residuals of either run
    assert all(link.startswith("#") for link in page.values("href"))
    assert not re.search(
        r"https?:|//[a-z]|@import|<script|<link", re.sub(r"base64,[A-Za-z0-9+/=]+", "", rotation_html)
    )


def test_every_anchor_of_the_contents_exists_once(rotation_html: str, tension_html: str) -> None:
    for html in (rotation_html, tension_html):
        page = Page(html)
        ids = page.values("id")
        assert len(ids) == len(set(ids))
        assert {link.removeprefix("#") for link in page.values("href")} <= set(ids)


@pytest.mark.extended
def test_settings_say_which_model_and_which_correction(corrected_html: str) -> None:
    rows = dict(row for row in Page(corrected_html).table("settings") if len(row) == 2)
    assert rows["Calibrated strain by"] == "the paper's bicubic map of 2 × 16 parameters"
    assert rows["Correction"].endswith("Poisson's ratio 0.33, for bending")


def test_calibration_table_holds_scale_and_residuals_of_both_models(tension_html: str) -> None:
    rows = [row for row in Page(tension_html).table("calibrations") if row[0] == "on_axis"]
    assert [row[2].split()[0] for row in rows] == ["bicubic", "pinhole"]
    for row in rows:
        # The grid of the test is exact, so no model leaves anything of it.
        assert row[1] == "121 of 121"
        assert row[3:] == ["100.000", "0.0000", "0.000", "0.0000", "0.000", "0.0000"]


def test_simulated_is_written_across_simulated_runs_only(rotation_html: str, tension_html: str) -> None:
    assert "simulated" not in tension_html.lower()
    assert re.search(r'<section id="run-2" class="run simulated">', rotation_html)
    assert re.search(r'<section id="run-1" class="run">', rotation_html)
    assert '<section id="rotation" class="simulated">' in rotation_html
    assert "SIMULATED" in Page(rotation_html).text


def test_texts_of_the_run_are_shown_and_never_become_markup(troubled_html: str) -> None:
    assert "<script" not in troubled_html
    # Title in head, heading, summary and contents; specimen, protocol, reason and failure.
    assert Page(troubled_html).text.count(EVIL) >= 8


def test_unfinished_run_and_failures_stand_above_everything_else(troubled_html: str) -> None:
    text = Page(troubled_html).text
    start = text.index("Summary")
    assert "its status is “aborted”: the grips opened" in text[:start]
    assert "off_axis, step 3: nothing correlates" in text[:start]
    assert "on_axis, step 2: fewer than half of the points in view converged" in text[:start]


def test_run_in_order_has_no_box_of_problems(tension_html: str) -> None:
    assert "To know first" not in tension_html


def test_run_without_any_measured_step_still_gives_a_report(tmp_path: Path) -> None:
    run = tension_run(status="failed", status_reason="the grips opened")
    for camera in run.cameras:
        camera.steps.clear()
        camera.measurements.clear()
    text = Page(written(tmp_path, run, drawn=False)).text
    assert "No step of this run could be measured." in text
    assert "the grips opened" in text


def test_no_run_and_no_folder_are_refused_in_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(RunFileError, match="at least one run"):
        write_report([], tmp_path / "report.html")
    empty = uncorrected("none.h5", replace(INFO), [])
    with pytest.raises(RunFileError, match="a folder that can be written to") as caught:
        write_report([empty], tmp_path / "nowhere" / "report.html")
    assert "\n" not in str(caught.value)
