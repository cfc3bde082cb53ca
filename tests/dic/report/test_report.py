"""Reports of runs made by hand, whose strains are known exactly."""

import re
from dataclasses import replace
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dic.calibration.calibration import Calibration
from dic.calibration.pinhole.camera import Pinhole
from dic.correlation.field import Field
from dic.correlation.settings import CorrelationSettings
from dic.correlation.status import Status
from dic.errors import RunFileError
from dic.out_of_plane.correct import Corrections
from dic.out_of_plane.correction import Correction
from dic.out_of_plane.plane import Plane
from dic.out_of_plane.two_cameras import TwoCameraStep
from dic.pipeline.camera_result import CameraResult
from dic.pipeline.run import RunResult
from dic.pipeline.run_corrections import CorrectionSettings, JointCorrections, RunCorrections
from dic.report import write_report
from dic.report.setup_figures import in_grid_axes
from dic.runfile.reader import RunInfo, RunStep
from dic.strain.measurement import Measurement, measure
from dic.targets.points import GridPoints

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
    settings = CorrelationSettings(step_px=5)
    field = Field(at, at, warps, np.full_like(warps, 0.01), ones, iterations, status, yes, "search", settings)
    return measure(field, calibration(), label=label)


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
    return uncorrected("runs/tension.h5", replace(INFO, **info), [off_axis, on_axis])


def rotation_run(angle_deg: float, peak: float, **info: Any) -> RunResult:
    """Two cameras; the off-axis one (panned) sees a false εxx of `peak` at 180°, half of it elsewhere."""
    angles = [90.0, 180.0, 270.0]
    steps = [RunStep(2 + k, "rotation", a, np.nan, np.nan, a + 0.001, 10.0 * k) for k, a in enumerate(angles)]
    on_axis = camera("on_axis", steps, [turn(a) for a in angles])
    off_axis = camera("off_axis", steps, [turn(a, peak * (1 if a == 180.0 else 0.5)) for a in angles])
    configuration = f"[cameras.on_axis]\n[cameras.off_axis]\npan_deg = {angle_deg}\n"
    said = replace(INFO, title="A rotation test", configuration=configuration, **info)
    return uncorrected("runs/rotation.h5", said, [on_axis, off_axis])


STRAIGHT = "the camera looks too straight on"


def given(result: RunResult, motion: str, cameras: dict[str, Corrections], **more: Any) -> RunResult:
    """The run with corrections that are given here, not computed; all other cameras' were declined."""
    for seen in result.cameras:
        declined = [Correction.refused("none", m, STRAIGHT) for m in seen.measurements]
        cameras.setdefault(seen.camera, Corrections(declined))
    return replace(result, corrections=RunCorrections(motion, cameras, **({"findings": {}} | more)))


def uncorrected(source: str, info: RunInfo, cameras: list[CameraResult]) -> RunResult:
    nothing = RunCorrections("free", {}, {})
    result = RunResult(source, info, CorrelationSettings(), CorrectionSettings(), cameras, nothing)
    return given(result, "free", {})


def correction(measurement: Measurement, strains: tuple[float, ...], plane: Plane) -> Correction:
    """Corrected to these strains, each known to 3 µε; slopes known to 0.001°."""
    mean = measurement.calibrated_mean
    assert mean is not None
    assert measurement.calibrated is not None
    exx, eyy, exy = strains
    mean = replace(mean, exx=exx, eyy=eyy, exy=exy, exx_std=3e-6, eyy_std=3e-6, exy_std=3e-6)
    std = np.array([*np.radians([0.001, 0.001]), np.nan])
    return Correction("tilt", mean, measurement.calibrated, measurement.strain_settings, plane, std)


