"""Regions to measure in the images of a run's cameras, and the grid of another run."""

import hashlib

import h5py
import numpy as np
import pytest

import dic
from dic.pipeline.run_cameras import percent
from dic.runfile.joined import open_run
from simulators.scene.pose import Pose
from tests.command_line import refusal, run_dic
from tests.dic.pipeline.rendered_run import SIDE_PX, SMALL, slid, write_rendered_run
from tests.run_files import write_run

pytestmark = pytest.mark.usefixtures("grids_found_once")
SLIDE_MM = 0.05
CORNERS = [[120, 100], [300, 100], [300, 330], [120, 330]]
FORMATS = {
    "region.toml": f"polygons = [{CORNERS}]\nimage_size_px = [{SIDE_PX}, {SIDE_PX}]\n",
    "region.csv": "x,y\n" + "".join(f"{x},{y}\n" for x, y in CORNERS),
}
WORDS = ("--step", 20)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return write_rendered_run(tmp_path_factory.mktemp("run") / "run.h5", [slid(SLIDE_MM)])


@pytest.fixture
def place(tmp_path, monkeypatch):
    """The working folder, with a region file in each format."""
    monkeypatch.chdir(tmp_path)
    for name, text in FORMATS.items():
        (tmp_path / name).write_text(text)
    return tmp_path


def measured(path):
    """Return position, px, and displacement, mm, of the points with a value, both of shape (points, 2)."""
    (camera,) = dic.load_run_result(path).cameras
    (measurement,) = camera.measurements
    calibrated = measurement.calibrated
    places = np.stack(np.meshgrid(measurement.field.grid.x, measurement.field.grid.y), axis=-1)
    return places[calibrated.valid], calibrated.vector[calibrated.valid]


def test_points_lie_in_the_region_and_are_right(run, place):
    result = place / "r.h5"
    done = run_dic("process", run, *WORDS, "--roi", "aside=region.toml", "-o", result)
    assert (done.status, done.err) == (0, "")
    at, moved_mm = measured(result)
    low, high = np.min(CORNERS, axis=0), np.max(CORNERS, axis=0)
    assert ((at >= low) & (at <= high)).all()
    # Points have a spacing of 20 px, and the outermost ones are at most half a subset inside the region.
    assert (np.ptp(at, axis=0) >= high - low - 41 - 20).all()
    np.testing.assert_allclose(moved_mm.mean(axis=0), [0.0, SLIDE_MM], atol=0.0005)
    with h5py.File(result) as file:
        names, digests = (file[f"provenance/{name}"].asstr()[:] for name in ("file", "sha256"))
    named = dict(zip(names, digests, strict=True))["region.toml"]
    assert named == hashlib.sha256((place / "region.toml").read_bytes()).hexdigest()


@pytest.mark.extended
def test_another_region_is_another_measurement(run, place, correlated):
    first, other = (
        ("--roi", "aside=region.toml"),
        ("--roi", "aside=region.toml", "--polygon", "aside=hole.toml"),
    )
    (place / "hole.toml").write_text("polygon = [[120, 100], [300, 100], [300, 250], [120, 250]]")
    assert run_dic("process", run, *WORDS, *first, "-o", "r.h5").status == 0
    assert "holds these results already" in run_dic("process", run, *WORDS, *first, "-o", "r.h5").out
    assert len(correlated) == 1
    for words in ((), other):
        assert "one that exists" in refusal("process", run, *WORDS, *words, "-o", "r.h5")
        assert "got one with other regions" in refusal(
            "process", run, *WORDS, *words, "-o", "n.h5", "--fields-from", "r.h5"
        )
    assert run_dic("process", run, *WORDS, *other, "-o", "r.h5", "--force").status == 0
    assert len(correlated) == 2
    at, _ = measured(place / "r.h5")
    assert at[:, 1].max() <= 250


@pytest.mark.parametrize(
    ("part", "whole", "said"),
    [(1, 8, "12 %"), (9_998, 10_000, "99.980 %"), (999, 1000, "99.90 %"), (1, 10**8, "0.0000010 %")],
)
def test_a_part_is_in_fixed_notation_and_never_the_whole(part, whole, said):
    assert percent(part, whole) == said


