"""Reports of runs made by hand, whose strains are known exactly."""

import re
from dataclasses import replace
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dic.calibration import Calibration
from dic.errors import RunFileError
from dic.field import Field, Status
from dic.grid_points import GridPoints
from dic.measurement import Measurement, measure
from dic.process import CameraResult, RunResult
from dic.report import write_report
from dic.run_file import RunInfo, RunStep
from dic.settings import CorrelationSettings

SIDE_PX = 120
INFO = RunInfo(
    title="A tension test",
    run_id="run-7",
    status="completed",
    status_reason="",
    start_time="2026-01-01T08:00:00+00:00",
    simulated=False,
    sample="sheet",
    thickness_mm=1.0,
    width_mm=25.0,
    gauge_length_mm=60.0,
    definition='kind = "tension"',
    configuration="[cameras.on_axis]\n\n[cameras.off_axis]\ntilt_deg = 30.0\n",
    versions="offaxis 0.1.0\nnumpy 2.0",
)


@cache
def calibration() -> Calibration:
    """0.1 mm per px, seen upright, the calibrated area from pixel 10 to pixel 110."""
    index = np.stack(np.meshgrid(np.arange(11), np.arange(11)), axis=-1).reshape(-1, 2)
    uv_px = np.column_stack([10.0 + 10.0 * index[:, 0], 110.0 - 10.0 * index[:, 1]])
    return Calibration.fit(GridPoints.on_lattice(index, uv_px, (11, 11), 1.0), (SIDE_PX, SIDE_PX))


def affine(gradient: np.ndarray, label: str) -> Measurement:
    """A measurement of 64 points around the middle, moved by u = H (x - middle) with x right and y up."""
    at = np.arange(40, 80, 5)
    x, y = np.meshgrid(at - 60.0, 60.0 - at)
    u = gradient[0, 0] * x + gradient[0, 1] * y
    v_up = gradient[1, 0] * x + gradient[1, 1] * y
    warps = np.zeros((8, 8, 6))
    warps[..., 0], warps[..., 3] = u, -v_up
    ones, yes = np.ones((8, 8)), np.ones((8, 8), bool)
    iterations, status = ones.astype(np.int16), np.zeros((8, 8), np.int8)
    field = Field(at, at, warps, np.full_like(warps, 0.01), ones, iterations, status, yes, "search")
    return measure(label, field, calibration())


def stretch(exx: float, eyy: float) -> np.ndarray:
    """The displacement gradient whose Green-Lagrange strains are exactly these."""
    return np.diag([np.sqrt(1 + 2 * exx) - 1, np.sqrt(1 + 2 * eyy) - 1])


def turn(angle_deg: float, exx: float = 0.0) -> np.ndarray:
    """The displacement gradient of a rotation after a stretch along X of strain `exx`."""
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    return np.array([[c, -s], [s, c]]) @ (stretch(exx, 0.0) + np.eye(2)) - np.eye(2)


def camera(name: str, steps: list[RunStep], gradients: list[np.ndarray]) -> CameraResult:
    measurements = [affine(g, f"step {s.index}") for g, s in zip(gradients, steps, strict=True)]
    speckle = np.random.default_rng(1).uniform(0, 255, (SIDE_PX, SIDE_PX)).astype(np.float32)
    return CameraResult(name, calibration(), speckle, list(steps), measurements, [])


def tension_steps() -> list[RunStep]:
    loads = [
        RunStep(2 + k, "load", 2000.0 * (k + 1), 2001.5 + 2000 * k, 0.25 * (k + 1), np.nan, 10.0 * k)
        for k in range(3)
    ]
    return [*loads, RunStep(7, "displacement", 1.05, 6543.2, 1.0498, np.nan, 40.0)]


def tension_run(bias: float = 0.001, **info: Any) -> RunResult:
    """Two cameras; the off-axis one (30°, tilted) sees εyy too small by `bias` and is named first."""
    steps = tension_steps()
    strains = [(-0.0003 * k, 0.001 * k) for k in range(1, 5)]
    on_axis = camera("on_axis", steps, [stretch(x, y) for x, y in strains])
    off_axis = camera("off_axis", steps, [stretch(x, y - bias) for x, y in strains])
    return RunResult("runs/tension.h5", replace(INFO, **info), CorrelationSettings(), [off_axis, on_axis])


