"""Tests of the options of `dic correlate` for maps and contact sheets."""

import re

import cv2
import h5py
import numpy as np
import pytest

import dic
from tests.command_line import refusal, run_dic
from tests.image_files import write_image


@pytest.fixture(scope="module")
def folder(speckle, tmp_path_factory):
    """A folder with ref.png, with moved.png after a strain of 10 000 µε along x, and with still.png."""
    folder = tmp_path_factory.mktemp("images")
    pattern = speckle(seed=21)
    moved = pattern.draw(lambda x, y: ((x - 2.4) / 1.01, y + 1.3))
    for name, image in (("ref", pattern.draw()), ("moved", moved), ("still", pattern.draw())):
        write_image(folder / f"{name}.png", image)
    return folder


def test_maps_are_drawn_as_the_options_say(folder, tmp_path):
    result = run_dic(
        "correlate", folder / "ref.png", folder / "moved.png", folder / "still.png", "--step", 20,
        "--maps", tmp_path / "maps", "--map-format", "svg", "--map-on", "deformed", "--map-quantities", "exx",
        "--map-limits", "exx=0,12000", "--map-colours", "cividis", "--map-width-mm", 90,
        "--contact-sheet", f"exx={tmp_path / 'sheet.png'}",
    )  # fmt: skip
    assert result.status == 0, result
    for name in ("moved", "still"):
        drawn = (tmp_path / "maps" / f"{name}.svg").read_text()
        width_pt = float(re.search(r'<svg[^>]* width="([\d.]+)pt"', drawn)[1])
        assert width_pt == pytest.approx(90 / 25.4 * 72, abs=0.1)
    assert cv2.imread(str(tmp_path / "sheet.png")).shape[1] == pytest.approx(90 / 25.4 * 150, abs=1)


def test_mistakes_in_options_of_maps_are_reported_together(folder, tmp_path):
    words = refusal(
        "correlate", folder / "ref.png", folder / "moved.png", "--maps", tmp_path / "maps",
        "--map-on", "moved",
        "--map-format", "gif", "--map-limits", "exx=1", "--contact-sheet", "ezz=a.png",
        "--map-colours", "jet",
    )  # fmt: skip
    for name in ("image under maps", "format of maps", "limits of maps", "contact sheet", "colours of maps"):
        assert f"settings: {name}: expected" in words
    assert not (tmp_path / "maps").exists()


@pytest.mark.parametrize("scale", ["series", "image"])
def test_results_are_complete_although_no_picture_can_be_drawn(folder, tmp_path, monkeypatch, scale):
    def full(*_):
        raise OSError(28, "No space left on device", "picture")

    monkeypatch.setattr("dic.pictures.maps.MapDrawer.draw", full)
    words = refusal(
        "correlate", folder / "ref.png", folder / "moved.png", "--step", 40, "-o", tmp_path / "r.h5",
        "--json", tmp_path / "r.json", "--csv", tmp_path / "csv", "--maps", tmp_path / "maps",
        "--map-scale", scale,
    )  # fmt: skip
    assert "No space left" in words
    with h5py.File(tmp_path / "r.h5") as file:
        assert file["series/label"].shape == (1,)
    assert (tmp_path / "r.json").is_file()
    assert (tmp_path / "csv" / "strain.csv").is_file()


@pytest.fixture(scope="module")
def calibration(tmp_path_factory):
    """A calibration file of an on-axis camera with 10 px/mm."""
    index = np.stack(np.meshgrid(np.arange(19), np.arange(17)), axis=-1).reshape(-1, 2)
    grid = dic.targets.GridPoints.on_lattice(index, index * [10.0, -10.0] + [0.0, 160.0], (19, 17), 1.0)
    path = tmp_path_factory.mktemp("calibration") / "cal.h5"
    dic.save_calibration(dic.Calibration.fit(grid, (160, 180)), path)
    return path


@pytest.mark.parametrize("scale", ["series", pytest.param("image", marks=pytest.mark.extended)])
def test_a_point_that_cannot_be_drawn_in_mm_costs_no_results(folder, tmp_path, calibration, scale):
    images = folder / "ref.png", folder / "moved.png", folder / "still.png"
    command = "correlate", *images, "--step", 1000, "--calibration", calibration, "--map-scale", scale
    small = "--map-quantities", "u", "--map-dpi", 40

    def outputs(name):
        place = tmp_path / name
        place.mkdir()
        return "-o", place / "r.h5", "--json", place / "r.json", "--maps", place, *small

    drawn = run_dic(*command, *outputs("auto"))
    assert drawn.status == 1, drawn
    refused = run_dic(*command, *outputs("mm"), "--map-axes", "mm")
    assert refused.status == 2, refused
    sentence = f"{images[1]}: draw axes in mm: expected at least four points, all but one of which are not on"
    assert refused.err.splitlines()[-1].startswith(f"error: {sentence}")
    assert sorted(path.name for path in (tmp_path / "auto").iterdir()) == [
        "moved.png", "r.h5", "r.json", "still.png",
    ]  # fmt: skip
    for name in ("auto", "mm"):
        with h5py.File(tmp_path / name / "r.h5") as file:
            assert file["series/label"].shape == (2,)
    assert refused.report["images"] == drawn.report["images"]


def test_a_contact_sheet_has_the_axes_that_were_asked_for(folder, tmp_path, calibration):
    """Axes in px show the whole image, axes in mm the points and a margin around them."""
    command = (
        "correlate",
        folder / "ref.png",
        folder / "still.png",
        "--step",
        40,
        "--calibration",
        calibration,
    )
    shapes = {}
    for axes in ("px", "mm"):
        sheet = tmp_path / f"{axes}.png"
        assert (
            run_dic(*command, "--contact-sheet", f"u={sheet}", "--map-axes", axes, "--map-dpi", 40).status
            == 0
        )
        shapes[axes] = cv2.imread(str(sheet)).shape
    assert shapes["px"] != shapes["mm"]


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--contact-sheet", "eyy=sheet.xyz"], "contact sheet: expected QUANTITY=FILE"),
        (["--contact-sheet", "eyy=a.png", "--contact-sheet", "eyy=b.png"], "at most once"),
        (["--maps", "m", "--map-width-mm", "2000", "--map-dpi", "1200"], "width and resolution of maps"),
        (["--maps", "m", "--map-axes", "mm"], "expected a calibration for axes in mm"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_pictures_that_cannot_be_drawn_are_refused_before_measuring(
    folder, options, sentence, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    words = refusal("correlate", folder / "ref.png", folder / "moved.png", *options)
    assert sentence in words
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (
            ["--map-format", "pdf", "--contact-sheet", "eyy=a.png"],
            "give --maps, or leave out --map-format",
        ),
        (
            ["--map-on", "deformed", "--map-dpi", "300"],
            "--map-on, --map-dpi: expected --maps beside it",
        ),
        (
            ["--map-on", "deformed", "--map-scale", "image", "--contact-sheet", "u=a.png"],
            "--map-on, --map-scale: expected --maps beside it",
        ),
        (["--map-axes", "px"], "--map-axes: expected --maps or --contact-sheet"),
    ],
)
def test_options_without_an_effect_are_refused_with_one_that_gives_them_an_effect(
    folder, tmp_path, monkeypatch, arguments, sentence
):
    monkeypatch.chdir(tmp_path)
    assert sentence in refusal("correlate", folder / "ref.png", folder / "moved.png", *arguments)
