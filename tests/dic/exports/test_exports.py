"""Every export, read by an independent reader, has the values and the units of the result file."""

import csv
import json
import subprocess
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from PIL import Image

import dic
from dic.exports.image import unique_names
from dic.runfile.reader import RunStep
from simulators.scene.pose import Pose
from tests.command_line import refusal, run_dic
from tests.conftest import SpecklePattern
from tests.dic.exports.exported import READERS, of_dataset, truth
from tests.dic.out_of_plane.exact_views import State
from tests.dic.pipeline.exact_runs import run_of
from tests.exif_files import save_taken
from tests.full_disk import full_disk
from tests.image_files import write_image
from tests.peers import interpreter

FORMATS = ("csv", "tiff", "vtk", "mat", "npz", "netcdf", "dice")
SERIES = [("", 1, "img1"), ("", 3, "img2")]
RUN = [(camera, k + 1, f"{camera}_load_{k + 2}") for camera in ("aside", "straight") for k in range(2)]


def sampled(first: list[tuple[str, int, str]]) -> list[object]:
    """Return all images, those that are not among the first ones with the mark of the second part."""
    cases = [*SERIES, *RUN]
    return [case if case in first else pytest.param(*case, marks=pytest.mark.extended) for case in cases]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Exports of a series without calibration, whose second image failed, and of a run with two cameras."""
    made = tmp_path_factory.mktemp("exports")
    pattern = SpecklePattern(seed=21)
    for name, stretch in (("ref", 0.0), ("img1", 0.001), ("img2", 0.002)):
        write_image(made / f"{name}.png", pattern.draw(lambda x, y, s=stretch: (x / (1 + s), y)))
    write_image(made / "other.png", np.full((20, 30), 9.0))
    files = [made / f"{name}.png" for name in ("ref", "img1", "other", "img2")]
    for file, taken in zip(files, ("00.0", "10.0", "20.0", "35.5"), strict=True):
        save_taken(Image.open(file), file, f"2026:07:01 10:00:{taken[:2]}", taken[3:])
    assert run_dic("correlate", *files, "--subset", 21, "--step", 12, "-o", made / "series.h5").status == 2
    F = np.array([[0.9991, 0.0004], [0.0004, 1.003]])
    states = [State(Pose.sloped(0.05, -0.15, 0.005), F), State(Pose.sloped(0.1, 0.1, 0.02), F)]
    steps = [RunStep(2 + k, "load", 1000.0, 1001.0 + k, 0.1, np.nan, 9.0 * k) for k in range(2)]
    run = run_of(steps, states, [states[0], State(F=np.diag([1.02, 1.0]))])
    dic.pipeline.save_run_result(run, made / "run.h5")
    for name in ("series", "run"):
        places = "-o", made / name, "--json", made / f"{name}.json"
        assert run_dic("export", made / f"{name}.h5", *FORMATS, *places).status == 0
    return made


def results_of(folder: Path, camera: str) -> str:
    return "run" if camera else "series"


def assert_equal(found, expected, rounding=None):
    """Check that values and units are equal at the points of the region, within `rounding` of the format."""
    active = expected["active"][0]
    for name, (values, unit) in expected.items():
        if name == "active":
            continue
        there, their_unit = found[name]
        assert their_unit == unit, name
        allowed = {} if rounding is None else rounding(name)
        np.testing.assert_allclose(
            np.asarray(there, float)[active],
            values[active].astype(float),
            err_msg=name,
            **({"rtol": 0} | allowed),
        )


def without_places(expected):
    """Return the expected values without X_mm and Y_mm, which ParaView's file holds as point coordinates."""
    return {key: value for key, value in expected.items() if key not in ("X_mm", "Y_mm")}


def half_a_decimal(name: str) -> dict[str, float]:
    """Return the rounding of the CSV tables: 6 decimals for px, 7 for mm, 9 for strain."""
    digits = 7 if name.endswith("_mm") else 6 if "_px" in name or name == "zncc" else 9
    return {"atol": 0.51 * 10.0**-digits}