def corrected_tension_run() -> RunResult:
    """One camera is corrected to εyy 2 µε off the truth but for step 4; both together to the truth itself.

    The specimen is tilted by k · 0.02° along Y and shifted by 0.5 k µm at the k-th step.
    """
    result = tension_run()
    off_axis = result.cameras[0]
    images, both = [], {}
    for k, (step, seen) in enumerate(zip(off_axis.steps, off_axis.measurements, strict=True), 1):
        plane = Plane(0.0, float(np.tan(np.radians(0.02 * k))), 0.0005 * k)
        truth = (-0.0003 * k, 0.001 * k, 0.0)
        one = correction(seen, (truth[0], truth[1] + 2e-6, truth[2]), plane)
        images.append(one if step.index != 4 else Correction.refused("tilt", seen, f"it necks {EVIL}"))
        together = correction(seen, truth, plane)
        together = replace(together, after_std=np.array([1e-5, 1e-5, 0.00025]))
        heights_mm = np.full((8, 8), 0.0005 * k)
        both[step.index] = TwoCameraStep((together, together), together.mean, heights_mm, heights_mm)
    both[7] = TwoCameraStep(both[7].corrections, declined="the cameras disagree")
    return given(
        result,
        "tension",
        {"off_axis": Corrections(images)},
        findings={"off_axis": ["the specimen tilted by -0.08°"], "on_axis": []},
        joint=JointCorrections(("off_axis", "on_axis"), both, ["it moved"]),
    )


def corrected_rotation_run(angle_deg: float, peak: float, **info: Any) -> RunResult:
    """The off-axis camera is corrected to an εyy of 7 µε at 180°, and 1 µε elsewhere."""
    result = rotation_run(angle_deg, peak, **info)
    off_axis = result.cameras[1]
    images = [
        correction(m, (0.0, 7e-6 if s.target == 180.0 else 1e-6, 0.0), Plane())
        for s, m in zip(off_axis.steps, off_axis.measurements, strict=True)
    ]
    return given(result, "rigid", {"off_axis": Corrections(images)})


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

    def all_tables(self, kind: str) -> list[list[list[str]]]:
        chosen = [t for n, t in self.tables.items() if n.rsplit(" ", 1)[0] == kind]
        return [[[" ".join(c.split()) for c in row] for row in t] for t in chosen]

    def table(self, kind: str) -> list[list[str]]:
        return self.all_tables(kind)[0]


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
def corrected_html(tmp_path_factory: pytest.TempPathFactory) -> str:
    return written(tmp_path_factory.mktemp("corrected"), corrected_tension_run())


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
    on_axis.measurements[0] = measure(lost, on_axis.calibration, label="step 2")
    return written(tmp_path_factory.mktemp("troubled"), given(run, "free", {}))


@pytest.fixture(scope="module")
def rotation_html(tmp_path_factory: pytest.TempPathFactory) -> str:
    runs = [rotation_run(10.0, 0.0012), corrected_rotation_run(30.0, 0.004, simulated=True)]
    return written(tmp_path_factory.mktemp("rotation"), *runs)


def test_step_tables_hold_the_numbers_of_the_run_with_the_on_axis_camera_first(tension_html: str) -> None:
    on_axis, off_axis = (table[2:] for table in Page(tension_html).all_tables("steps"))
    for table in (on_axis, off_axis):
        assert [row[:6] for row in table] == [
            ["2", "2000 N", "2001.5", "0.2500", "–", "64/64"],
            ["3", "4000 N", "4001.5", "0.5000", "–", "64/64"],
            ["4", "6000 N", "6001.5", "0.7500", "–", "64/64"],
            ["7", "1.05 mm", "6543.2", "1.0498", "–", "64/64"],
        ]
    for k, rows in enumerate(zip(on_axis, off_axis, strict=True), 1):
        assert [number(cell) for cell in rows[0][6:12]] == [-300.0 * k, 1000.0 * k, 0.0] * 2
        assert [number(cell) for cell in rows[1][6:12]] == [-300.0 * k, 1000.0 * k - 1000.0, 0.0] * 2


def test_step_tables_hold_corrected_strains_and_the_reason_where_there_are_none(corrected_html: str) -> None:
    page = Page(corrected_html)
    on_axis, off_axis = (table[2:] for table in page.all_tables("steps"))
    assert [row[12:] for row in on_axis] == [["– a"]] * 4
    assert f"not corrected: {STRAIGHT}" in page.text
    assert off_axis[1][12:] == ["−600 ± 3", "2002 ± 3", "0 ± 3"]
    assert off_axis[2][12:] == ["– a"]
    assert f"not corrected: it necks {EVIL}" in page.text


