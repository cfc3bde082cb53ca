"""Gauges give the same numbers on a saved result, on the result in memory, and during the measurement."""

import json
from pathlib import Path

import h5py
import numpy as np
import pytest

from dic import measure_gauges
from dic.errors import GaugeError
from dic.gauges import Extensometer, LineCut, PointGauge, StrainGauge, TransverseExtensometer
from dic.pipeline import save_run_result
from dic.runfile.reader import RunStep
from simulators.scene.pose import Pose
from tests.command_line import refusal, run_dic
from tests.dic.out_of_plane.exact_views import State
from tests.dic.pipeline.exact_runs import run_of
from tests.dic.pipeline.rendered_run import slid, write_rendered_run
from tests.image_files import write_image

F = np.array([[0.9991, 0.0004], [0.0004, 1.003]])
IN_MM = (
    Extensometer(name="axial", unit="mm", start=(0.0, -3.0), end=(0.0, 3.0), patch=1.5),
    TransverseExtensometer(name="width", unit="mm", start=(-3.0, 0.0), end=(3.0, 0.0), patch=1.2, spread=5.0),
    StrainGauge(name="foil", unit="mm", centre=(0.5, 0.5), size=(4.0, 3.0), direction_deg=90.0),
    LineCut(name="cut", unit="mm", start=(-2.5, -2.0), end=(2.5, 2.0), places=7),
    PointGauge(name="point", unit="mm", at=(0.3, -0.4)),
)


@pytest.fixture(scope="module")
def tension():
    """A run of two loaded steps: two cameras correct the first step together, one camera the second step."""
    steps = [RunStep(2 + k, "load", 1000.0, 1001.0 + k, 0.1, np.nan, 9.0 * k) for k in range(2)]
    states = [State(Pose.sloped(0.05, -0.15, 0.005), F), State(Pose.sloped(0.1, 0.1, 0.02), F)]
    return run_of(steps, states, [states[0], State(F=np.diag([1.02, 1.0]))])


def numbers(value, path=""):
    """Yield the path and the value of every number in nested dictionaries and lists."""
    if isinstance(value, dict):
        for key, part in value.items():
            yield from numbers(part, f"{path}/{key}")
    elif isinstance(value, list):
        for k, part in enumerate(value):
            yield from numbers(part, f"{path}/{k}")
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield path, value


def assert_equal(one, other):
    first, second = dict(numbers(one)), dict(numbers(other))
    assert first.keys() == second.keys()
    assert len(first) > 50
    far = {
        k: (first[k], second[k]) for k in first if abs(first[k] - second[k]) > 1e-9 * max(1.0, abs(first[k]))
    }
    assert far == {}


def test_saved_run_gives_the_readings_of_the_run_in_memory(tension, tmp_path):
    save_run_result(tension, tmp_path / "results.h5")
    live, saved = (measure_gauges(found, IN_MM) for found in (tension, tmp_path / "results.h5"))
    assert [(image.known["camera"], image.known["step"]) for image in saved.images if image.readings] == [
        (camera, step) for camera in ("aside", "straight") for step in ("load 2", "load 3")
    ]
    assert set(saved.kinds) == {"raw", "calibrated", "corrected"}
    assert_equal(live.as_dict()["images"], saved.as_dict()["images"])
    # One camera alone knows how a wrong mounting would change its corrected strain. Two cameras measure it.
    known = [
        [one.readings["axial"]["corrected"].shared.mounting for one in found.images if one.readings]
        for found in (live, saved)
        if "corrected" in found.kinds
    ]
    assert {part.shape for part in known[0]} == {(3, 0), (3, 3)}
    for one, other in zip(*known, strict=True):
        np.testing.assert_array_equal(one, other)
    # Files of earlier versions have the standard deviations alone, which are enough along the axes.
    with h5py.File(tmp_path / "results.h5", "a") as file:
        del file["cameras/aside/series/calibrated_mean/shared_covariance"]
    older = measure_gauges(tmp_path / "results.h5", IN_MM, camera="aside").images[0].readings
    for name in ("axial", "width", "foil"):
        stds = [read[name]["calibrated"].strain_std for read in (older, live.images[0].readings)]
        assert stds[0] == pytest.approx(stds[1], rel=1e-6)


