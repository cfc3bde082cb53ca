"""`dic strain` computes strain from stored fields, identical bit by bit with a new measurement."""

import h5py
import numpy as np
import pytest

import dic
from simulators.scene.optics import PinholeCamera
from tests.command_line import refusal, run_dic
from tests.dic.pipeline.rendered_run import SMALL, slid, write_rendered_run
from tests.dic.result_values import results
from tests.image_files import write_image

pytestmark = pytest.mark.usefixtures("grids_found_once")
SIDE_PX = 160
# A polygon with a slit, beside which subsets are clipped and cut.
REGION = ("--polygon", "5,5 155,5 155,155 5,155", "--polygon", "70,60 76,60 76,150 70,150")
CORRELATION = ("--subset", 21, "--step", 10, *REGION)


def calibration_file(path, pan_deg):
    """Write the calibration of a camera with the pan angle `pan_deg`, from exact grid points."""
    camera = PinholeCamera(SIDE_PX, SIDE_PX, 760.0, pan_deg=pan_deg)
    index = np.array([(i, j) for j in range(21) for i in range(21)])
    lattice = dic.targets.GridPoints.on_lattice(index, np.empty((len(index), 2)), (21, 21), 0.24)
    seen = camera.project(np.column_stack([lattice.xy_mm, np.zeros(len(index))]))
    grid = dic.targets.GridPoints.on_lattice(index, seen, (21, 21), 0.24)
    dic.save_calibration(dic.Calibration.fit(grid, (SIDE_PX, SIDE_PX)), path)
    return path


@pytest.fixture(scope="module")
def place(speckle, tmp_path_factory):
    """A folder with images of a stretched pattern, a third image without a pattern, and two calibrations."""
    folder = tmp_path_factory.mktemp("anew")
    pattern = speckle(seed=21, shape=(SIDE_PX, SIDE_PX), noise=1.0)
    for number in range(5):
        image = pattern.draw(lambda x, y, k=number: (x / (1 + 0.002 * k) - 0.3 * k, y), noise_seed=number)
        write_image(folder / f"img{number}.png", np.full_like(image, 128.0) if number == 3 else image)
    for name, pan_deg in (("first", 30.0), ("second", 27.0)):
        calibration_file(folder / f"{name}.h5", pan_deg)
    return folder


@pytest.mark.parametrize(
    ("before", "changed"),
    [
        ((), ("--strain-window", 5, "--strain", "hencky")),
        pytest.param(("--incremental", "always"), ("--strain-from", "shape"), marks=pytest.mark.extended),
        pytest.param(
            ("--calibration", "first.h5"),
            ("--calibration", "second.h5", "--motion", "tension"),
            marks=pytest.mark.extended,
        ),
    ],
)
def test_strain_anew_is_that_of_a_whole_measurement(
    place, before, changed, tmp_path, correlated, monkeypatch
):
    monkeypatch.chdir(place)
    first, anew, whole = (tmp_path / f"{name}.h5" for name in ("first", "anew", "whole"))
    words = ("correlate", place / "img*.png", *CORRELATION)
    assert run_dic(*words, *before, "-o", first).status == 2
    assert run_dic(*words, *before, *changed, "-o", whole, "--json", tmp_path / "whole.json").status == 2
    correlated.clear()
    done = run_dic("strain", first, *changed, "-o", anew, "--csv", tmp_path / "csv")
    assert done.status == 2
    assert len(correlated) == 0
    assert "img3.png: deformed image: find the reference's pattern" in done.err
    assert results(anew) == results(whole)
    assert (tmp_path / "csv" / "img4.csv").exists()


def test_provenance_of_strain_anew_names_the_result_and_the_command(place, tmp_path):
    first, anew = tmp_path / "first.h5", tmp_path / "anew.h5"
    assert run_dic("correlate", place / "img[0-1].png", *CORRELATION, "-o", first).status == 0
    assert run_dic("strain", first, "--strain-window", 5, "-o", anew).status == 0
    with h5py.File(anew) as file:
        origin = file["provenance"]
        assert "strain" in origin.attrs["command"]
        named = dict(zip(origin["file"].asstr()[:], origin["sha256"].asstr()[:], strict=True))
    assert named.keys() == {str(place / "img0.png"), str(first)}
    # `dic strain` takes its own results too, and refuses to replace them.
    assert run_dic("strain", anew).status == 0
    assert "one that exists" in refusal("strain", anew, "-o", first)


def test_fields_without_the_pixels_of_their_subsets_are_refused(place, tmp_path):
    result = tmp_path / "r.h5"
    assert run_dic("correlate", place / "img[0-1].png", *CORRELATION, "-o", result).status == 0
    with h5py.File(result, "a") as file:
        del file["series/usable"]
    assert "a result file of an earlier version" in refusal("strain", result, "--strain-window", 5)


def test_python_gives_the_strain_of_measure_images(place, tmp_path):
    result, region = tmp_path / "r.h5", dic.read_region(None, REGION[1::2], (SIDE_PX, SIDE_PX))
    assert run_dic("correlate", place / "img[0-1].png", *CORRELATION, "-o", result).status == 0
    strain = dic.StrainSettings(window_points=7)
    anew = dic.strain_of_series(dic.load_series_result(result), strain=strain).images[0]
    settings = dic.CorrelationSettings(subset_px=21, step_px=10)
    whole = dic.measure_images(place / "img[0-1].png", settings=settings, strain=strain, region=region)
    np.testing.assert_allclose(anew.strain.exx, whole.images[0].strain.exx, rtol=0, atol=1e-9)
    np.testing.assert_allclose(anew.strain.exx_std, whole.images[0].strain.exx_std, rtol=0, atol=1e-9)


@pytest.mark.extended
def test_run_has_the_strain_of_a_whole_run_with_another_plate_and_window(tmp_path, correlated):
    run = write_rendered_run(tmp_path / "run.h5", [slid(0.05)], camera=SMALL)
    changed = ("--strain-window", 5, "--plate-mm", 0.5, "--poisson-ratio", 0.3)
    first, anew, whole = (tmp_path / f"{name}.h5" for name in ("first", "anew", "whole"))
    assert run_dic("process", run, "--step", 30, "-o", first).status == 0
    assert run_dic("process", run, "--step", 30, *changed, "-o", whole).status == 0
    correlated.clear()
    assert run_dic("strain", first, *changed, "-o", anew).status == 0
    assert len(correlated) == 0
    assert results(anew) == results(whole)
    assert "--motion: expected the results of a series of images" in refusal(
        "strain", first, "--motion", "rigid"
    )