def single(name: str) -> dict[str, float]:
    return {"rtol": 6e-8}


@pytest.mark.parametrize("kind", READERS)
@pytest.mark.parametrize(("camera", "number", "name"), sampled([SERIES[1], RUN[0]]), ids=str)
def test_export_has_the_values_and_units_of_the_result_file(folder, kind, camera, number, name):
    index = SERIES.index((camera, number, name)) if not camera else number - 1
    expected = truth(folder / f"{results_of(folder, camera)}.h5", camera, index)
    assert ("X_mm" in expected) == bool(camera)
    found = READERS[kind](
        folder / results_of(folder, camera), camera, number, name, expected["active"][0].shape
    )
    if kind == "csv":
        # A table has the status and the calibrated area as text, and has no rows beside the region.
        expected = {key: value for key, value in expected.items() if not key.endswith(("status", "valid"))}
        inside = np.ix_(*(expected["active"][0].any(axis=1 - axis) for axis in (0, 1)))
        expected = {key: (values[inside], unit) for key, (values, unit) in expected.items()}
    if kind == "vtk":
        expected = without_places(expected)
    assert_equal(found, expected, {"csv": half_a_decimal, "tiff": single}.get(kind))


def test_run_exports_the_correction_of_both_cameras_together(folder):
    assert "corrected_exx" in truth(folder / "run.h5", "aside", 0)
    with (folder / "run" / "csv" / "strain.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    # Each camera's two steps, and the step that it failed to measure.
    assert [row["camera"] for row in rows] == ["aside"] * 3 + ["straight"] * 3
    assert rows[0]["correction"] == "two cameras"
    assert float(rows[0]["load_n"]) == 1001.0
    assert [row["problem"] for row in rows if not row["image"]] == [
        f"{name}: step 9 failed" for name in ("aside", "straight")
    ]


@pytest.mark.parametrize(("camera", "number", "name"), sampled([SERIES[1], RUN[0], RUN[-1]]), ids=str)
def test_python_gives_the_same_values_as_the_result_file(folder, camera, number, name):
    pytest.importorskip("xarray", reason="the extra [tables] is not installed")
    path = folder / f"{results_of(folder, camera)}.h5"
    index = [1, 3].index(number) if not camera else number - 1
    expected = truth(path, camera, index)
    dataset = dic.to_xarray(path, camera=camera or None)
    assert_equal(of_dataset(dataset, number), expected)
    table = dic.to_pandas(path)
    lines = table[table["image"] == number]
    if camera:
        lines = lines[lines["camera"] == camera]
        assert set(lines["load_n"]) == {1000.0 + number}
    active = expected.pop("active")[0]
    for name, (values, unit) in expected.items():
        np.testing.assert_array_equal(lines[name], values[active].astype(float), err_msg=name)
        assert table.attrs["units"][name] == unit


@pytest.mark.parametrize(("camera", "number", "name"), [SERIES[1], RUN[0]], ids=["series", "run"])
def test_dice_text_has_the_points_with_a_displacement_in_axes_with_y_downwards(folder, camera, number, name):
    results = results_of(folder, camera)
    path = folder / results / "dice" / camera / f"DICe_solution_{number}.txt"
    lines = path.read_text().splitlines()
    table = np.genfromtxt([line for line in lines if not line.startswith("***")], delimiter=",", names=True)
    expected = truth(folder / f"{results}.h5", camera, 1 if not camera else number - 1)
    converged = (expected["status"][0] == 0) & expected["active"][0]
    names = {
        "DISPLACEMENT_X": "u_px",
        "DISPLACEMENT_Y": "v_px",
        "VSG_STRAIN_XX": "exx",
        "VSG_STRAIN_YY": "eyy",
    }
    for column, own in names.items():
        np.testing.assert_allclose(table[column], expected[own][0][converged], rtol=1e-10)
    np.testing.assert_allclose(table["VSG_STRAIN_XY"], -expected["exy"][0][converged], rtol=1e-10)
    np.testing.assert_allclose(table["GAMMA"], 2 - 2 * expected["zncc"][0][converged], atol=1e-9)
    assert np.isfinite(table["SIGMA"]).all()


def test_grids_of_paraview_lie_upright_and_hide_points_without_a_displacement(folder):
    """In a series, y_px points downwards and ParaView's y upwards; a run is drawn in mm, at its times."""
    expected = truth(folder / "series.h5", "", 1)
    found = READERS["vtk"](folder / "series", "", 3, "img2", expected["active"][0].shape)
    lost = (expected["status"][0] != 0) | ~expected["active"][0]
    np.testing.assert_array_equal(found["vtkGhostType"][0] == 2, lost)
    np.testing.assert_array_equal(found["displacement_px"][0][~lost][:, 1], -expected["v_px"][0][~lost])
    order = (folder / "run" / "vtk" / "aside.pvd").read_text()
    assert 'timestep="0.0" part="0" file="aside_load_2.vts"' in order
    assert 'timestep="9.0" part="0" file="aside_load_3.vts"' in order


def test_images_of_a_series_have_their_times(folder):
    """By their Exif tags they were taken 10 s and 35.5 s after the reference."""
    order = (folder / "series" / "vtk" / "series.pvd").read_text()
    assert 'timestep="10.0" part="0" file="img1.vts"' in order
    assert 'timestep="35.5" part="0" file="img2.vts"' in order
    with np.load(folder / "series" / "npz" / "img2.npz") as file:
        assert json.loads(str(file["about"]))["time_s"] == 35.5


def test_times_of_files_are_in_the_table_of_strains_alone(folder, tmp_path):
    """Such a time is lost if the file is copied, and only this table names the source of a time."""
    write_image(tmp_path / "img.png", np.asarray(Image.open(folder / "img1.png"), float))
    result, out = tmp_path / "r.h5", tmp_path / "out"
    files = folder / "ref.png", tmp_path / "img.png"
    assert run_dic("correlate", *files, "--subset", 21, "--step", 24, "-o", result).status == 0
    assert run_dic("export", result, "csv", "npz", "-o", out).status == 0
    with np.load(out / "npz" / "img.npz") as file:
        assert "time_s" not in json.loads(str(file["about"]))
    assert ",file," in (out / "csv" / "strain.csv").read_text()


def test_copy_of_the_reference_has_no_failed_points_in_dice_text(folder, tmp_path):
    """Rounding makes the ZNCC of equal images larger than 1; in DICe, negative values mark failures."""
    result, out = tmp_path / "r.h5", tmp_path / "out"
    (tmp_path / "copy.png").write_bytes((folder / "ref.png").read_bytes())
    files = folder / "ref.png", tmp_path / "copy.png"
    assert run_dic("correlate", *files, "--subset", 21, "--step", 24, "-o", result).status == 0
    assert run_dic("export", result, "dice", "-o", out).status == 0
    with h5py.File(result) as file:
        assert (file["series/zncc"][0] > 1.0).any()
        points = np.count_nonzero((file["series/status"][0] == 0) & (file["series/active"][:] == 1))
    assert len(dic.comparison.read_peer(out / "dice" / "DICe_solution_1.txt")) == points


def test_raw_strain_beside_the_calibrated_one_is_that_of_planes_through_the_displacements(folder, tmp_path):
    places = "-o", tmp_path, "--camera", "aside", "--raw-strain"
    assert run_dic("export", folder / "run.h5", "npz", "csv", "dice", *places).status == 0
    name = "aside_load_2"
    with h5py.File(folder / "run.h5") as file, np.load(tmp_path / "npz" / f"{name}.npz") as found:
        series = file["cameras/aside/series"]
        step_px, row, column = int(series.attrs["step_px"]), 9, 7
        window = slice(row - 1, row + 2), slice(column - 1, column + 2)
        assert (series["status"][0][window] == 0).all()
        u, v = series["u_px"][0][window], series["v_px"][0][window]
        # The slope of the plane through 3 × 3 points is a sum over the outer columns or rows.
        gradient = np.array([
            [(each[:, 2] - each[:, 0]).sum() / (6 * step_px), (each[0] - each[2]).sum() / (6 * step_px)]
            for each in (u, -v)
        ])  # fmt: skip
        strain = (gradient + gradient.T + gradient.T @ gradient) / 2
        raw = {"raw_exx": strain[0, 0], "raw_eyy": strain[1, 1], "raw_exy": strain[0, 1]}
        assert {key: found[key][row, column] for key in raw} == pytest.approx(raw, abs=1e-12)
        assert json.loads(str(found["units"]))["raw_direction_deg"] == "deg"
        assert abs(raw["raw_eyy"] - found["eyy"][row, column]) > 1e-5
        at = int(series["x_px"][column]), int(series["y_px"][row])
    with (tmp_path / "csv" / f"{name}.csv").open(encoding="utf-8", newline="") as table:
        (line,) = (each for each in csv.DictReader(table) if (int(each["x_px"]), int(each["y_px"])) == at)
    assert {key: float(line[key]) for key in raw} == pytest.approx(raw, abs=1e-9)
    lines = (tmp_path / "dice" / "aside" / "DICe_solution_1.txt").read_text().splitlines()
    text = np.genfromtxt([each for each in lines if "*" not in each], delimiter=",", names=True)
    (own,) = text[(text["COORDINATE_X"] == at[0]) & (text["COORDINATE_Y"] == at[1])]
    there = [own[f"VSG_STRAIN_{axes}"] for axes in ("XX", "YY", "XY")]
    assert there == pytest.approx([strain[0, 0], strain[1, 1], -strain[0, 1]], abs=1e-12)
    assert any("green-lagrange, raw" in each for each in lines)


def test_own_export_in_dices_format_is_compared_only_if_its_strain_is_raw(folder, tmp_path):
    calibrated = folder / "run" / "dice" / "aside" / "DICe_solution_1.txt"
    assert (
        "expected raw strain, in the axes of the image, got calibrated strain; export the results again"
        in (refusal("compare", folder / "run.h5", calibrated, "--image", 1, "--camera", "aside"))
    )
    hencky = tmp_path / "hencky.h5"
    # The series has an image that could not be measured.
    assert run_dic("strain", folder / "series.h5", "--strain", "hencky", "-o", hencky).status == 2
    assert run_dic("export", hencky, "dice", "-o", tmp_path).status == 0
    assert dic.comparison.read_peer(tmp_path / "dice" / "DICe_solution_3.txt").measure == "hencky"


def test_table_names_the_failures_of_a_camera_that_measured_nothing(folder, tmp_path):
    run = dic.load_run_result(folder / "run.h5")
    blind = replace(run.cameras[1], steps=[], measurements=[], failures=["straight: step 2 failed"])
    done = dic.export_results(replace(run, cameras=[run.cameras[0], blind]), tmp_path)
    assert done.failures[-1].endswith("straight: step 2 failed")
    with (tmp_path / "csv" / "strain.csv").open(encoding="utf-8", newline="") as file:
        assert [row["camera"] for row in csv.DictReader(file)] == ["aside"] * 3 + ["straight"]


def test_no_two_images_get_the_same_file():
    assert unique_names(["a", "b"]) == ["a", "b"]
    assert unique_names(["a", "b", "a"]) == ["0001_a", "b", "0003_a"]
    assert len(set(unique_names(["a", "a", "0001_a"]))) == 3
    assert "strain" not in unique_names(["strain", "a"], ["strain"])


def test_json_names_the_folders_the_images_and_the_failures(folder):
    report = json.loads((folder / "series.json").read_text())
    assert set(report["folders"]) == set(FORMATS)
    assert [Path(image).name for image in report["images"]] == ["img1.png", "img2.png"]
    (failure,) = report["failures"]
    assert "other.png" in failure


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["csv"], "expected a folder that is empty or new, got one with files"),
        (["npz", "--camera", "left"], "results of a run, got those of a series"),
        (["npz", "--decimal-comma"], "give csv, or leave out --decimal-comma"),
        (["xlsx"], "format of the export: expected some of csv, tiff, vtk, mat, npz, netcdf, dice, got xlsx"),
    ],
)
def test_bad_request_ends_with_one_sentence_and_leaves_the_files(folder, arguments, words, tmp_path):
    out = folder / "series" if arguments == ["csv"] else tmp_path / "new"
    before = (folder / "series" / "csv" / "img1.csv").read_bytes()
    assert words in refusal("export", folder / "series.h5", *arguments, "-o", out)
    assert (folder / "series" / "csv" / "img1.csv").read_bytes() == before
    assert not (tmp_path / "new").exists()


