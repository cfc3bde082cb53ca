"""Results of other programs are compared with a measurement of the same motion."""

import json
from pathlib import Path

import numpy as np
import pytest

import dic
from dic.comparison.difference import compare
from dic.correlation.field import Field
from dic.correlation.settings import CorrelationSettings
from dic.strain.measurement import measure
from tests.command_line import refusal, run_dic
from tests.conftest import SpecklePattern
from tests.dic.comparison.peer_files import (
    GRADIENT,
    OFFSET,
    SHIFT,
    SMALL,
    STRAIN,
    points,
    write_dice,
    write_ncorr,
    write_ncorr_73,
    write_opencorr,
)  # fmt: skip
from tests.image_files import write_image

DICE = Path(__file__).with_name("dice_ohtcfrp_11.txt")
WRITERS = {
    "DICe": write_dice, "OpenCorr": write_opencorr, "Ncorr": write_ncorr, "Ncorr 7.3": write_ncorr_73,
}  # fmt: skip


def measurement(region=None):
    """Return a measurement with points every 10 px from 30 to 80 px, and with the exact displacements."""
    at = np.arange(30, 81, 10)
    x, y = np.meshgrid(at, at)
    warps = np.zeros((6, 6, 6))
    for k in range(2):
        warps[..., 3 * k] = SHIFT[k] + GRADIENT[k, 0] * x + GRADIENT[k, 1] * y
        warps[..., 3 * k + 1 : 3 * k + 3] = GRADIENT[k]
    ones, yes, status = np.ones((6, 6)), np.ones((6, 6), bool), np.zeros((6, 6), np.int8)
    settings = CorrelationSettings(subset_px=11, step_px=10)
    std = np.full_like(warps, 0.01)
    return measure(
        Field(at, at, warps, std, ones, ones.astype(np.int16), status, yes, "search", settings, region=region)
    )


@pytest.mark.parametrize("program", WRITERS)
def test_each_program_differs_by_what_it_measures_too_much_and_by_nothing_else(program, tmp_path):
    path = WRITERS[program](tmp_path / "peer")
    peer = dic.comparison.read_peer(path, number=2 if program.startswith("Ncorr") else 1)
    assert peer.program == program.split()[0]
    found = compare(measurement(), peer)
    assert found.common == (64 if program.startswith("Ncorr") else 9)
    assert len(peer) - found.common == (0 if program.startswith("Ncorr") else 1)
    for name, offset in zip(("u_px", "v_px"), OFFSET, strict=True):
        values = found.differences[name].as_dict()
        for key in ("mean", "median", "quantile_05", "quantile_95"):
            assert values[key] == pytest.approx(-offset, abs=1e-8)
        assert values["rms"] == pytest.approx(abs(offset), abs=1e-8)
        assert values["std"] == pytest.approx(0.0, abs=1e-8)
    # The strain is compared in the program's own measure, and shear in axes with y upwards.
    truth = SMALL if program == "OpenCorr" else STRAIN
    assert peer.strains["exy"][0] == pytest.approx(-truth[0, 1], abs=1e-9)
    for name in ("exx", "eyy", "exy"):
        values = found.differences[name].as_dict()
        assert values["points"] > 0
        assert values["largest"] < 1e-8


def test_statistics_are_those_of_the_differences():
    ours, peer = np.array([1.0, 2.0, 4.0, np.nan, 9.0]), np.array([0.0, 0.0, 0.0, 0.0, np.nan])
    difference = dic.comparison.Difference("u_px", ours, peer)
    expected = {"points": 3, "mean": 7 / 3, "rms": np.sqrt(7.0), "std": np.sqrt(14) / 3, "median": 2.0}
    expected |= {"quantile_05": 1.1, "quantile_95": 3.8, "largest": 4.0}
    assert difference.as_dict() == pytest.approx(expected)


def test_ncorr_file_of_one_image_and_texts_with_spaces_are_read(tmp_path):
    for write in (write_ncorr, write_ncorr_73):
        assert len(dic.comparison.read_peer(write(tmp_path / "one.mat", images=1))) == 64
    assert len(dic.comparison.read_peer(write_dice(tmp_path / "spaces.txt", " "))) == len(points()[0])
    assert dic.comparison.read_peer(tmp_path / "spaces.txt").image == "images/def.tif"


def test_gap_in_the_region_is_not_interpolated(tmp_path):
    """A slit one pixel wide, from the left edge to the right, between two rows of points."""
    region = np.ones((100, 100), bool)
    region[65] = False
    peer = dic.comparison.read_peer(write_dice(tmp_path / "dice.txt"))
    found = compare(measurement(region), peer).differences["u_px"].values
    y = peer.points_px[:, 1]
    assert np.isfinite(found[y < 60]).sum() == 6
    # 71.25 lies between the rows 70 and 80, below the slit.
    assert np.isfinite(found[y > 70]).sum() == 3
    shifted = dic.comparison.PeerField(
        "DICe", "", peer.points_px - [0.0, 8.0], peer.u_px, peer.v_px, {}, "green-lagrange"
    )
    found = compare(measurement(region), shifted).differences["u_px"].values
    assert np.isnan(found[shifted.points_px[:, 1] == 63.25]).all()


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """The result file of two images; the second shows the motion of `peer_files` without its `OFFSET`."""
    folder = tmp_path_factory.mktemp("results")
    pattern = SpecklePattern(seed=3)
    back = np.linalg.inv(np.eye(2) + GRADIENT)

    def moved(x, y):
        return tuple(np.einsum("ij,j...->i...", back, np.stack([x - SHIFT[0], y - SHIFT[1]])))

    write_image(folder / "ref.png", pattern.draw())
    for name in ("a", "b"):
        write_image(folder / f"{name}.png", pattern.draw(moved if name == "b" else lambda x, y: (x, y)))
    files = [folder / f"{name}.png" for name in ("ref", "a", "b")]
    assert run_dic("correlate", *files, "--subset", 31, "--step", 10, "-o", folder / "r.h5").status == 0
    return folder / "r.h5"


