"""`dic correlate --motion` removes false strain from out-of-plane motion; tested on rendered images."""

import csv
import json
import re
from pathlib import Path

import h5py
import numpy as np
import pytest

from dic import Motion
from dic.commands.options import Chosen
from dic.commands.strain import AnewOptions
from simulators.scene.optics import PinholeCamera
from simulators.scene.pose import Pose
from simulators.scene.render import render
from simulators.scene.scene import Misalignment, Surface
from simulators.scene.sensor import Sensor
from simulators.scene.texture import LineGrid, Speckle
from tests.command_line import refusal, run_dic
from tests.image_files import write_image

MICRO = 1e6
SENSOR = Sensor(8, 32_500.0, 20.0, 12_000.0)
# One grey level of noise; the camera stands 30° aside and sees 5 mm of speckle on 420 px.
SIDE_PX, FOCAL_PX = 420, 2000.0


class Studio:
    """A simulated camera that writes rendered images of a grid or a specimen to a folder."""

    def __init__(self, folder, **place):
        self.folder, self.rng = folder, np.random.default_rng(7)
        self.camera = PinholeCamera(SIDE_PX, SIDE_PX, FOCAL_PX, **place)
        self.speckle = Speckle.sprayed(11)
        # A finer grid than the paper's, as the view is smaller.
        grid = self.shoot("grid.png", Surface(LineGrid(pitch_mm=0.35, overhang_mm=0.05, plate_half_mm=4.2)))
        self.calibration = folder / "cal.h5"
        done = run_dic("calibrate", grid, "--pitch-mm", 0.35, "-o", self.calibration)
        assert done.status == 0, done

    def shoot(self, name, surface):
        image = SENSOR.expose(render(self.camera, surface), 10_000.0, 1.0, self.rng)
        return write_image(self.folder / name, image)

    def specimen(self, name, pose, F=None):
        return self.shoot(name, Surface(self.speckle, pose, np.eye(2) if F is None else F))

    def correlate(self, reference, deformed, *options):
        report = self.folder / "report.json"
        files = [reference, *deformed, "--calibration", self.calibration, "--json", report, "--force"]
        settings = "--subset", 31, "--step", 16, "--shape", "quadratic", "--strain-window", 5
        done = run_dic("correlate", *files, *settings, *options)
        assert done.status == 0, done
        return done.out, done.report


@pytest.fixture(scope="module")
def turned(tmp_path_factory):
    studio = Studio(tmp_path_factory.mktemp("turned"), pan_deg=30.0)
    stage = Misalignment(axis_slope_x_deg=0.2)
    reference = studio.specimen("reference.png", Pose())
    images = [studio.specimen(f"{a}.png", stage.turned(a)) for a in (60, 180, 300)]
    return studio, reference, images


@pytest.fixture(scope="module")
def pulled(tmp_path_factory):
    studio = Studio(tmp_path_factory.mktemp("pulled"), tilt_deg=30.0)
    F = np.diag([1.0 - 0.33 * 0.003, 1.003])
    reference = studio.specimen("reference.png", Pose())
    return studio, reference, studio.specimen("pulled.png", Pose.sloped(0.03, -0.15), F), F


@pytest.fixture(scope="module")
def corrected(turned):
    """What is printed, the report, and the folder of all outputs of the corrected rotation."""
    studio, reference, images = turned
    folder = studio.folder / "corrected"
    files = "--save-alignment", folder / "alignment.json", "-o", folder / "r.h5", "--csv", folder
    folder.mkdir()
    return *studio.correlate(reference, images, "--motion", "rigid", *files), folder


def means(image, kind):
    return MICRO * np.array([image[kind][name] for name in ("exx", "eyy", "exy")])


