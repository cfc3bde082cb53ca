import csv
import json
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from dic.calibration.file import load_calibration
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
    calibration = load_calibration(outputs[0])
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


@pytest.mark.parametrize(("x_axis", "turn_deg"), [("up", 90.0), ("-90", -90.0)])
def test_x_points_the_way_it_is_told(
    dic: Callable[..., int], picture: tuple[Path, Any], tmp_path: Path, x_axis: str, turn_deg: float
) -> None:
    assert dic("calibrate", picture[0], f"--x-axis={x_axis}", "-o", tmp_path / "cal.h5") == 0
    grid = load_calibration(tmp_path / "cal.h5").grid
    c, s = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    order = [int(np.argmin(np.abs(picture[1].uv_px - px).sum(axis=1))) for px in grid.uv_px]

    assert grid.orientation == "option"
    # coordinates in axes turned by the angle
    assert grid.xy_mm == pytest.approx(picture[1].xy_mm[order] @ np.array([[c, -s], [s, c]]), abs=1e-9)


def test_a_direction_that_is_none_is_refused(
    dic: Callable[..., int], picture: tuple[Path, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    assert dic("calibrate", picture[0], "--x-axis", "north") == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_both_models_are_printed_side_by_side_with_the_camera_and_the_recommendation(
    dic: Callable[..., int], picture: tuple[Path, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert dic("calibrate", picture[0], "--json", tmp_path / "cal.json") == 0

    printed = capsys.readouterr().out
    summary = json.loads((tmp_path / "cal.json").read_text())
    camera = summary["camera"]
    for model in ("bicubic", "pinhole"):
        for name in ("rms_px", "max_px", "left_out_px"):
            assert f"{summary['models'][model][name]:.4f} px" in printed
    assert summary["recommendation"] in printed
    assert summary["model"] == "bicubic"
    # the picture's camera: f = 1400 px, 40 mm away, 30° to the left of a grid turned by 5°
    assert abs(camera["focal_px"] - 1400) < 3 * camera["focal_std_px"]
    assert camera["off_axis_deg"] == pytest.approx(30, abs=0.05)
    off_axis = re.search(r"off-axis +(\S+) ± (\S+)°", printed)
    assert off_axis is not None
    assert float(off_axis[1]) == pytest.approx(camera["off_axis_deg"], abs=float(off_axis[2]))
    assert abs(camera["distance_mm"] - 40) < 3 * max(camera["centre_std_mm"])


@pytest.mark.parametrize(("asked", "used"), [("bicubic", "bicubic"), ("pinhole", "pinhole")])
def test_the_model_that_is_asked_for_is_the_one_that_is_saved(
    dic: Callable[..., int], picture: tuple[Path, Any], tmp_path: Path, asked: str, used: str
) -> None:
    dic("calibrate", picture[0], "--model", asked, "-o", tmp_path / "cal.h5", "--json", tmp_path / "cal.json")
    summary = json.loads((tmp_path / "cal.json").read_text())

    assert load_calibration(tmp_path / "cal.h5").model == summary["model"] == used
    assert summary["rms_px"] == summary["models"][used]["rms_px"]


def test_the_recommended_model_is_the_pinhole_where_the_lens_bends(
    dic: Callable[..., int], draw_grid: Callable[..., Any], tmp_path: Path
) -> None:
    drawn = draw_grid(pan_deg=20, k1_per_px2=-3e-7, noise=2)
    cv2.imwrite(str(tmp_path / "grid.png"), drawn.image.astype(np.uint8))
    dic("calibrate", tmp_path / "grid.png", "--model", "recommended", "--json", tmp_path / "cal.json")

    summary = json.loads((tmp_path / "cal.json").read_text())
    assert summary["model"] == "pinhole"
    assert summary["models"]["pinhole"]["left_out_px"] < 0.7 * summary["models"]["bicubic"]["left_out_px"]
    assert summary["camera"]["distortion"]["k1"] == pytest.approx(-3e-7, rel=0.02)


def _straight(draw_grid: Callable[..., Any], path: Path, **view: float) -> Path:
    cv2.imwrite(str(path), draw_grid(**view).image.astype(np.uint8))
    return path


def test_a_camera_that_looks_straight_says_what_it_needs_and_takes_it(
    dic: Callable[..., int], draw_grid: Callable[..., Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    image = _straight(draw_grid, tmp_path / "grid.png")

    assert dic("calibrate", image) == 0
    assert "the focal length is open by" in capsys.readouterr().out

    known = ["--distance-mm", 40, "--distance-std-mm", 0.4, "--principal-px", 224.8, 224.3]
    assert dic("calibrate", image, *known, "--json", tmp_path / "cal.json") == 0
    assert "the focal length is open by" not in capsys.readouterr().out
    camera = json.loads((tmp_path / "cal.json").read_text())["camera"]
    assert camera["focal_px"] == pytest.approx(1400, rel=0.01)
    assert camera["centre_std_mm"][2] == pytest.approx(0.4, rel=0.05)
    assert camera["principal_px"] == pytest.approx([224.8, 224.3], abs=1e-3)


def test_more_images_of_the_tilted_grid_tell_the_focal_length(
    dic: Callable[..., int], draw_grid: Callable[..., Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    views = [{}, {"pan_deg": 20.0}, {"tilt_deg": -20.0}]
    images = [_straight(draw_grid, tmp_path / f"grid{k}.png", **view) for k, view in enumerate(views)]

    assert dic("calibrate", *images, "--json", tmp_path / "cal.json") == 0
    assert "camera from 3 images" in capsys.readouterr().out
    camera = json.loads((tmp_path / "cal.json").read_text())["camera"]
    assert camera["focal_std_px"] < 0.02 * 1400
    assert abs(camera["focal_px"] - 1400) < 3 * camera["focal_std_px"] + 5


def test_images_of_different_cameras_are_refused(
    dic: Callable[..., int], draw_grid: Callable[..., Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first = _straight(draw_grid, tmp_path / "one.png")
    cv2.imwrite(str(tmp_path / "two.png"), cv2.imread(str(first))[:-1])

    assert dic("calibrate", first, tmp_path / "two.png") == 2
    assert "two.png: calibrate: expected images by one camera" in capsys.readouterr().err


@pytest.mark.parametrize(
    "known", [["--focal-px", "-1"], ["--distance-mm", "nan"], ["--focal-std-px", "3"], ["--model", "best"]]
)
def test_what_no_camera_has_is_refused(
    dic: Callable[..., int], picture: tuple[Path, Any], known: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert dic("calibrate", picture[0], *known) == 2
    assert "Traceback" not in capsys.readouterr().err


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
    models = json.loads((tmp_path / "assess.json").read_text())["models"]
    # exact points of a pinhole leave nothing to a pinhole; noise leaves it 12 of its 882 degrees of freedom
    assert all(row["exact_px"]["pinhole"] < 1e-6 for row in models)
    assert all(row["noisy_px"]["pinhole"] < 0.01 * np.sqrt(2 * 12 / 882) * 1.3 for row in models)
    assert models[-1]["exact_px"]["bicubic"] > 0.02
    assert f"{models[-1]['noisy_px']['bicubic']:.2e}" in printed
    figures = [f"figure_{number:02d}.png" for number in range(2, 15)]
    assert sorted(path.name for path in (tmp_path / "out").glob("*.png")) == [*figures, "overview.png"]
    assert len((tmp_path / "out" / "assessment.csv").read_text().splitlines()) == len(rows) + 1


def test_the_command_imports_nothing_heavy_before_it_must() -> None:
    heavy = ("numpy", "scipy", "cv2", "numba", "h5py", "matplotlib")
    program = f"import sys, dic.cli; print([name for name in {heavy} if name in sys.modules])"

    assert subprocess.run([sys.executable, "-c", program], capture_output=True, text=True).stdout == "[]\n"


SQUARES, SIDE_PX, MARGIN_PX = (10, 7), 48, 60


def board(folder: Path) -> Path:
    """A checkerboard seen straight on: corner (i, j) from the lower left lies at known pixels."""
    columns, rows = SQUARES
    dark = (np.add.outer(np.arange(rows), np.arange(columns)) + rows - 1) % 2 == 0
    squares = np.where(np.kron(dark, np.ones((SIDE_PX, SIDE_PX), bool)), 40, 220).astype(np.uint8)
    picture = np.pad(squares, MARGIN_PX, constant_values=220)
    path = folder / "board.png"
    assert cv2.imwrite(str(path), cv2.GaussianBlur(picture, (0, 0), 1.0))
    return path


def test_a_checkerboard_is_named_by_its_squares(dic: Callable[..., int], tmp_path: Path) -> None:
    points = tmp_path / "points.csv"
    assert dic("calibrate", board(tmp_path), "--squares", "10x7", "--pitch-mm", 2, "--points", points) == 0
    X_mm, Y_mm, u_px, v_px = np.loadtxt(points, delimiter=",", skiprows=1).T
    assert len(X_mm) == 9 * 6
    # A corner lies between pixels, half a pixel before the first one of its square.
    np.testing.assert_allclose(u_px, MARGIN_PX - 0.5 + (X_mm / 2 + 5) * SIDE_PX, atol=0.02)
    np.testing.assert_allclose(v_px, MARGIN_PX - 0.5 + (3.5 - Y_mm / 2) * SIDE_PX, atol=0.02)


def test_a_charuco_board_and_dots_are_named_by_theirs(dic: Callable[..., int], tmp_path: Path) -> None:
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    charuco = cv2.aruco.CharucoBoard((8, 6), 1.0, 0.7, dictionary).generateImage((800, 600), marginSize=40)
    lattice = np.full((600, 800), 220, np.uint8)
    for x in range(9):
        for y in range(7):
            cv2.circle(lattice, (100 + 70 * x, 90 + 70 * y), 20, 40, -1, cv2.LINE_AA)
    for name, picture, options, expected in (
        ("charuco", charuco, ("--squares", "8x6", "--marker-mm", 0.35), 7 * 5),
        ("dots", lattice, ("--dots", "9x7"), 9 * 7),
    ):
        path, report = tmp_path / f"{name}.png", tmp_path / f"{name}.json"
        assert cv2.imwrite(str(path), cv2.GaussianBlur(picture, (0, 0), 1.0))
        assert dic("calibrate", path, *options, "--json", report) == 0
        assert json.loads(report.read_text())["found"] == expected


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (("--squares", "10x7", "--dots", "9x7"), "got --squares and --dots"),
        (("--marker-mm", "0.3"), "name the board's squares"),
        (("--squares", "10x7", "--origin-px", 1, 1), "leave out --origin-px"),
    ],
)
def test_targets_that_make_no_sense_are_refused(
    dic: Callable[..., int],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    options: tuple[object, ...],
    sentence: str,
) -> None:
    assert dic("calibrate", board(tmp_path), *options) == 2
    assert sentence in capsys.readouterr().err