def rotation_run(angle_deg: float, peak: float, **info: Any) -> RunResult:
    """Two cameras; the off-axis one (panned) sees a false εxx of `peak` at 180°, half of it elsewhere."""
    angles = [90.0, 180.0, 270.0]
    steps = [RunStep(2 + k, "rotation", a, np.nan, np.nan, a + 0.001, 10.0 * k) for k, a in enumerate(angles)]
    on_axis = camera("on_axis", steps, [turn(a) for a in angles])
    off_axis = camera("off_axis", steps, [turn(a, peak * (1 if a == 180.0 else 0.5)) for a in angles])
    configuration = f"[cameras.on_axis]\n[cameras.off_axis]\npan_deg = {angle_deg}\n"
    said = replace(INFO, title="A rotation test", configuration=configuration, **info)
    return RunResult("runs/rotation.h5", said, CorrelationSettings(), [on_axis, off_axis])


EVIL = '<script>alert("x")</script> & more'
_VOID = {"meta", "img", "br", "link", "hr", "input"}


class Page(HTMLParser):
    """A page read strictly: every tag closed in order; its links, ids, texts and tables."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.attributes: list[tuple[str, str]] = []
        self.tables: dict[str, list[list[str]]] = {}
        self.captions: list[str] = []
        self.text = ""
        self._table = ""
        self.feed(html)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.attributes += [(name, value or "") for name, value in attrs]
        if tag in _VOID:
            return
        self.open.append(tag)
        if tag == "table":
            self._table = f"{dict(attrs).get('class', '')} {len(self.tables)}"
            self.tables[self._table] = []
        elif tag == "tr":
            self.tables[self._table].append([])
        elif tag in ("td", "th"):
            self.tables[self._table][-1].append("")
        elif tag == "figcaption":
            self.captions.append("")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if "style" in self.open:
            return
        self.text += data
        if "figcaption" in self.open:
            self.captions[-1] += data
        if {"td", "th"} & set(self.open):
            self.tables[self._table][-1][-1] += data

    def values(self, name: str) -> list[str]:
        return [value for attribute, value in self.attributes if attribute == name]

    def table(self, kind: str) -> list[list[str]]:
        return next(
            [[c.strip() for c in row] for row in t] for n, t in self.tables.items() if n.startswith(kind)
        )


def number(text: str) -> float:
    return float(text.replace("−", "-").replace("\u202f", ""))


def written(tmp_path: Path, *results: RunResult) -> str:
    path = tmp_path / "report.html"
    write_report(results, path)
    return path.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def tension_html(tmp_path_factory: pytest.TempPathFactory) -> str:
    return written(tmp_path_factory.mktemp("tension"), tension_run())


@pytest.fixture(scope="module")
def troubled_html(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A run that was aborted, whose texts are hostile; each camera lost a step in another way."""
    reason = f"the grips opened {EVIL}"
    run = tension_run(title=EVIL, sample=EVIL, definition=EVIL, status="aborted", status_reason=reason)
    off_axis, on_axis = run.cameras
    del off_axis.steps[1], off_axis.measurements[1]
    off_axis.failures.append(f"off_axis, step 3: nothing correlates {EVIL}")
    lost = on_axis.measurements[0].field
    lost.status[:] = Status.NOT_CONVERGED
    lost.warps[:] = np.nan
    on_axis.measurements[0] = measure("step 2", lost, on_axis.calibration)
    return written(tmp_path_factory.mktemp("troubled"), run)


@pytest.fixture(scope="module")
def rotation_html(tmp_path_factory: pytest.TempPathFactory) -> str:
    runs = [rotation_run(10.0, 0.0012), rotation_run(30.0, 0.004, simulated=True)]
    return written(tmp_path_factory.mktemp("rotation"), *runs)


def test_step_table_holds_the_numbers_of_the_run_with_the_on_axis_camera_first(tension_html: str) -> None:
    rows = Page(tension_html).table("steps")[3:]
    assert [row[:5] for row in rows] == [
        ["2", "2000 N", "2001.5", "0.2500", "–"],
        ["3", "4000 N", "4001.5", "0.5000", "–"],
        ["4", "6000 N", "6001.5", "0.7500", "–"],
        ["7", "1.05 mm", "6543.2", "1.0498", "–"],
    ]
    for k, row in enumerate(rows, 1):
        assert row[5] == row[12] == "64/64"
        on_axis, off_axis = [-300.0 * k, 1000.0 * k, 0.0], [-300.0 * k, 1000.0 * k - 1000.0, 0.0]
        assert [number(cell) for cell in row[6:12]] == on_axis * 2
        assert [number(cell) for cell in row[13:19]] == off_axis * 2


