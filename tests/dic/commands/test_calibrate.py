"""`dic calibrate` with a grid of lines."""

import csv
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from dic.calibration.file import load_calibration
from tests.command_line import refusal, run_dic
from tests.image_files import write_image

pytestmark = pytest.mark.usefixtures("grids_found_once")


@pytest.fixture(scope="module")
def drawn_grid(draw_grid: Callable[..., Any]) -> Any:
    return draw_grid(pan_deg=30, roll_deg=5, noise=2)


@pytest.fixture
def picture(tmp_path: Path, drawn_grid: Any) -> tuple[Path, Any]:
    return write_image(tmp_path / "grid.png", drawn_grid.image), drawn_grid


def test_every_output_is_written_and_agrees(picture: tuple[Path, Any], tmp_path: Path) -> None:
    image, drawn = picture
    outputs = [tmp_path / name for name in ("cal.h5", "points.csv", "cal.json", "cal.png")]
    options = [
        word for pair in zip(("-o", "--points", "--json", "--plot"), outputs, strict=True) for word in pair
    ]

    done = run_dic("calibrate", image, "--lines", "21x21", "--pitch-mm", 0.5, *options)
    assert done.status == 0
    printed, summary = done.out, done.report
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


def test_the_area_is_that_of_the_grid_s_outline(picture: tuple[Path, Any], tmp_path: Path) -> None:
    image, drawn = picture
    area = run_dic("calibrate", image, "--json", tmp_path / "cal.json").report["area_px2"]
    corners = [[-5, -5], [5, -5], [5, 5], [-5, 5]]
    px = [drawn.uv_px[int(np.argmin(np.abs(drawn.xy_mm - corner).sum(axis=1)))] for corner in corners]

    assert area == pytest.approx(cv2.contourArea(np.array(px, np.float32)), rel=1e-3)


@pytest.mark.parametrize(
    ("x_axis", "turn_deg"), [("up", 90.0), pytest.param("-90", -90.0, marks=pytest.mark.extended)]
)
def test_x_points_the_way_it_is_told(
    picture: tuple[Path, Any], tmp_path: Path, x_axis: str, turn_deg: float
) -> None:
    places = [f"--x-axis={x_axis}", "--grid-made", "exact", "-o", tmp_path / "cal.h5"]
    done = run_dic("calibrate", picture[0], *places)
    assert done.status == 0
    grid = load_calibration(tmp_path / "cal.h5").grid
    c, s = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    order = [int(np.argmin(np.abs(picture[1].uv_px - px).sum(axis=1))) for px in grid.uv_px]

    assert grid.orientation == "option"
    # coordinates in axes turned by the angle
    assert grid.xy_mm == pytest.approx(picture[1].xy_mm[order] @ np.array([[c, -s], [s, c]]), abs=1e-9)


def test_a_direction_that_is_none_is_refused(picture: tuple[Path, Any]) -> None:
    assert "north" in refusal("calibrate", picture[0], "--x-axis", "north")


def test_both_models_are_printed_side_by_side_with_the_camera_and_the_recommendation(
    picture: tuple[Path, Any], tmp_path: Path
) -> None:
    done = run_dic("calibrate", picture[0], "--json", tmp_path / "cal.json")
    assert done.status == 0
    printed, summary = done.out, done.report
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


@pytest.mark.parametrize(
    ("asked", "used"),
    [pytest.param("bicubic", "bicubic", marks=pytest.mark.extended), ("pinhole", "pinhole")],
)
def test_the_model_that_is_asked_for_is_the_one_that_is_saved(
    picture: tuple[Path, Any], tmp_path: Path, asked: str, used: str
) -> None:
    summary = run_dic(
        "calibrate", picture[0], "--model", asked, "-o", tmp_path / "cal.h5", "--json", tmp_path / "cal.json"
    ).report

    assert load_calibration(tmp_path / "cal.h5").model == summary["model"] == used
    assert summary["rms_px"] == summary["models"][used]["rms_px"]


def test_the_recommended_model_is_the_pinhole_where_the_lens_bends(
    draw_grid: Callable[..., Any], tmp_path: Path
) -> None:
    drawn = draw_grid(pan_deg=20, k1_per_px2=-3e-7, noise=2)
    cv2.imwrite(str(tmp_path / "grid.png"), drawn.image.astype(np.uint8))
    summary = run_dic(
        "calibrate", tmp_path / "grid.png", "--model", "recommended", "--json", tmp_path / "cal.json"
    ).report
    assert summary["model"] == "pinhole"
    assert summary["models"]["pinhole"]["left_out_px"] < 0.7 * summary["models"]["bicubic"]["left_out_px"]
    assert summary["camera"]["distortion"]["k1"] == pytest.approx(-3e-7, rel=0.02)