@pytest.mark.extended
def test_rigid_motion_loses_its_false_strain_and_tells_the_misalignment(turned, corrected):
    studio, reference, images = turned
    printed, report, folder = corrected
    false = np.array([means(image, "calibrated") for image in report["images"]])
    left = np.array([means(image, "corrected") for image in report["images"]])
    assert np.abs(false).max() > 3500
    assert np.abs(left).max() < 40
    assert all(image["corrected"]["applied"] for image in report["images"])
    assert report["alignment"]["wobble_x_deg"] == pytest.approx(0.2, abs=0.005)
    assert report["alignment"]["wobble_y_deg"] == pytest.approx(0.0, abs=0.005)
    assert report["sensitivity"]["off_axis_deg"] == pytest.approx(30.0, abs=0.05)
    assert re.search(r"corrected +-?\d+\.\d ± \d\.\d", printed)
    with h5py.File(folder / "r.h5") as file:
        stored = MICRO * file["series/corrected_mean/exx"][:]
        np.testing.assert_allclose(stored, left[:, 0], atol=1e-6)
    # The same alignment serves a single image, which alone would not tell it.
    printed, report = studio.correlate(
        reference, images[1:2], "--motion", "rigid", "--alignment", folder / "alignment.json"
    )
    assert report["images"][0]["corrected"]["method"] == "alignment"
    assert np.abs(means(report["images"][0], "corrected")).max() < 40


def test_figures_are_kept_although_there_is_no_alignment_to_save(turned, tmp_path):
    studio, reference, images = turned
    report = tmp_path / "report.json"
    files = [
        "correlate",
        reference,
        images[0],
        "--calibration",
        studio.calibration,
        "--json",
        report,
        "--force",
    ]
    assert "none: see why" in refusal(*files, "--motion", "rigid", "--save-alignment", tmp_path / "a.json")
    assert len(json.loads(report.read_text())["images"]) == 1


def test_one_image_of_a_rotation_is_not_corrected(turned):
    studio, reference, images = turned
    printed, report = studio.correlate(reference, images[:1], "--motion", "rigid")
    corrected = report["images"][0]["corrected"]
    assert not corrected["applied"]
    assert "at least 2 images" in corrected["reason"]
    assert corrected["exx"] == report["images"][0]["calibrated"]["exx"]
    assert "not corrected" in printed


def test_tension_loses_the_tilt_and_keeps_the_strain(pulled):
    studio, reference, image, F = pulled
    E = (F.T @ F - np.eye(2)) / 2
    true = MICRO * np.array([E[0, 0], E[1, 1], E[0, 1]])
    _, report = studio.correlate(reference, [image], "--motion", "tension", "--shift-std-um", "0")
    found = report["images"][0]
    assert np.abs(means(found, "calibrated") - true).max() > 1000
    assert np.abs(means(found, "corrected") - true).max() < 50
    assert found["corrected"]["slope_y_deg"] == pytest.approx(-0.15, abs=0.005)
    assert found["corrected"]["slope_x_deg"] == pytest.approx(0.03, abs=0.005)
    assert 0 < found["corrected"]["eyy_std"] < 50e-6


def test_the_shift_that_one_camera_cannot_see_is_a_stated_part_of_the_uncertainty(pulled):
    studio, reference, image, _ = pulled
    printed, report = studio.correlate(reference, [image], "--motion", "tension", "--shift-std-um", "20")
    corrected, per_um = report["images"][0]["corrected"], report["sensitivity"]["per_um"]
    assert corrected["exx_std_shift"] == pytest.approx(20 * per_um, rel=0.02)
    assert corrected["exx_std"] > corrected["exx_std_shift"]
    assert f"± {1e6 * corrected['exx_std_shift']:.0f} µε of exx and eyy is the shift" in printed
    assert max(len(line) for line in printed.splitlines() if "±" in line) <= 100
    assert "--shift-std-um" in refusal_of_a_negative_shift(studio, reference, image)


def stated(folder, name):
    """Return the standard deviation of the calibrated exx and its part from the images, from the files."""
    with h5py.File(folder / "r.h5") as file:
        mean = file["series/calibrated_mean"]
        last = [mean["exx_std"][-1], mean["exx_std_images"][-1]]
    rows = list(csv.DictReader((folder / f"{name}.csv").read_text().splitlines()))
    local = [[float(row[key] or "nan") for row in rows] for key in ("exx_std", "exx_std_images")]
    return np.array(last), np.nanmedian(local, axis=1)