def test_corrected_gauges_of_a_tilted_specimen_read_the_true_strain(tension):
    series = measure_gauges(tension, IN_MM, camera="aside")
    read = series.images[0].readings
    true = {"axial": np.linalg.norm(F @ (0, 1)) - 1, "width": np.linalg.norm(F @ (1, 0)) - 1}
    true["foil"] = true["axial"]
    for name, strain in true.items():
        corrected, calibrated = read[name]["corrected"], read[name]["calibrated"]
        assert abs(corrected.strain - strain) < 3.5 * corrected.strain_std
        assert corrected.strain_std < 60e-6
        assert calibrated.strain_std > 3 * corrected.strain_std
        assert abs(calibrated.strain - strain) < 3.5 * calibrated.strain_std
    # The gauge length is stated in the unit of the field.
    assert read["axial"]["corrected"].length == pytest.approx(6.0, abs=0.5)
    assert read["axial"]["raw"].unit == "px"


def test_gauges_in_pixels_need_a_camera_of_a_run_of_several(tension):
    point = PointGauge(name="point", at=(400, 400))
    with pytest.raises(GaugeError, match="one of aside, straight, because the gauge is in pixels"):
        measure_gauges(tension, [point])
    read = measure_gauges(tension, [point], camera="straight")
    assert {image.known["camera"] for image in read.images} == {"straight"}


GAUGES = """
[[gauge]]
name = "axial"
kind = "extensometer"
start = [90, 40]
end = [90, 120]
patch = 24
[[gauge]]
name = "width"
kind = "transverse"
start = [40, 80]
end = [140, 80]
patch = 12
spread = 80
[[gauge]]
name = "cut"
kind = "cut"
start = [40, 40]
end = [140, 120]
places = 5
"""


@pytest.fixture(scope="module")
def folder(speckle, tmp_path_factory):
    """A reference, two loaded images and an image of another specimen, correlated with gauges."""
    folder = tmp_path_factory.mktemp("gauges")
    pattern = speckle(seed=21, noise=2.0)
    for k in range(3):
        stretch = 1 + 0.004 * k

        def back(x, y, stretch=stretch):
            return x, y / stretch

        write_image(folder / f"img{k}.png", pattern.draw(back, noise_seed=k))
    write_image(folder / "img3.png", speckle(seed=5).draw())
    (folder / "gauges.toml").write_text(GAUGES)
    settings = "--subset", 21, "--step", 7, "--gauges", folder / "gauges.toml"
    places = "-o", folder / "r.h5", "--csv", folder / "csv", "--json", folder / "r.json"
    done = run_dic("correlate", folder, *settings, *places)
    assert done.status == 2, done
    return folder


def test_command_reads_what_the_measurement_read(folder, tmp_path):
    places = "-o", tmp_path / "g.csv", "--json", tmp_path / "g.json", "--picture", tmp_path / "g.png"
    done = run_dic("gauges", folder / "r.h5", folder / "gauges.toml", *places)
    assert done.status == 1, done
    during = json.loads((folder / "r.json").read_text())
    assert [gauge["name"] for gauge in during["gauges"]] == ["axial", "width", "cut"]
    assert during["gauges"] == done.report["gauges"]
    assert_equal(during["gauge_readings"], done.report["images"])
    assert done.report["images"][2]["gauges"] == {}
    for name, own in (("gauges", "g"), ("gauges.cut", "g.cut")):
        assert Path(folder / "csv" / f"{name}.csv").read_text() == (tmp_path / f"{own}.csv").read_text()
    lines = (tmp_path / "g.csv").read_text().splitlines()
    cells = dict(zip(lines[0].split(","), lines[2].split(","), strict=False))
    assert float(cells["axial_raw_strain"]) == pytest.approx(
        0.008, abs=4 * float(cells["axial_raw_strain_std"])
    )
    assert float(cells["axial_raw_extension_px"]) == pytest.approx(
        float(cells["axial_raw_strain"]) * float(cells["axial_raw_length_px"]), rel=1e-6
    )
    assert len((tmp_path / "g.cut.csv").read_text().splitlines()) == 1 + 2 * 5 + 1
    assert (tmp_path / "g.png").read_bytes().startswith(b"\x89PNG")


