"""Tests of the command `dic correlate` and its output."""

import csv
import io
import shutil
import signal
from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest

from dic.strain.strain import STRAIN_KEYS
from tests.command_line import refusal, run_dic
from tests.dic.correlation import lattices
from tests.image_files import write_image

P = (2.4, 0.010, 0.0, -1.3, 0.0, -0.004)


@pytest.fixture(scope="module")
def folder(speckle, tmp_path_factory):
    """A folder with ref.png, and with moved.png after strains of 10 000 µε along x and -4000 µε along y."""
    folder = tmp_path_factory.mktemp("images")
    pattern = speckle(seed=21)

    def back(x, y):
        return (x - P[0]) / (1 + P[1]), (y - P[3]) / (1 + P[5])

    for name, image in (("ref", pattern.draw()), ("moved", pattern.draw(back)), ("still", pattern.draw())):
        write_image(folder / f"{name}.png", image)
    return folder


def test_every_output_tells_the_same(folder, tmp_path):
    result = run_dic(
        "correlate",
        folder / "ref.png", folder / "moved.png", "--subset", 21, "--step", 12, "-o", tmp_path / "r.h5",
        "--csv", tmp_path / "csv", "--maps", tmp_path / "maps", "--json", tmp_path / "r.json",
    )  # fmt: skip
    assert result.status == 0, result
    summary = result.report["images"][0]
    assert summary["raw"]["exx"] == pytest.approx((1.010**2 - 1) / 2, abs=50e-6)
    assert summary["raw"]["eyy"] == pytest.approx((0.996**2 - 1) / 2, abs=50e-6)

    with (tmp_path / "csv" / "moved.csv").open() as file:
        rows = list(csv.DictReader(file))
    last = ["local_strain", "std_u_px", "std_v_px"]
    assert list(rows[0]) == ["x_px", "y_px", "u_px", "v_px", "zncc", "status", *STRAIN_KEYS, *last]
    good = [row for row in rows if row["status"] == "converged"]
    assert len(good) == summary["converged"]
    for row in good:
        assert float(row["u_px"]) == pytest.approx(P[0] + P[1] * float(row["x_px"]), abs=0.02)
        assert float(row["v_px"]) == pytest.approx(P[3] + P[5] * float(row["y_px"]), abs=0.02)

    with (tmp_path / "csv" / "strain.csv").open() as file:
        (line,) = csv.DictReader(file)
    assert line["image"] == str(folder / "moved.png")
    assert int(line["converged"]) == summary["converged"]
    for name in ("exx", "eyy", "exy", "exx_std", "eyy_std", "exy_std"):
        assert float(line[f"raw_{name}"]) == pytest.approx(summary["raw"][name], abs=1e-9)

    with h5py.File(tmp_path / "r.h5") as file:
        series = file["series"]
        assert series["label"].asstr()[0].endswith("moved.png")
        assert series["raw_mean/exx"][0] == summary["raw"]["exx"]
        values = series["u_px"][0][np.isfinite(series["u_px"][0])]
        assert sorted(values.round(6)) == sorted(float(row["u_px"]) for row in good)
    assert cv2.imread(str(tmp_path / "maps" / "moved.png")).shape[1] > 500


def test_a_polygon_may_be_longer_than_the_name_of_a_file(folder, tmp_path):
    angles = np.linspace(0.0, 2 * np.pi, 60, endpoint=False)
    corners = " ".join(f"{90 + 60 * np.cos(a):.4f},{80 + 55 * np.sin(a):.4f}" for a in angles)
    assert len(corners) > 255
    assert run_dic("correlate", folder / "ref.png", folder / "moved.png", "--polygon", corners).status == 0


def test_a_truncated_image_is_named_and_the_others_are_kept(folder, tmp_path):
    cut = tmp_path / "cut.png"
    cut.write_bytes((folder / "moved.png").read_bytes()[:-2000])
    result = run_dic(
        "correlate",
        folder / "ref.png",
        cut,
        folder / "still.png",
        tmp_path / "none.png",
        "--json",
        tmp_path / "r.json",
    )
    assert result.status == 2
    complaints = [line for line in result.err.splitlines() if line]
    assert len(complaints) == 2
    assert "cut.png" in complaints[0]
    assert "cut off" in complaints[0]
    assert "none.png" in complaints[1]
    content = result.report
    assert [image["file"] for image in content["images"]] == [str(folder / "still.png")]
    assert len(content["failures"]) == 2