@pytest.mark.filterwarnings("always::dic.errors.ImageWarning")
def test_the_uncalibrated_part_of_a_region_is_named(run, place):
    """At its left edge, the image does not show the grid."""
    half = "0,100 240,100 240,300 0,300"
    done = run_dic("process", run, *WORDS, "--polygon", f"aside={half}", "-o", "r.h5")
    (said,) = done.err.splitlines()
    assert said.endswith("% of the region lies outside the calibrated area and is not measured")
    share = float(said.removeprefix(f"warning: {run}: aside: ").split()[0])
    with open_run(run) as file:
        left_px = dic.pipeline.run_reference(run).calibration.grid.uv_px[:, 0].min()
        assert file.cameras == ["aside"]
    assert share == pytest.approx(100 * left_px / 240, abs=5)
    nothing = "0,0 20,0 20,20 0,20"
    assert refusal("process", run, *WORDS, "--polygon", f"aside={nothing}", "-o", "n.h5") == (
        f"error: {run}: aside: choose the region: expected a region in the calibrated area, which the grid"
        " covers, got one outside of it; draw the region where the grid image shows the grid"
    )
    assert not (place / "n.h5").exists()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--roi", "asde=region.toml"), "choose the region: expected one of aside, got asde; name a camera"),
        (("--roi", "region.toml"), "--roi: expected CAMERA=FILE, got region.toml; name the camera"),
        (("--roi", "aside="), "expected CAMERA=FILE, got aside="),
        (("--polygon", "1,2 3,4 5,6"), "--polygon: expected CAMERA=REGION, got 1,2 3,4 5,6"),
        (("--roi", "aside=region.toml", "--roi", "aside=region.csv"), "expected one file for aside"),
        (
            ("--roi", "aside=absent.toml"),
            "absent.toml: read region of interest: expected a TOML file, got No",
        ),
        (("--roi", "aside=large.toml"), "large.toml: image_size_px: expected a region drawn on an image of"),
        (("--polygon", "aside=1,2 3,4"), "expected a polygon with at least 3"),
    ],
)
def test_a_wrong_region_is_refused_before_anything_is_measured(run, place, options, said, correlated):
    (place / "large.toml").write_text(FORMATS["region.toml"].replace(f"[{SIDE_PX}, ", "[999, "))
    assert said in refusal("process", run, *WORDS, *options, "-o", "r.h5")
    assert correlated == []
    assert not (place / "r.h5").exists()


def test_each_camera_has_its_own_region(tmp_path):
    mask = np.zeros((24, 32), bool)
    mask[5:9, 7:20] = True
    source = dic.pipeline.RunSource(
        write_run(tmp_path / "run.h5"), {"right": mask, "left": lambda shape: ~mask}
    )
    with open_run(source.path) as file:
        masks = source.masks(file)
    assert list(masks) == ["right", "left"]
    assert (masks["right"] == mask).all()
    assert (masks["left"] == ~mask).all()


def test_the_reference_image_of_a_camera_can_be_drawn_on(place):
    two = write_run(place / "two.h5")
    assert "choose a camera: expected left or right, got none; give --camera left" in refusal("draw", two)
    assert "choose a camera: expected left or right, got up; give --camera left" in refusal(
        "draw", two, "--camera", "up"
    )
    one = write_rendered_run(place / "one.h5", [], grid_pose=Pose())
    done = run_dic("draw", one, "--roi", "region.toml")
    assert done.status == 0
    assert "then: dic process one.h5 --roi aside=region.toml" in done.out.replace(f"{place}/", "")
    page = (place / "one-aside-drawing.html").read_text("utf-8")
    assert "Regions and gauges on one.h5, aside" in page
    assert f'"width": {SIDE_PX}' in page
    assert '"calibration": {' in page


def test_a_run_without_a_grid_is_measured_with_that_of_another(run, place):
    bare = write_rendered_run(place / "bare.h5", [slid(SLIDE_MM)], has_grid=False)
    assert "--grid-from" in refusal(run_dic("process", bare, *WORDS))
    done = run_dic("process", bare, *WORDS, "--grid-from", run, "-o", place / "r.h5")
    assert (done.status, done.err) == (0, "")
    np.testing.assert_allclose(measured(place / "r.h5")[1].mean(axis=0), [0.0, SLIDE_MM], atol=0.0005)
    small = write_rendered_run(place / "small.h5", [slid(SLIDE_MM)], camera=SMALL, has_grid=False)
    assert "280 × 280 px" in refusal(run_dic("process", small, *WORDS, "--grid-from", run))
