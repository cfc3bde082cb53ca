"""CSV tables of points whose local strain and its standard deviations are known from formulas."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dic.calibration.calibration import Calibration
from dic.correlation.field import Field
from dic.correlation.settings import CorrelationSettings
from dic.correlation.status import Status
from dic.out_of_plane.correction import Correction
from dic.results.csv import write_csv
from dic.strain.measurement import measure
from dic.strain.settings import StrainSettings
from dic.strain.strain import STRAIN_KEYS
from dic.targets.points import GridPoints

BEFORE = ["x_px", "y_px", "u_px", "v_px", "zncc", "status"]
CALIBRATED = ["X_mm", "Y_mm", "U_mm", "V_mm", "calibration"]

STEP_PX = 11
STD_PX = 0.02
EXX, EYY, EXY = 0.012, -0.004, 0.003
"""Green-Lagrange strains of the field, with x to the right and y up."""


def calibration() -> Calibration:
    """Return a calibration with 0.1 mm/px, upright, calibrated from pixel 10 to pixel 110 along both axes."""
    index = np.stack(np.meshgrid(np.arange(11), np.arange(11)), axis=-1).reshape(-1, 2)
    uv_px = np.column_stack([10.0 + 10.0 * index[:, 0], 110.0 - 10.0 * index[:, 1]])
    return Calibration.fit(GridPoints.on_lattice(index, uv_px, (11, 11), 1.0), (120, 120))


def stretched() -> np.ndarray:
    """Return the symmetric deformation gradient F = C^½ with the strains above; C is I + 2E."""
    C = np.eye(2) + 2.0 * np.array([[EXX, EXY], [EXY, EYY]])
    squares, axes = np.linalg.eigh(C)
    return axes @ np.diag(np.sqrt(squares)) @ axes.T


def field() -> Field:
    """Return a field of 7 × 7 points with the deformation gradient `stretched`; the first point has failed.

    The subsets are as wide as the step. So no two subsets share a pixel, and their errors are independent.
    """
    at = 60 + STEP_PX * np.arange(-3, 4)
    x, y = np.meshgrid(at - 60.0, 60.0 - at)
    u, v_up = np.einsum("ij,jrc->irc", stretched() - np.eye(2), np.stack([x, y]))
    warps = np.zeros((7, 7, 6))
    warps[..., 0], warps[..., 3] = u, -v_up
    status = np.zeros((7, 7), np.int8)
    status[0, 0], warps[0, 0] = Status.LOW_CORRELATION, np.nan
    ones, yes = np.ones((7, 7)), np.ones((7, 7), bool)
    settings = CorrelationSettings(subset_px=STEP_PX, step_px=STEP_PX)
    std = np.full_like(warps, STD_PX)
    return Field(at, at, warps, std, ones, ones.astype(np.int16), status, yes, "search", settings)


@pytest.fixture(scope="module", params=[False, True], ids=["raw", "calibrated"])
def rows(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, str]]:
    path: Path = tmp_path_factory.mktemp("csv") / "points.csv"
    write_csv(
        measure(field(), calibration() if request.param else None, StrainSettings(window_points=5)), path
    )
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_columns_of_strain_follow_those_of_the_displacements(rows: list[dict[str, str]]) -> None:
    names = list(rows[0])
    assert names[:6] == BEFORE
    strains = [*STRAIN_KEYS, "local_strain", "std_u_px", "std_v_px"]
    assert names[6:] in (strains, [*CALIBRATED, *strains])
    assert len(rows) == 49


def test_local_strain_is_that_of_the_motion_at_every_inner_point(rows: list[dict[str, str]]) -> None:
    """Principal strains by Mohr's circle: middle ± radius, turned by ½ atan(2 εxy / (εxx - εyy))."""
    middle, radius = (EXX + EYY) / 2, np.hypot((EXX - EYY) / 2, EXY)
    direction_deg = np.degrees(np.arctan2(EXY, (EXX - EYY) / 2)) / 2
    truth = {"exx": EXX, "eyy": EYY, "exy": EXY, "e1": middle + radius, "e2": middle - radius}
    inner = [row for row in rows if max(abs(int(row[axis]) - 60) for axis in ("x_px", "y_px")) <= 2 * STEP_PX]
    assert len(inner) == 25
    for row in inner:
        assert {name: float(row[name]) for name in truth} == pytest.approx(truth, abs=2e-9)
        assert float(row["direction_deg"]) == pytest.approx(direction_deg, abs=2e-5)