def test_places_and_files_that_cannot_be_used_end_with_one_sentence(folder, tmp_path):
    (tmp_path / "file").write_text("")
    assert "expected a folder, got a file" in refusal(
        "export", folder / "series.h5", "npz", "-o", tmp_path / "file"
    )
    words = "expected a result file of `dic correlate -o` or `dic process`, got"
    for other in (folder / "img1.png", folder):
        assert words in refusal("export", other, "npz", "-o", tmp_path / "new")
    assert "choose a camera: expected aside or straight, got left" in refusal(
        "export", folder / "run.h5", "npz", "-o", tmp_path / "new", "--camera", "left"
    )


def test_force_replaces_files_and_one_camera_is_exported_alone(folder, tmp_path):
    for force in ([], ["--force"]):
        places = "-o", tmp_path / "out", "--camera", "aside"
        assert run_dic("export", folder / "run.h5", "csv", "netcdf", *places, *force).status == 0
    assert [path.name for path in (tmp_path / "out" / "netcdf").iterdir()] == ["aside.nc"]
    assert not list((tmp_path / "out" / "csv").glob("straight*"))


@pytest.mark.parametrize("name", FORMATS)
def test_full_disk_ends_with_one_sentence_and_no_half_file(folder, name, tmp_path):
    whole = [path for path in (folder / "series" / name).rglob("*") if path.is_file()]
    sizes = {path.relative_to(folder / "series"): path.stat().st_size for path in whole}
    for most_bytes in (0, sorted(sizes.values())[len(sizes) // 2] // 2):
        made = tmp_path / f"{most_bytes}"
        with full_disk(most_bytes):
            said = refusal("export", folder / "series.h5", name, "-o", made)
        assert "write export: expected a folder with room for the export, got File too large; name" in said
        assert ".partial" not in said
        left = [path for path in made.rglob("*") if path.is_file()]
        assert all(path.stat().st_size == sizes[path.relative_to(made)] for path in left)


def test_animation_on_a_full_disk_does_not_blame_the_results(folder, tmp_path):
    for ending in ("gif", "mp4"):
        with full_disk(100):
            said = refusal("plot", "animation", folder / "series.h5", "-o", tmp_path / f"a.{ending}")
        assert f"a.{ending}: " in said
        assert "read results" not in said
        assert list(tmp_path.iterdir()) == []


@pytest.mark.long
def test_vtk_and_netcdf_c_read_the_same_values(folder):
    """The libraries of ParaView and of most programs for netCDF; too large to install for each test."""
    python = interpreter("vtk", "vtk>=9.3", "netCDF4>=1.6")
    script = Path(__file__).with_name("read_with_vtk.py")
    for camera, number, name in (*SERIES, *RUN):
        made = folder / results_of(folder, camera)
        index = [1, 3].index(number) if not camera else number - 1
        expected = truth(made.with_suffix(".h5"), camera, index)
        shape = expected["active"][0].shape
        files = made / "vtk" / f"{name}.vts", made / "netcdf" / f"{camera or 'series'}.nc"
        subprocess.run([python, script, *files, str(number), folder / "read.npz"], check=True)
        with np.load(folder / "read.npz") as read:
            units = json.loads(str(read["units"]))
            found = {key: (read[key].reshape(shape), unit) for key, unit in units.items()}
        for library in ("vtk", "nc4"):
            own = {key[4:]: value for key, value in found.items() if key.startswith(library)}
            assert_equal(own, without_places(expected) if library == "vtk" else expected)