def test_calibration_table_holds_scale_and_residuals(tension_html: str) -> None:
    rows = [row for name, t in Page(tension_html).tables.items() for row in t if len(row) == 7]
    cells = [cell.strip() for cell in next(row for row in rows if row[0].startswith("off_axis"))]
    assert cells == ["off_axis 30°", "121 of 121", "100.000", "0.0000", "0.000", "0.0000", "0.000"]


def test_tension_is_set_beside_what_the_paper_reported(tension_html: str) -> None:
    rows = {row[-2] + " " + row[0]: row[-1] for row in Page(tension_html).table("comparison")[1:]}
    bias = next(v for k, v in rows.items() if "difference of the calibrated off-axis camera" in k)
    change = next(v for k, v in rows.items() if "what calibration changes" in k)
    others = next(v for k, v in rows.items() if "difference of the other strains" in k)
    assert bias == "εyy −1000 µε"
    assert change == "εxx 0 µε, εyy 0 µε, εxy 0 µε"
    assert others == "εxx 0 µε, εxy 0 µε"


def test_rotation_runs_are_compared_from_the_largest_angle_down(rotation_html: str) -> None:
    rows = Page(rotation_html).table("comparison")
    worst = rows.index(next(row for row in rows if "largest strain error after" in row[0]))
    assert rows[worst][-2:] == ["run 2, off_axis 30°", "εxx 4000 µε at 180.0°"]
    assert rows[worst + 1] == ["run 1, off_axis 10°", "εxx 1200 µε at 180.0°"]


def test_captions_say_what_the_paper_says_and_what_is_here(rotation_html: str) -> None:
    captions = [" ".join(caption.split()) for caption in Page(rotation_html).captions]
    caption = next(c for c in captions if c.startswith("Calibrated mean strain"))
    assert "The paper: 4000 µε at 30°" in caption
    assert "Here: εxx 4000 µε at 180.0° (run 2, off_axis 30°); εxx 1200 µε at 180.0°" in caption


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


def test_step_that_one_camera_missed_is_shown_as_missing(troubled_html: str) -> None:
    rows = Page(troubled_html).table("steps")[3:]
    assert [row[0] for row in rows] == ["2", "3", "4", "7"]
    assert rows[1][-1] == "not measured"
    assert number(rows[1][7]) == 2000.0


def test_no_strain_is_a_dash_not_a_number(troubled_html: str) -> None:
    row = Page(troubled_html).table("steps")[3]
    assert row[5] == "0/64"
    assert row[6:12] == ["–"] * 6


def test_run_without_any_measured_step_still_gives_a_report(tmp_path: Path) -> None:
    run = tension_run(status="failed", status_reason="the grips opened")
    for camera in run.cameras:
        camera.steps.clear()
        camera.measurements.clear()
    text = Page(written(tmp_path, run)).text
    assert "No step of this run could be measured." in text
    assert "the grips opened" in text


def test_camera_whose_angle_the_rig_file_does_not_tell_goes_by_its_name(tmp_path: Path) -> None:
    page = Page(written(tmp_path, tension_run(configuration="this is no TOML [")))
    rows = page.table("comparison")
    assert "off_axis 30°" not in page.text
    assert any(row[-2:] == ["run 1, off_axis", "εxx 0 µε, εyy −1000 µε"] for row in rows)


def test_same_run_gives_the_same_file(tmp_path: Path, tension_html: str) -> None:
    assert written(tmp_path, tension_run()) == tension_html


def test_no_run_and_no_folder_are_refused_in_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(RunFileError, match="at least one run"):
        write_report([], tmp_path / "report.html")
    empty = RunResult("none.h5", replace(INFO), CorrelationSettings(), [])
    with pytest.raises(RunFileError, match="a folder that can be written to") as caught:
        write_report([empty], tmp_path / "nowhere" / "report.html")
    assert "\n" not in str(caught.value)