def test_two_cameras_together_have_a_table_of_their_own(corrected_html: str) -> None:
    (table,) = Page(corrected_html).all_tables("steps together")
    assert table[0][0] == "off_axis 30° and on_axis together"
    assert table[3][5:] == [
        "64", "−600 ± 3", "2000 ± 3", "0 ± 3", "1.00 ± 0.25", "0.0000 ± 0.0006", "0.0400 ± 0.0006",
    ]  # fmt: skip
    assert table[5][5:] == ["0", "– a"]


def test_run_that_two_cameras_did_not_see_together_has_no_such_table(tension_html: str) -> None:
    page = Page(tension_html)
    assert page.all_tables("steps together") == []
    assert "Corrected differences" not in "".join(page.values("alt"))


def test_calibration_table_holds_scale_and_residuals_of_both_models(tension_html: str) -> None:
    rows = [row for row in Page(tension_html).table("calibrations") if row[0] == "off_axis 30°"]
    assert [row[2].split()[0] for row in rows] == ["bicubic", "pinhole"]
    for row in rows:
        # The grid of the test is exact, so no model leaves anything of it.
        assert row[1] == "121 of 121"
        assert row[3:] == ["100.000", "0.0000", "0.000", "0.0000", "0.000", "0.0000"]


def test_set_up_is_what_geometry_says_of_the_camera(tmp_path: Path) -> None:
    """C = 40 mm at 30°: Cy = 20, Cz = 34.64 mm; tan 30° · 1 m° = 10.1 µε, 1 µm / Cz = 28.9 µε.

    Errors of 0.02 mm in Cy and 0.1 mm in Cz turn the line of sight by
    hypot(0.02 · cos 30°, 0.1 · sin 30°) / 40 = 0.00132 = 0.076°.
    """
    run = corrected_tension_run()
    covariance = np.zeros((13, 13))
    covariance[10:, 10:] = np.diag([0.01, 0.02, 0.1]) ** 2
    pinhole = replace(Pinhole.swung(tilt_deg=30.0), covariance=covariance)
    known = [replace(c, calibration=replace(c.calibration, pinhole=pinhole)) for c in run.cameras]
    run = given(
        replace(run, cameras=known), "tension", dict(run.corrections.cameras),
        joint=run.corrections.joint, findings=run.corrections.findings,
    )  # fmt: skip
    page = Page(written(tmp_path, run))
    row = page.table("setup")[3]
    assert row[:3] == ["off_axis 30°", "30.000 ± 0.076", "30.0"]
    assert [cell.lstrip("−") for cell in row[3:6]] == ["0.000 ± 0.010", "20.000 ± 0.020", "34.64 ± 0.10"]
    assert row[6:] == ["10.1", "28.9", "± 2.0", "± 6"]
    text = " ".join(page.text.split())
    assert (
        "off_axis 30°: a shift by w towards the camera strains all directions by w/Cz, 28.9 µε per µm" in text
    )
    # The largest measured shift is that of the last step both cameras agree on: 3 · 0.5 µm.
    assert "at most 1.50 ± 0.25 µm, which makes 43 ± 7 µε" in text


def test_findings_are_said_under_the_camera_they_belong_to(corrected_html: str) -> None:
    text = " ".join(Page(corrected_html).text.split())
    assert "off_axis 30° The specimen tilted by −0.08°." in text
    assert "off_axis 30° and on_axis together It moved." in text


def test_tension_shows_the_motion_of_the_plane_and_heights_at_the_largest_load(corrected_html: str) -> None:
    page = Page(corrected_html)
    shown = page.values("alt")
    for figure in ("Corrected differences", "Motion of the specimen's plane", "Heights of the specimen"):
        assert sum(alt.startswith(figure) for alt in shown) == 1
    captions = [" ".join(caption.split()) for caption in page.captions]
    # At step 7 the load is larger, but the cameras disagreed.
    assert any("at the step of the largest load, step 4;" in caption for caption in captions)


def test_harmonics_are_shown_where_the_angles_tell_them(tmp_path: Path, rotation_html: str) -> None:
    angles = np.arange(30.0, 361.0, 30.0)
    steps = [RunStep(2 + k, "rotation", a, np.nan, np.nan, a, k) for k, a in enumerate(angles)]
    run = rotation_run(30.0, 0.001)
    full = replace(run, cameras=[camera("on_axis", steps, [turn(a, 0.001) for a in angles])])
    alt = "Strain in the grid's axes with its harmonics"
    assert Page(written(tmp_path, given(full, "free", {}))).values("alt").count(alt) == 1
    # Three angles do not tell five coefficients.
    assert alt not in Page(rotation_html).values("alt")