def test_an_image_of_another_size_is_refused(folder, tmp_path):
    small = write_image(tmp_path / "small.png", np.zeros((100, 120)))
    result = run_dic("correlate", folder / "ref.png", small)
    assert result.status == 2
    assert "small.png" in result.err
    assert "expected 180 x 160 px, got 120 x 100 px" in result.err


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["missing.png", "also.png"], "missing.png"),
        (["ref.png", "moved.png", "--subset", "20"], "an odd number"),
        (["ref.png", "moved.png", "--step", "0"], "at least 1 px"),
        (["ref.png", "moved.png", "--strain-window", "4"], "an odd number of points"),
        (["ref.png", "moved.png", "-o", "none/r.h5"], "no such folder"),
        (["ref.png", "moved.png", "--roi", "black.png"], "one uniform grey"),
        (["flat.png", "moved.png"], "texture"),
        (["ref.png", "moved.png", "--calibration", "ref.png"], "calibration"),
        (["ref.png", "moved.png", "--decimal-comma"], "give --csv, or leave out --decimal-comma"),
    ],
)
def test_bad_input_ends_with_one_sentence_and_status_2(folder, monkeypatch, arguments, sentence):
    monkeypatch.chdir(folder)
    write_image(Path("black.png"), np.zeros((160, 180)))
    write_image(Path("flat.png"), np.full((160, 180), 77))
    assert sentence in refusal("correlate", *arguments)


def test_a_badly_measured_image_gives_status_1(folder, speckle, tmp_path):
    image = cv2.imread(str(folder / "moved.png"), cv2.IMREAD_GRAYSCALE)
    # Most of the surface has changed beyond recognition.
    image[:, 70:] = np.rint(speckle(seed=99).draw())[:, 70:]
    bad = write_image(tmp_path / "bad.png", image)
    result = run_dic("correlate", folder / "ref.png", bad, "--subset", 21, "--step", 8)
    assert result.status == 1, result
    assert "fewer than half" in result.err


def test_a_stopped_series_keeps_what_it_has_measured(folder, tmp_path):
    class InterruptingReader(io.StringIO):
        def write(self, text):
            if "moved.png" in text:
                signal.raise_signal(signal.SIGINT)
            return super().write(text)

    result = run_dic(
        "correlate",
        folder / "ref.png", folder / "moved.png", folder / "still.png", "--subset", 21, "--step", 20,
        "-o", tmp_path / "r.h5", "--json", tmp_path / "r.json", out=InterruptingReader(),
    )  # fmt: skip
    assert result.status == 2, result
    assert "1 of 2 images not measured" in result.err
    assert result.err.endswith("give the same command again to go on with the images that are not measured\n")
    with h5py.File(tmp_path / "r.h5") as file:
        assert [label.rsplit("/")[-1] for label in file["series/label"].asstr()] == ["moved.png"]
    content = result.report
    assert [len(content[key]) for key in ("images", "failures")] == [1, 1]


@pytest.mark.parametrize("option", ["-o", "--json", "--maps"])
def test_an_image_is_never_overwritten_by_results(folder, tmp_path, monkeypatch, option):
    content = (folder / "still.png").read_bytes()
    for name in ("ref.png", "still.png"):
        (tmp_path / name).write_bytes(content)
    monkeypatch.chdir(tmp_path)
    place = "." if option == "--maps" else "still.png"
    assert "one that is read" in refusal("correlate", "ref.png", "still.png", option, place)
    assert (tmp_path / "still.png").read_bytes() == content


@pytest.mark.parametrize("taken", ["-o", "--contact-sheet"])
def test_folders_of_a_refused_command_are_not_made(folder, tmp_path, taken):
    old = tmp_path / ("old.h5" if taken == "-o" else "old.png")
    old.touch()
    place = old if taken == "-o" else f"eyy={old}"
    folders = ["--maps", tmp_path / "new" / "maps", "--csv", tmp_path / "tables"]
    command = ["correlate", folder / "ref.png", folder / "still.png", *folders, taken, place]
    assert "one that exists" in refusal(*command)
    assert list(tmp_path.iterdir()) == [old]


def test_result_file_does_not_end_like_another_kind_of_file(folder, tmp_path):
    said = refusal("correlate", folder / "ref.png", folder / "still.png", "-o", tmp_path / "r.csv")
    assert "expected an HDF5 file, such as one that ends with .h5, got one that ends with .csv" in said
    assert list(tmp_path.iterdir()) == []


def test_other_outputs_may_be_in_a_new_folder_of_maps(folder, tmp_path):
    maps = tmp_path / "new" / "maps"
    outputs = ["--maps", maps, "--json", maps / "r.json", "--write-mask", tmp_path / "new" / "mask.png"]
    done = run_dic("correlate", folder / "ref.png", folder / "still.png", "--step", 40, *outputs)
    assert done.status == 0, done
    assert sorted(path.name for path in maps.iterdir()) == ["r.json", "still.png"]
    assert (tmp_path / "new" / "mask.png").exists()


def test_image_of_the_name_of_the_table_of_strains_has_a_table_beside_it(folder, tmp_path):
    shutil.copy(folder / "still.png", tmp_path / "strain.png")
    csv_folder = tmp_path / "csv"
    done = run_dic(
        "correlate", folder / "ref.png", tmp_path / "strain.png", "--step", 40, "--csv", csv_folder
    )
    assert done.status == 0
    assert sorted(path.name for path in csv_folder.iterdir()) == ["0001_strain.csv", "strain.csv"]


def test_an_image_given_twice_gives_a_table_each(folder, tmp_path):
    still = folder / "still.png"
    assert run_dic("correlate", folder / "ref.png", still, still, "--step", 40, "--csv", tmp_path).status == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "0001_still.csv",
        "0002_still.csv",
        "strain.csv",
    ]