def test_local_strain_has_the_standard_deviation_of_a_plane_fitted_to_its_window(
    rows: list[dict[str, str]],
) -> None:
    """A slope over 5 × 5 points h apart has σ / (h √50); dE = sym(Fᵀ dF), the four errors independent."""
    slope_std = STD_PX / (STEP_PX * np.sqrt(50.0))
    F = stretched()
    middle = next(row for row in rows if row["x_px"] == row["y_px"] == "60")
    truth = {
        "exx_std": slope_std * np.hypot(F[0, 0], F[1, 0]),
        "eyy_std": slope_std * np.hypot(F[0, 1], F[1, 1]),
        "exy_std": slope_std * np.linalg.norm(F) / 2,
    }
    assert float(middle["std_u_px"]) == float(middle["std_v_px"]) == STD_PX
    # Nine digits behind the point; the bicubic map is exact to rounding, its derivative nearly so.
    assert {name: float(middle[name]) for name in truth} == pytest.approx(truth, rel=1e-5, abs=1e-9)


def test_point_that_failed_has_its_reason_and_no_strain(rows: list[dict[str, str]]) -> None:
    assert rows[0]["status"] == "low correlation"
    assert {rows[0][name] for name in ("u_px", "v_px", *STRAIN_KEYS)} == {""}


def test_decimal_commas_change_no_value(rows: list[dict[str, str]], tmp_path: Path) -> None:
    measured = measure(field(), calibration() if "X_mm" in rows[0] else None, StrainSettings(window_points=5))
    write_csv(measured, tmp_path / "comma.csv", decimal_comma=True)
    text = (tmp_path / "comma.csv").read_text(encoding="utf-8")
    assert "." not in text
    with (tmp_path / "comma.csv").open(encoding="utf-8", newline="") as file:
        again = list(csv.DictReader(file, delimiter=";"))
    assert [{name: cell.replace(",", ".") for name, cell in row.items()} for row in again] == rows


def test_corrected_local_strain_stands_beside_the_calibrated_one(tmp_path: Path) -> None:
    """A correction whose displacement is half of the measured one halves the displacement gradient."""
    measured = measure(field(), calibration())
    half = replace(measured.calibrated, vector=measured.calibrated.vector / 2)
    gradients = np.array([[EXX, EXY], [EXY, EYY]])
    C = np.eye(2) + 2 * gradients
    squares, axes = np.linalg.eigh(C)
    H = (axes @ np.diag(np.sqrt(squares)) @ axes.T - np.eye(2)) / 2
    expected = (H + H.T + H.T @ H) / 2
    correction = Correction(
        "tilt", measured.calibrated_mean, half, replace(measured.strain_settings, source="fit")
    )
    write_csv(measured, tmp_path / "points.csv", correction=correction)
    with (tmp_path / "points.csv").open(encoding="utf-8", newline="") as file:
        middle = next(row for row in csv.DictReader(file) if row["x_px"] == row["y_px"] == "60")
    found = [float(middle[f"corrected_{name}"]) for name in ("exx", "eyy", "exy")]
    assert found == pytest.approx([expected[0, 0], expected[1, 1], expected[0, 1]], abs=2e-9)
    assert float(middle["corrected_U_mm"]) == pytest.approx(float(middle["U_mm"]) / 2, abs=1e-7)
    assert float(middle["corrected_X_mm"]) == float(middle["X_mm"])
    write_csv(measured, tmp_path / "points.csv", correction=replace(correction, declined="too little"))
    assert "corrected" not in (tmp_path / "points.csv").read_text(encoding="utf-8")