def test_strain_that_stands_still_is_the_same_at_every_angle_in_the_axes_of_the_grid() -> None:
    """ε along X, seen from axes turned by φ: ε cos²φ, ε sin²φ, −ε sin φ cos φ (Mohr)."""
    angles_deg = np.array([0.0, 30.0, 90.0, 200.0])
    c, s = np.cos(np.radians(angles_deg)), np.sin(np.radians(angles_deg))
    turned = 1000.0 * np.column_stack([c * c, s * s, -s * c])
    standing = in_grid_axes(angles_deg, turned)
    np.testing.assert_allclose(standing, np.tile([1000.0, 0.0, 0.0], (4, 1)), atol=1e-9)
    assert standing.shape == (4, 3)


def test_tension_is_set_beside_what_the_paper_reported(tension_html: str) -> None:
    rows = {row[-2] + " " + row[0]: row[-1] for row in Page(tension_html).table("comparison")[1:]}
    bias = next(v for k, v in rows.items() if "difference of the calibrated off-axis camera" in k)
    change = next(v for k, v in rows.items() if "what calibration changes" in k)
    others = next(v for k, v in rows.items() if "difference of the other strains" in k)
    assert bias == "εyy −1000 µε"
    assert change == "εxx 0 µε, εyy 0 µε, εxy 0 µε"
    assert others == "εxx 0 µε, εxy 0 µε"


def test_corrected_tension_is_set_beside_the_paper_too(corrected_html: str) -> None:
    rows = {row[0]: row[-2:] for row in Page(corrected_html).table("comparison")[1:]}
    along = next(v for k, v in rows.items() if "difference of the corrected off-axis camera" in k)
    others = next(v for k, v in rows.items() if "the other strains, corrected" in k)
    together = next(v for k, v in rows.items() if "both cameras together" in k)
    assert along == ["run 1, off_axis 30°", "εyy 2 µε (3 of 4 steps)"]
    assert others == ["run 1, off_axis 30°", "εxx 0 µε, εxy 0 µε (3 of 4 steps)"]
    assert together[1] == "εxx 0 µε, εyy 0 µε, εxy 0 µε"


def test_corrected_rotation_is_set_beside_the_paper_and_says_what_was_not_corrected(
    rotation_html: str,
) -> None:
    page = Page(rotation_html)
    rows = page.table("comparison")
    worst = rows.index(next(row for row in rows if "largest strain error after correction" in row[0]))
    assert rows[worst][-2:] == ["run 2, off_axis 30°", "εyy 7 ± 3 µε at 180.0°"]
    assert rows[worst + 1] == ["run 1, off_axis 10°", "not corrected"]
    assert f"run 2, on_axis: {STRAIGHT}." in page.text
    assert page.values("alt").count("Corrected mean strains against the angle of rotation") == 1


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


def test_settings_say_which_model_and_which_correction(corrected_html: str) -> None:
    rows = dict(row for row in Page(corrected_html).table("settings") if len(row) == 2)
    assert rows["Calibrated strain by"] == "the paper's bicubic map of 2 × 16 parameters"
    assert rows["Correction"].endswith("Poisson's ratio 0.33, for bending")


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
    on_axis, off_axis = (table[2:] for table in Page(troubled_html).all_tables("steps"))
    assert [row[0] for row in on_axis] == [row[0] for row in off_axis] == ["2", "3", "4", "7"]
    assert off_axis[1][-1] == "not measured"
    assert number(on_axis[1][7]) == 2000.0


def test_no_strain_is_a_dash_not_a_number(troubled_html: str) -> None:
    row = Page(troubled_html).table("steps")[2]
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
    empty = uncorrected("none.h5", replace(INFO), [])
    with pytest.raises(RunFileError, match="a folder that can be written to") as caught:
        write_report([empty], tmp_path / "nowhere" / "report.html")
    assert "\n" not in str(caught.value)