def test_too_few_points_for_a_strain_are_called_that(folder):
    result = run_dic("correlate", folder / "ref.png", folder / "still.png", "--step", 1000)
    assert result.status == 1
    assert "too few for a mean strain" in result.err


class TestRegionsAndMotion:
    def converged(self, folder, tmp_path, *options):
        table = tmp_path / "csv"
        result = run_dic(
            "correlate",
            folder / "ref.png",
            folder / "moved.png",
            "--subset",
            21,
            "--step",
            6,
            "--csv",
            table,
            *options,
        )
        assert result.status == 0, result
        with (table / "moved.csv").open() as file:
            rows = [row for row in csv.DictReader(file) if row["status"] == "converged"]
        return np.array([[float(row["x_px"]), float(row["y_px"])] for row in rows])

    def test_a_polygon_with_a_hole_limits_the_points(self, folder, tmp_path):
        hole = tmp_path / "hole.json"
        hole.write_text('{"polygon": [[80, 60], [110, 60], [110, 90], [80, 90]]}')
        outer = "40,30 140,30 140,130 40,130"
        at = self.converged(folder, tmp_path, "--polygon", outer, "--polygon", hole)
        inside = (at > [40, 30]).all(axis=1) & (at < [140, 130]).all(axis=1)
        in_hole = (at > [80, 60]).all(axis=1) & (at < [110, 90]).all(axis=1)
        assert len(at) > 150
        assert inside.all()
        assert not in_hole.any()

    def test_mask_and_polygon_together_mean_what_lies_in_both(self, folder, tmp_path):
        mask = np.zeros((160, 180))
        mask[:, 80:] = 255
        roi = write_image(tmp_path / "mask.png", mask)
        at = self.converged(folder, tmp_path, "--polygon", "40,30 140,30 140,130 40,130", "--roi", roi)
        assert at[:, 0].min() >= 80
        assert at[:, 0].max() < 140

    def test_a_given_motion_is_used_as_a_hint(self, speckle, turn, tmp_path):
        pattern, centre = speckle(seed=22, shape=(200, 200)), (99.5, 99.5)
        files = [
            write_image(tmp_path / f"{angle}.png", pattern.draw(turn(angle, centre))) for angle in (0, 100)
        ]
        options = ["--subset", 21, "--hint", "98", "--json", tmp_path / "r.json"]
        result = run_dic("correlate", *files, *options)
        assert result.status == 0, result
        image = result.report["images"][0]
        assert image["start"] == "hint"
        assert image["raw"]["rotation_deg"] == pytest.approx(100.0, abs=0.01)

    @pytest.mark.parametrize(
        ("option", "value", "sentence"),
        [
            ("--polygon", "1,2 3,4", "at least 3 and at most 100000 corners [x, y], got 2"),
            ("--polygon", "1,1 5,1 5,5", "an area with texture"),
            (
                "--polygon",
                "900,900 990,900 950,990",
                "inside the image of 180 x 160 px, got (900, 900)",
            ),
            ("--polygon", "9,9 99,99 99,9 9,99", "a crossing at (54, 54)"),
            ("--hint", "ninety", "degrees,right,down"),
            ("--hint", "nan", "degrees,right,down"),
            ("--incremental", "often", "auto or never or always"),
            ("--shape", "cubic", "affine or quadratic"),
        ],
    )
    def test_regions_and_motions_that_make_no_sense_are_refused(self, folder, option, value, sentence):
        assert sentence in refusal("correlate", folder / "ref.png", folder / "moved.png", option, value)


def test_a_pattern_that_repeats_is_named_and_only_a_hint_measures_it(tmp_path):
    pattern = lattices.lattice("hexagonal", 15.0, 0.2)
    for name, motion in (("still", (0.0, 0.0)), ("moved", (33.0, 8.0))):
        write_image(tmp_path / f"{name}.png", lattices.image(pattern, (260, 260), motion, seed=len(name)))
    images = [tmp_path / "still.png", tmp_path / "moved.png"]
    outputs = ["--subset", 31, "--json", tmp_path / "a.json", "-o", tmp_path / "a.h5"]
    done = run_dic("correlate", *images, *outputs)
    assert done.status == 1
    assert "every 15.0 px" in done.out
    assert "the pattern repeats" in done.err
    (row,) = done.report["images"]
    assert not row["good"]
    assert row["converged"] == 0
    assert row["failures"]["repeating"] > 0.9 * row["points"]
    # The result file holds what was found.
    assert run_dic("correlate", *images, *outputs, "--force").out.count(row["remarks"][0]) == 1
    done = run_dic("correlate", *images, *outputs, "--hint", "0,32,9", "--force")
    assert done.status == 0, done
    assert "hint decides" in done.out
    with h5py.File(tmp_path / "a.h5") as file:
        (u_px,) = file["series/u_px"][:]
    assert np.nanmedian(u_px) == pytest.approx(33.0, abs=0.1)