def test_command_prints_and_writes_the_difference_of_the_chosen_image(results, tmp_path):
    peer = write_dice(tmp_path / "dice.txt")
    places = "--picture", tmp_path / "difference.png", "--json", tmp_path / "difference.json"
    done = run_dic("compare", results, peer, "--image", 2, *places)
    assert done.status == 0, done
    report = json.loads((tmp_path / "difference.json").read_text())
    assert (report["program"], report["common_points"], report["peer_points"]) == ("DICe", 9, 10)
    for name, offset in zip(("u_px", "v_px"), OFFSET, strict=True):
        # The images are in 8 bits and have no other noise.
        assert report["differences"][name]["mean"] == pytest.approx(-offset, abs=0.005)
    assert "offaxis - DICe: 9 of 10 points (90.0 %)" in done.out
    assert (tmp_path / "difference.png").read_bytes().startswith(b"\x89PNG")
    assert "--force" in refusal("compare", results, peer, "--image", 2, *places)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda path: path.unlink(), "expected a file that can be read, got No such file"),
        (lambda path: path.write_bytes(b"\x89PNG\r\n\x1a\n\xff\xfe"), "a file that is no text"),
        (lambda path: path.write_text("a,b\n1,2\n"), "columns of DICe or OpenCorr"),
        (lambda path: path.write_text("x,y,u,zncc\n1,2,3,1\n"), "expected the column v"),
        (lambda path: path.write_text("x,y,u,v\n1,2,3\n"), "expected 4 cells in each line, got 3 in line 1"),
        (lambda path: path.write_text("x,y,u,v\n1,2,3,four\n"), "expected numbers below the names"),
        (lambda path: path.write_text("x,y,u,v\n"), "a line of names and lines of numbers, got 1"),
        (lambda path: path.write_text("x,y,u,v,zncc\n1,2,3,4,-1\n"), "one point with a displacement"),
        (lambda path: path.write_text("x,y,u,v\n900,2,3,4\n"), "points of the measured region, got none"),
        (lambda path: write_dice(path, heading="*** Incremental correlation: true"), "since the reference"),
        (lambda path: path.write_bytes(b"MATLAB 5.0 MAT-file" + 200 * b"\0"), "file with data_dic_save"),
        (lambda path: write_ncorr_73(path, lens=1e-9), "got displacements corrected for a lens (1e-09)"),
        (lambda path: write_ncorr(path, lens=1e-9), "format the displacements in Ncorr with the lens coeff"),
        (lambda path: write_ncorr_73(path, formatted=False), "formatted displacements, got none"),
        (lambda path: write_ncorr_73(path).write_bytes(path.read_bytes()[:4000]), "a MATLAB file with data"),
        (lambda path: write_ncorr(path).write_bytes(path.read_bytes()[:900]), "file with data_dic_save"),
    ],
)  # fmt: skip
def test_bad_files_end_with_one_sentence(results, tmp_path, change, words):
    path = write_dice(tmp_path / "peer")
    change(path)
    assert words in refusal("compare", results, path, "--image", 2)


@pytest.mark.parametrize("write", [write_ncorr, write_ncorr_73])
def test_image_that_is_not_there_ends_with_one_sentence(results, tmp_path, write):
    peer = write(tmp_path / "peer.mat")
    said = refusal("compare", results, peer)
    assert f"{results}: choose an image: expected a number from 1 to 2, got none" in said
    assert "expected a number from 1 to 2, got 3" in refusal("compare", results, peer, "--image", 3)
    assert "expected an image from 1 to 2, got 5" in refusal(
        "compare", results, peer, "--image", 2, "--peer-image", 5
    )
    dice = write_dice(tmp_path / "dice.txt")
    assert "leave out --peer-image" in refusal("compare", results, dice, "--image", 2, "--peer-image", 2)


@pytest.mark.parametrize("write", [write_dice, write_ncorr])
def test_strain_measure_is_chosen_only_for_a_file_that_does_not_fix_it(results, tmp_path, write):
    words = "compare", results, write(tmp_path / "peer"), "--image", 2, "--peer-strain", "small"
    assert "leave out --peer-strain" in refusal(*words)


def test_plate_with_a_hole_moves_as_dice_has_measured_it(real_images, tmp_path):
    """DICe's own result for these images. Each program has a noise of some 5 to 10 mpx in them."""
    plate = real_images / "ohtcfrp"
    images = plate / "ohtcfrp_00.png", plate / "ohtcfrp_11.png"
    settings = "--subset", 27, "--step", 7, "--roi", plate / "roi.png"
    assert run_dic("correlate", *images, *settings, "-o", tmp_path / "r.h5").status == 0
    found = dic.compare_results(tmp_path / "r.h5", DICE)
    assert found.common > 0.9 * len(found.peer) > 200
    for name in ("u_px", "v_px"):
        values = found.differences[name].as_dict()
        assert abs(values["mean"]) < 0.005
        assert values["rms"] < 0.02
        # The displacements themselves are a thousand times larger.
        assert np.ptp(found.differences[name].peer) > 1.0