def test_every_file_states_the_motion_that_calibrated_strain_may_contain(pulled, corrected, tmp_path):
    studio, reference, image, _ = pulled
    found = [("rigid", *corrected[1:])]
    for motion in ("tension", "free"):
        folder = tmp_path / motion
        folder.mkdir()
        files = "-o", folder / "r.h5", "--csv", folder
        found.append((motion, studio.correlate(reference, [image], "--motion", motion, *files)[1], folder))
    for motion, report, folder in found:
        last = report["images"][-1]
        calibrated = last["calibrated"]
        # 30 µm from 40 mm · cos 30° is 870 µε, and the tilt costs a rotation up to 4000 µε.
        off = abs(calibrated["exx"] - last["corrected"]["exx"])
        assert calibrated["exx_std"] > (0.9 * off if motion == "rigid" else 800e-6)
        assert calibrated["exx_std_images"] < 20e-6
        mean, local = stated(folder, Path(last["file"]).stem)
        assert mean == pytest.approx([calibrated["exx_std"], calibrated["exx_std_images"]], rel=1e-9)
        assert local[0] == pytest.approx(calibrated["exx_std"], rel=0.1)
        assert local[1] < 0.3 * local[0]


def test_a_hinge_tells_the_shift_from_the_tilt(pulled):
    studio, reference, image, _ = pulled
    for text in ("0,-20", "-20"):
        printed, report = studio.correlate(reference, [image], "--motion", "tension", "--tilt-axis-mm", text)
        corrected = report["images"][0]["corrected"]
        # The surface keeps its height 20 mm below the grid's centre and falls towards +Y.
        shift_um = 20e3 * np.tan(np.radians(corrected["slope_y_deg"]))
        assert shift_um == pytest.approx(-52.4, abs=2.0)
        assert 1e3 * corrected["shift_mm"] == pytest.approx(shift_um, rel=1e-6)
        assert 5.0 < 1e3 * corrected["shift_mm_std"] < 8.0
        assert f"shift {shift_um:+.1f} ± {1e3 * corrected['shift_mm_std']:.1f} µm" in printed
    calibrated = ("correlate", reference, image, "--calibration", studio.calibration, "--motion", "tension")
    for text in ("up", "1,2,3", "0,nan"):
        assert "give --tilt-axis-mm 0,-30" in refusal(*calibrated, "--tilt-axis-mm", text)


def refusal_of_a_negative_shift(studio, reference, image):
    calibrated = ("correlate", reference, image, "--calibration", studio.calibration)
    return refusal(*calibrated, "--motion", "tension", "--shift-std-um", "-1")


def test_free_motion_is_not_corrected(pulled):
    studio, reference, image, _ = pulled
    _, report = studio.correlate(reference, [image])
    corrected = report["images"][0]["corrected"]
    assert not corrected["applied"]
    assert corrected["eyy"] == report["images"][0]["calibrated"]["eyy"]


def test_settings_that_make_no_sense_are_refused(pulled, tmp_path):
    studio, reference, image, _ = pulled
    alignment, broken = tmp_path / "alignment.json", tmp_path / "broken.json"
    content = {"slopes": [0.0] * 4, "covariance": np.zeros((4, 4)).tolist(), "pivot_mm": [0.0, 0.0]}
    alignment.write_text(json.dumps({"file_format": "offaxis-alignment"} | content))
    broken.write_text("{")
    files = ["correlate", reference, image]
    calibrated = [*files, "--calibration", studio.calibration]
    assert "one of free, rigid, tension, got wild" in refusal(*calibrated, "--motion", "wild")
    assert "expected 0 to 0.5, got 0.7" in refusal(*calibrated, "--poisson-ratio", 0.7)
    tension = refusal(*calibrated, "--motion", "tension", "--alignment", alignment)
    assert "expected --motion rigid" in tension
    assert "cut off" in refusal(*calibrated, "--motion", "rigid", "--alignment", broken)
    assert "name a calibration file, such as --calibration cal.h5" in refusal(*files, "--motion", "rigid")
    unsolved = refusal(*calibrated, "--motion", "tension", "--save-alignment", tmp_path / "a.json")
    assert "expected --motion rigid, got tension" in unsolved