def test_command_prints_each_gauge_and_each_image(folder):
    done = run_dic("gauges", folder / "r.h5", folder / "gauges.toml", "--gauge", "p=point at=90,80")
    lines = done.out.splitlines()
    assert lines[0].startswith("axial: extensometer, raw, gauge length 8")
    assert "40 lines" in lines[1]
    assert lines[4].split() == ["image", "axial", "width", "p", "µε"]
    name, value, sign, std = lines[6].split()[:4]
    assert (name, sign) == ("img2.png", "±")
    assert float(value) == pytest.approx(8000, abs=4 * float(std))
    assert "img3.png" in done.err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "at least one gauge, got none"),
        (["--gauge", "a=extensometer start=90,40 end=90,300 patch=9"], "inside the image of 180 × 160 px"),
        (["--gauge", "a=point at=90,40 unit=mm"], "a calibration, because the gauge is in millimetres"),
        (["--gauge", "a=point at=90,40", "--gauge", "a=point at=9,40"], "'a' twice"),
        (["--gauge", "a=point at=90,40", "--camera", "left"], "results of a run, got those of a series"),
        (["--gauge", "a=point at=90,40", "--decimal-comma"], "-o"),
    ],
)
def test_bad_gauges_end_with_one_sentence(folder, arguments, words):
    assert words in refusal("gauges", folder / "r.h5", *arguments)


def test_measurement_with_gauges_off_its_points_ends_with_one_sentence(folder, tmp_path):
    (tmp_path / "off.toml").write_text('[[gauge]]\nname = "a"\nkind = "point"\nat = [2, 2]\nwidth = 4\n')
    images = folder / "img0.png", folder / "img1.png"
    said = refusal("correlate", *images, "--subset", 21, "--gauges", tmp_path / "off.toml")
    assert "at least 3 measured points, got 0" in said


@pytest.mark.extended
def test_run_gives_the_same_readings_while_it_is_processed_and_afterwards(tmp_path):
    run = write_rendered_run(tmp_path / "run.h5", [slid(0.05)])
    gauges = tmp_path / "gauges.toml"
    gauges.write_text(
        'unit = "mm"\n[[gauge]]\nname = "axial"\nkind = "extensometer"\n'
        "start = [0, -0.8]\nend = [0, 0.8]\npatch = 0.6\n"
        '[[gauge]]\nname = "foil"\nkind = "area"\ncentre = [0, 0]\nsize = [1.5, 1.5]\ndirection_deg = 90\n'
    )
    places = "--csv", tmp_path / "csv", "--json", tmp_path / "r.json"
    done = run_dic("process", run, "--subset", 31, "--step", 15, "--gauges", gauges, *places)
    assert done.status in (0, 1), done
    assert "foil: area, " in done.out
    again = run_dic("gauges", tmp_path / "run.results.h5", gauges, "--json", tmp_path / "g.json")
    assert again.status == 0, again
    during = done.report["gauge_readings"]
    assert json.dumps(during) == json.dumps(again.report["images"])
    # The specimen slid without strain.
    read = during[0]["gauges"]["axial"]["calibrated"]
    assert abs(read["strain"]) < 4 * read["strain_std"]
    assert during[0]["load_n"] == 1000.0
    assert (tmp_path / "csv" / "gauges.csv").read_text().startswith("image,camera,step,load_n")
    # A gauge that lies elsewhere takes no other result away.
    off = tmp_path / "off.toml"
    off.write_text('[[gauge]]\nname = "a"\nkind = "point"\nat = [1, 1]\nwidth = 2\n')
    other = tmp_path / "other.json"
    said = refusal("process", run, "--subset", 31, "--step", 15, "--gauges", off, "--json", other)
    assert "at least 3 measured points, got 0" in said
    assert json.loads(other.read_text())["cameras"]
