"""Tests of the report's tables of all steps."""

import numpy as np
import pytest

from dic.report.series import number_runs
from dic.report.steps import camera_tables
from tests.dic.report.page import Page, number
from tests.dic.report.runs import EVIL, STRAIGHT, tension_run


def test_step_tables_hold_the_numbers_of_the_run_with_the_on_axis_camera_first(tension_html: str) -> None:
    on_axis, off_axis = (table[2:] for table in Page(tension_html).all_tables("steps"))
    for table in (on_axis, off_axis):
        assert [row[:5] for row in table] == [
            ["2", "2000 N", "2001.5", "0.2500", "64/64"],
            ["3", "4000 N", "4001.5", "0.5000", "64/64"],
            ["4", "6000 N", "6001.5", "0.7500", "64/64"],
            ["7", "1.05 mm", "6543.2", "1.0498", "64/64"],
        ]
    for k, rows in enumerate(zip(on_axis, off_axis, strict=True), 1):
        assert [number(cell) for cell in rows[0][5:11]] == [-300.0 * k, 1000.0 * k, 0.0] * 2
        assert [number(cell) for cell in rows[1][5:11]] == [-300.0 * k, 1000.0 * k - 1000.0, 0.0] * 2


def test_step_tables_hold_corrected_strains_and_the_reason_where_there_are_none(corrected_html: str) -> None:
    page = Page(corrected_html)
    on_axis, off_axis = (table[2:] for table in page.all_tables("steps"))
    assert [row[11:] for row in on_axis] == [["– a"]] * 4
    assert f"not corrected: {STRAIGHT}" in page.text
    assert off_axis[1][11:] == ["−600.0 ± 3.0", "2002.0 ± 3.0", "0.0 ± 3.0"]
    assert off_axis[2][11:] == ["– a"]
    assert f"not corrected: it necks {EVIL}" in page.text


def test_calibrated_strains_have_all_of_their_error_beside_them() -> None:
    run = tension_run()
    shared = np.diag([0.3e-3, 0.4e-3, 0.05e-3]) ** 2
    off_axis = run.cameras[0]
    alone = [seen.calibrated_mean for seen in off_axis.measurements]
    off_axis.measurements[:] = [seen.sharing(shared) for seen in off_axis.measurements]
    tables = camera_tables(number_runs([run])[0])
    # The other camera's measurements are as from a file of an earlier version, which has the noise alone.
    assert not any("±" in cell for row in tables[0].rows for cell in row.cells or [])
    for row, mean in zip(tables[1].rows, alone, strict=True):
        assert not any("±" in cell for cell in row.cells[:3])
        # small strains of an upright specimen: εxx, εyy and εxy have the errors of the gradient's elements
        stds = np.hypot([mean.exx_std, mean.eyy_std, mean.exy_std], np.sqrt(np.diag(shared)))
        for cell, std in zip(row.cells[3:], stds, strict=True):
            assert number(cell.split(" ± ")[1]) == pytest.approx(1e6 * std, abs=0.51)


def test_two_cameras_together_have_a_table_of_their_own(corrected_html: str) -> None:
    (table,) = Page(corrected_html).all_tables("steps together")
    assert table[0][0] == "off_axis 30.0° and on_axis together"
    assert table[3][4:] == [
        "64", "−600.0 ± 3.0", "2000.0 ± 3.0", "0.0 ± 3.0",
        "1.00 ± 0.25", "0.0000 ± 0.0006", "0.0400 ± 0.0006",
    ]  # fmt: skip
    assert table[5][4:] == ["0", "– a"]


def test_run_that_two_cameras_did_not_see_together_has_no_such_table(tension_html: str) -> None:
    page = Page(tension_html)
    assert page.all_tables("steps together") == []
    assert "Corrected differences" not in "".join(page.values("alt"))


def test_step_that_one_camera_missed_is_shown_as_missing(troubled_html: str) -> None:
    on_axis, off_axis = (table[2:] for table in Page(troubled_html).all_tables("steps"))
    assert [row[0] for row in on_axis] == [row[0] for row in off_axis] == ["2", "3", "4", "7"]
    assert off_axis[1][-1] == "not measured"
    assert number(on_axis[1][6]) == 2000.0


def test_no_strain_is_a_dash_not_a_number(troubled_html: str) -> None:
    row = Page(troubled_html).table("steps")[2]
    assert row[4] == "0/64"
    assert row[5:11] == ["–"] * 6


def test_readings_that_no_step_has_get_no_column(tension_html: str, rotation_html: str) -> None:
    for html, readings in ((tension_html, ["Load, N", "Displ., mm"]), (rotation_html, ["Angle, °"])):
        for table in Page(html).all_tables("steps"):
            assert table[1][: 2 + len(readings) + 1] == ["Step", "Target", *readings, "εxx"]
