import csv
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from dic.calibration import Calibration
from dic.cli import main


@pytest.fixture
def dic(monkeypatch: pytest.MonkeyPatch) -> Callable[..., int]:
    """Run the command in this process; return its status."""

    def run(*arguments: object) -> int:
        monkeypatch.setattr(sys, "argv", ["dic", *map(str, arguments)])
        with pytest.raises(SystemExit) as exit_info:
            main()
        return int(exit_info.value.code or 0)

    return run


@pytest.fixture
def picture(tmp_path: Path, draw_grid: Callable[..., Any]) -> tuple[Path, Any]:
    drawn = draw_grid(pan_deg=30, roll_deg=5, noise=2)
    path = tmp_path / "grid.png"
    cv2.imwrite(str(path), drawn.image.astype(np.uint8))
    return path, drawn


def test_every_output_is_written_and_agrees(
    dic: Callable[..., int], picture: tuple[Path, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    image, drawn = picture
    outputs = [tmp_path / name for name in ("cal.h5", "points.csv", "cal.json", "cal.png")]
    options = [
        word for pair in zip(("-o", "--points", "--json", "--plot"), outputs, strict=True) for word in pair
    ]

    assert dic("calibrate", image, "--lines", "21x21", "--pitch-mm", 0.5, *options) == 0

    printed = capsys.readouterr().out
    summary = json.loads(outputs[2].read_text())
    calibration = Calibration.load(outputs[0])
    with outputs[1].open() as file:
        rows = list(csv.DictReader(file))
    assert "441 of 441 intersections" in printed
    assert f"{summary['rms_px']:.4f} px" in printed
    assert summary["found"] == len(rows) == calibration.grid.found == 441
    assert summary["rms_um"] == pytest.approx(calibration.rms_mm * 1000)
    assert list(rows[0]) == ["X_mm", "Y_mm", "u_px", "v_px"]
    mm = np.array([[float(row["X_mm"]), float(row["Y_mm"])] for row in rows])
    px = np.array([[float(row["u_px"]), float(row["v_px"])] for row in rows])
    order = [int(np.argmin(np.abs(drawn.xy_mm - point).sum(axis=1))) for point in mm]
    assert np.abs(px - drawn.uv_px[order]).max() < 0.1
    assert outputs[3].read_bytes().startswith(b"\x89PNG")


def test_the_area_is_that_of_the_grid_s_outline(
    dic: Callable[..., int], picture: tuple[Path, Any], tmp_path: Path
) -> None:
    image, drawn = picture
    dic("calibrate", image, "--json", tmp_path / "cal.json")
    corners = [[-5, -5], [5, -5], [5, 5], [-5, 5]]
    px = [drawn.uv_px[int(np.argmin(np.abs(drawn.xy_mm - corner).sum(axis=1)))] for corner in corners]

    area = json.loads((tmp_path / "cal.json").read_text())["area_px2"]
    assert area == pytest.approx(cv2.contourArea(np.array(px, np.float32)), rel=1e-3)


@pytest.mark.parametrize("arguments", [["--lines", "20x21"], ["--lines", "3x3"], ["--pitch-mm", "-1"]])
def test_a_wrong_grid_is_one_sentence_and_status_2(
    dic: Callable[..., int],
    picture: tuple[Path, Any],
    tmp_path: Path,
    arguments: list[str],
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert dic("calibrate", picture[0], *arguments, "-o", tmp_path / "cal.h5") == 2

    complaint = capsys.readouterr().err
    assert complaint.startswith("error: ")
    assert complaint.count("\n") == 1
    assert not (tmp_path / "cal.h5").exists()


def test_a_missing_image_is_one_sentence_and_status_2(
    dic: Callable[..., int], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert dic("calibrate", tmp_path / "absent.png") == 2
    assert capsys.readouterr().err.startswith(f"error: {tmp_path}/absent.png: read image")


def test_an_output_that_cannot_be_written_is_one_sentence_and_status_2(
    dic: Callable[..., int], picture: tuple[Path, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert dic("calibrate", picture[0], "--points", tmp_path / "absent" / "points.csv") == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize("pitch", ["0", "-1", "inf", "nan", "1e300", "1e-300"])
def test_a_pitch_that_is_no_length_is_refused(
    dic: Callable[..., int], picture: tuple[Path, Any], tmp_path: Path, pitch: str
) -> None:
    assert dic("calibrate", picture[0], f"--pitch-mm={pitch}", "-o", tmp_path / "cal.h5") == 2
    assert not (tmp_path / "cal.h5").exists()


@pytest.mark.parametrize("option", ["-o", "--points", "--plot", "--json"])
def test_the_image_is_never_overwritten(
    dic: Callable[..., int], picture: tuple[Path, Any], option: str, capsys: pytest.CaptureFixture[str]
) -> None:
    content = picture[0].read_bytes()
    assert dic("calibrate", picture[0], option, picture[0]) == 2
    assert "one that is read" in capsys.readouterr().err
    assert picture[0].read_bytes() == content


@pytest.mark.parametrize("lines", ["21", "21x", "axb", "21x21x21", "-4x5"])
def test_lines_that_are_no_numbers_are_refused(
    dic: Callable[..., int], tmp_path: Path, lines: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert dic("calibrate", tmp_path / "grid.png", f"--lines={lines}") == 2
    assert "such as 21x21" in capsys.readouterr().err


def test_assess_prints_the_paper_s_numbers_and_where_its_claim_fails(
    dic: Callable[..., int], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert dic("assess", "-o", tmp_path / "out", "--json", tmp_path / "assess.json") == 0

    printed = capsys.readouterr().out
    rows = json.loads((tmp_path / "assess.json").read_text())["rows"]
    base = next(r for r in rows if (r["sweep"], r["value"], r["grid"]) == ("pan", 30, "base"))
    assert base["maximum_px"] == pytest.approx(1.49e-2, abs=0.005e-2)
    assert base["figure"] == 2
    assert printed.count("does not hold") == 3
    assert "holds throughout" in printed
    figures = [f"figure_{number:02d}.png" for number in range(2, 15)]
    assert sorted(path.name for path in (tmp_path / "out").glob("*.png")) == [*figures, "overview.png"]
    assert len((tmp_path / "out" / "assessment.csv").read_text().splitlines()) == len(rows) + 1


def test_the_command_imports_nothing_heavy_before_it_must() -> None:
    heavy = ("numpy", "scipy", "cv2", "numba", "h5py", "matplotlib")
    program = f"import sys, dic.cli; print([name for name in {heavy} if name in sys.modules])"

    assert subprocess.run([sys.executable, "-c", program], capture_output=True, text=True).stdout == "[]\n"