def test_settings_stay_when_the_motion_is_changed_and_changed_back():
    known = Motion("tension", poisson_ratio=0.4, shift_std_um=20.0, tilt_axis_mm=(1.0, 2.0))
    for kind in ("free", "tension"):
        known = AnewOptions(None, ()).of_series(Chosen(Motion, {"kind": kind}), known)
    assert known == Motion("tension", poisson_ratio=0.4, shift_std_um=20.0, tilt_axis_mm=(1.0, 2.0))
    rigid = AnewOptions(None, ()).of_series(Chosen(Motion, {"kind": "rigid"}), known)
    assert rigid == Motion("rigid", poisson_ratio=0.4, shift_std_um=20.0)


def test_still_images_tell_the_errors_of_a_warming_camera(pulled):
    studio, reference, deformed, F = pulled
    known = ("--motion", "tension", "--shift-std-um", 0)
    out, quiet = studio.correlate(reference, [deformed], *known, "--static", studio.specimen("s.png", Pose()))
    assert "1 still image shows" in out
    (before,) = studio.correlate(reference, [deformed], *known)[1]["images"]
    assert quiet["images"][0]["corrected"]["eyy_std"] < 1.2 * before["corrected"]["eyy_std"]
    cold = studio.camera
    try:
        for k in (1, 2, 3):
            studio.camera = PinholeCamera(SIDE_PX, SIDE_PX, FOCAL_PX * (1 + 5e-4 * k), tilt_deg=30.0)
            warm = studio.specimen(f"warm{k}.png", *((Pose(),) if k < 3 else (Pose.sloped(0.03, -0.15), F)))
    finally:
        studio.camera = cold
    stills = "--static", studio.folder / "warm[12].png"
    out, report = studio.correlate(reference, [warm], *known, *stills)
    assert "2 still images show" in out
    assert "a drift" in out
    corrected = report["images"][0]["corrected"]
    # the third image is 1500 ppm larger
    assert corrected["exx_std_still"] == pytest.approx(1.5e-3, rel=0.15)
    assert abs(corrected["eyy"] - 0.0030045) < 2 * corrected["eyy_std"]
    assert len(report["still"]["drift_mm"]) == 17
    anew = studio.folder / "anew.h5"
    studio.correlate(reference, [warm], *known, *stills, "-o", anew)
    again = run_dic("strain", anew, "--json", studio.folder / "again.json", "--force").report
    assert again["images"][0]["corrected"]["exx_std_still"] == pytest.approx(corrected["exx_std_still"])


def test_still_images_need_a_calibration_and_a_specimen_at_rest(pulled):
    studio, reference, deformed, _ = pulled
    assert "give --calibration cal.h5" in refusal("correlate", reference, deformed, "--static", reference)
    files = reference, deformed, "--calibration", studio.calibration, "--static", deformed
    assert "give images from before the test" in refusal("correlate", *files)


def test_the_thickness_corrects_the_shift_of_a_thinner_specimen(pulled):
    studio, reference, _, F = pulled
    thin_mm = -3.0 * 0.33 * 0.003
    deformed = studio.specimen("thin.png", Pose.sloped(0.0, 0.0, thin_mm), F)
    known = ("--motion", "tension", "--shift-std-um", 0)
    out, report = studio.correlate(
        reference, [deformed], *known, "--thickness-mm", 6, "--fixed-face", "middle"
    )
    corrected = report["images"][0]["corrected"]
    assert corrected["thinning_um"] == pytest.approx(1e3 * thin_mm, rel=0.06)
    assert abs(corrected["exx"] + 0.00099) < 2 * corrected["exx_std"]
    assert report["shift"]["thickness_mm"] == 6.0
    assert "the specimen became thinner: shift" in out
