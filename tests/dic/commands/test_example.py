"""`dic example`: a measurement to try at once, whose true strains are known."""

import csv
import json
import runpy
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from simulators.scene.specimen import SpecimenSettings
from tests.command_line import refusal, run_dic

SCRIPT = Path(__file__).parents[3] / "examples" / "draw_series.py"


def test_the_files_belong_together(tmp_path):
    done = run_dic("example", tmp_path / "first")
    assert done.status == 0, done
    folder = tmp_path / "first"
    images = ["grid", "reference", "mask", *(f"step-{number:02}" for number in range(1, 17))]
    shapes = {cv2.imread(str(folder / f"{name}.png"), cv2.IMREAD_UNCHANGED).shape for name in images}
    assert len(shapes) == 1
    truth = json.loads((folder / "truth.json").read_text())
    with (folder / "machine.csv").open(newline="") as file:
        record = list(csv.DictReader(file))
    assert [row["image"] for row in record[1:]] == [step["image"] for step in truth["images"]]
    for row, step in zip(record[1:], truth["images"], strict=True):
        assert (folder / row["image"]).is_file()
        # five standard deviations of the load cell's noise
        assert abs(float(row["load_n"]) - step["load_n"]) < 10.0
    for command in ("dic quality", "dic calibrate", "dic correlate"):
        assert f"  {command} {folder}/" in done.out


def test_the_true_strains_are_those_of_the_virtual_specimen(tmp_path):
    assert run_dic("example", tmp_path).status == 0
    truth = json.loads((tmp_path / "truth.json").read_text())
    modulus, area_mm2 = truth["youngs_modulus_mpa"], truth["width_mm"] * truth["thickness_mm"]
    yield_mpa = SpecimenSettings().yield_stress_mpa
    exponent = SpecimenSettings().first_loading().exponent
    for step in truth["images"]:
        stress_mpa = step["load_n"] / area_mm2
        plastic = 0.002 * (stress_mpa / yield_mpa) ** exponent
        along = stress_mpa / modulus + plastic
        assert np.isclose(step["eyy"], along + along**2 / 2, atol=1e-8)


def test_existing_files_are_kept_unless_forced(tmp_path):
    assert run_dic("example", tmp_path).status == 0
    (tmp_path / "mask.png").write_bytes(b"mine")
    assert "--force" in refusal("example", tmp_path)
    assert (tmp_path / "mask.png").read_bytes() == b"mine"
    assert run_dic("example", tmp_path, "--force").status == 0
    assert (tmp_path / "mask.png").read_bytes() != b"mine"


def test_a_folder_that_is_a_file_is_refused(tmp_path):
    (tmp_path / "taken").write_bytes(b"")
    words = refusal("example", tmp_path / "taken")
    assert "taken" in words
    assert (tmp_path / "taken").read_bytes() == b""


@pytest.mark.long
def test_the_files_are_those_that_the_virtual_rig_draws(tmp_path, monkeypatch):
    """Pixels are compared, because another version of zlib writes other bytes for the same pixels."""
    kept, drawn = tmp_path / "kept", tmp_path / "drawn"
    drawn.mkdir()
    assert run_dic("example", kept).status == 0
    monkeypatch.setattr(sys, "argv", [str(SCRIPT), str(drawn)])
    runpy.run_path(str(SCRIPT), run_name="__main__")
    assert sorted(path.name for path in drawn.iterdir()) == sorted(path.name for path in kept.iterdir())
    for path in drawn.glob("*.png"):
        images = [cv2.imread(str(folder / path.name), cv2.IMREAD_UNCHANGED) for folder in (kept, drawn)]
        np.testing.assert_array_equal(*images, err_msg=path.name)
    for name in ("machine.csv", "truth.json", "known.json"):
        assert (drawn / name).read_text() == (kept / name).read_text()