def _straight(draw_grid: Callable[..., Any], path: Path, **view: float) -> Path:
    return write_image(path, draw_grid(**view).image)


def test_a_camera_that_looks_straight_says_what_it_needs_and_takes_it(
    draw_grid: Callable[..., Any], tmp_path: Path
) -> None:
    image = _straight(draw_grid, tmp_path / "grid.png")

    done = run_dic("calibrate", image)
    assert done.status == 0
    assert "the focal length is uncertain by" in done.out

    known = ["--distance-mm", 40, "--distance-std-mm", 0.4, "--principal-px", 224.8, 224.3]
    done = run_dic("calibrate", image, *known, "--json", tmp_path / "cal.json")
    assert done.status == 0
    assert "the focal length is uncertain by" not in done.out
    camera = done.report["camera"]
    assert camera["focal_px"] == pytest.approx(1400, rel=0.01)
    assert camera["centre_std_mm"][2] == pytest.approx(0.4, rel=0.05)
    assert camera["principal_px"] == pytest.approx([224.8, 224.3], abs=1e-3)


@pytest.mark.extended
def test_more_images_of_the_tilted_grid_tell_the_focal_length(
    draw_grid: Callable[..., Any], tmp_path: Path
) -> None:
    views = [{}, {"pan_deg": 20.0}, {"tilt_deg": -20.0}]
    images = [_straight(draw_grid, tmp_path / f"grid{k}.png", **view) for k, view in enumerate(views)]

    done = run_dic("calibrate", *images, "--json", tmp_path / "cal.json")
    assert done.status == 0
    assert "camera from 3 images" in done.out
    camera = done.report["camera"]
    assert camera["focal_std_px"] < 0.02 * 1400
    assert abs(camera["focal_px"] - 1400) < 3 * camera["focal_std_px"] + 5


def test_images_of_different_cameras_are_refused(draw_grid: Callable[..., Any], tmp_path: Path) -> None:
    first = _straight(draw_grid, tmp_path / "one.png")
    cv2.imwrite(str(tmp_path / "two.png"), cv2.imread(str(first))[:-1])

    assert "two.png: calibrate: expected images by one camera" in refusal(
        "calibrate", first, tmp_path / "two.png"
    )


@pytest.mark.parametrize(
    "known", [["--focal-px", "-1"], ["--distance-mm", "nan"], ["--focal-std-px", "3"], ["--model", "best"]]
)
def test_what_no_camera_has_is_refused(picture: tuple[Path, Any], known: list[str]) -> None:
    assert "Traceback" not in refusal("calibrate", picture[0], *known)


@pytest.mark.parametrize("arguments", [["--lines", "20x21"], ["--lines", "3x3"], ["--pitch-mm", "-1"]])
def test_a_wrong_grid_is_one_sentence_and_status_2(
    picture: tuple[Path, Any],
    tmp_path: Path,
    arguments: list[str],
) -> None:
    refusal("calibrate", picture[0], *arguments, "-o", tmp_path / "cal.h5")
    assert not (tmp_path / "cal.h5").exists()


def test_a_missing_image_is_one_sentence_and_status_2(tmp_path: Path) -> None:
    assert refusal("calibrate", tmp_path / "absent.png").startswith(
        f"error: {tmp_path}/absent.png: read image"
    )


def test_an_output_that_cannot_be_written_is_one_sentence_and_status_2(
    picture: tuple[Path, Any], tmp_path: Path
) -> None:
    assert "absent" in refusal("calibrate", picture[0], "--points", tmp_path / "absent" / "points.csv")


@pytest.mark.parametrize("pitch", ["0", "-1", "inf", "nan", "1e300", "1e-300"])
def test_a_pitch_that_is_no_length_is_refused(picture: tuple[Path, Any], tmp_path: Path, pitch: str) -> None:
    assert "pitch" in refusal("calibrate", picture[0], f"--pitch-mm={pitch}", "-o", tmp_path / "cal.h5")
    assert not (tmp_path / "cal.h5").exists()


@pytest.mark.parametrize("option", ["-o", "--points", "--plot", "--json"])
def test_the_image_is_never_overwritten(picture: tuple[Path, Any], option: str) -> None:
    content = picture[0].read_bytes()
    assert "one that is read" in refusal("calibrate", picture[0], option, picture[0])
    assert picture[0].read_bytes() == content


@pytest.mark.parametrize("lines", ["21", "21x", "axb", "21x21x21", "-4x5"])
def test_lines_that_are_no_numbers_are_refused(tmp_path: Path, lines: str) -> None:
    assert "such as 21x21" in refusal("calibrate", tmp_path / "grid.png", f"--lines={lines}")
