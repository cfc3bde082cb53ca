"""Tests of the curve from gauges: the load comes from a run or a record; strains have a shared error."""

import numpy as np
import pytest

from dic import material_properties, measure_gauges
from dic.derived import ImageClock, gauge_curve
from dic.errors import CurveError, GaugeError
from dic.gauges import Extensometer, GaugeImage, GaugeSeries, Reading, TransverseExtensometer
from dic.gauges.reading import SharedPart
from dic.pipeline import save_run_result
from dic.properties import PropertySettings, with_shared_error
from dic.runfile.reader import RunStep
from simulators.scene.pose import Pose
from tests.command_line import refusal
from tests.dic.out_of_plane.exact_views import State
from tests.dic.pipeline.exact_runs import run_of

AXIAL = Extensometer(name="axial", unit="mm", start=(0.0, -3.0), end=(0.0, 3.0), patch=1.5)
WIDTH = TransverseExtensometer(
    name="width", unit="mm", start=(-3.0, 0.0), end=(3.0, 0.0), patch=1.2, spread=5.0
)
COUNT = 15


def image(k, camera="aside", **change):
    strain = 1e-4 * k
    corrected = Reading("mm", strain=strain, strain_std=5e-6, strain_std_images=3e-6, **change)
    across = Reading("mm", strain=-0.3 * strain, strain_std=5e-6, strain_std_images=3e-6)
    raw = Reading("px", strain=1.4 * strain, strain_std=2e-6, strain_std_images=2e-6)
    readings = {"axial": {"raw": raw, "corrected": corrected}, "width": {"raw": raw, "corrected": across}}
    known = {"camera": camera, "step": f"load {k}", "load_n": 200.0 * k, "time_s": 2.0 * k}
    return GaugeImage(f"step {k}", readings, known)


def series_of(*images):
    return GaugeSeries("run.results.h5", (AXIAL, WIDTH), tuple(images))


def test_best_strain_of_a_run_stands_beside_its_load():
    found = gauge_curve(series_of(*map(image, range(COUNT))), "axial", "width")
    np.testing.assert_allclose(found.curve.load_n, 200.0 * np.arange(COUNT))
    np.testing.assert_allclose(found.curve.strain, 1e-4 * np.arange(COUNT))
    np.testing.assert_allclose(found.curve.transverse, -3e-5 * np.arange(COUNT))
    np.testing.assert_allclose(found.curve.time_s, 2.0 * np.arange(COUNT))
    # 5² = 3² + 4²
    np.testing.assert_allclose(found.shared_std, 4e-6)
    assert (found.kind, found.left_out) == ("corrected", 0)


def shared_of(k, causes):
    """Return made-up errors of exx, eyy, exy of image `k`: their covariance, and those by three causes."""
    mounting = 1e-6 * k * np.array([[1.0, -2.0, 0.5], [3.0, 1.0, -1.0], [0.4, 0.2, 0.3]])
    shift = np.outer([4e-6, 4e-6, 0.0], [4e-6, 4e-6, 0.0]) + np.diag([1e-12, 2e-12, 3e-12])
    return mounting @ mounting.T + shift, mounting[:, :causes]


def image_with_shared(k, *, causes=3, lost=()):
    covariance, mounting = shared_of(k, causes)
    strains = {"axial": (1e-4 * k, [0.1, 0.8, 0.6]), "width": (-3e-5 * k, [0.9, 0.1, -0.6])}
    readings = {}
    for name, (strain, weights) in strains.items():
        weights = np.array(weights)
        part = SharedPart(covariance, weights, mounting)
        std = np.sqrt(weights @ covariance @ weights + 9e-12)
        read = Reading("mm", strain=strain, strain_std=std, strain_std_images=3e-6, shared=part)
        readings[name] = {"corrected": Reading("mm", reason="lost") if name in lost else read}
    return GaugeImage(f"step {k}", readings, {"load_n": 200.0 * k})


@pytest.mark.parametrize("mixed", [False, True])
def test_errors_of_mounting_and_of_other_causes_add_up_to_the_covariance(mixed):
    images = [image_with_shared(k, lost=("width",) if k == 6 else ()) for k in range(COUNT)]
    images[3] = GaugeImage("step 3", failure="dark", known={"load_n": 600.0})
    if mixed:
        # One image was corrected by a method that has no such errors.
        images[9] = image_with_shared(9, causes=0)
    found = gauge_curve(series_of(*images), "axial", "width")
    assert found.followed.shape == (COUNT - 1, 2, 0 if mixed else 3)
    for row, k in enumerate(k for k in range(COUNT) if k != 3):
        covariance, mounting = shared_of(k, 3)
        weights = np.array([[0.1, 0.8, 0.6], [0.9, 0.1, -0.6]])
        total = weights @ covariance @ weights.T
        followed = found.followed[row]
        if k == 6:
            assert np.isnan(followed[1]).all()
            followed, total = followed[:1], total[:1, :1]
        if not mixed:
            np.testing.assert_allclose(followed, (weights @ mounting)[: len(followed)], atol=1e-18)
        grown = np.array([[found.shared_std[row], 0.0], [*found.shared_transverse[row]]])[: len(followed)]
        np.testing.assert_allclose(grown @ grown.T + followed @ followed.T, total, rtol=1e-9, atol=1e-20)


def test_raw_strain_can_be_chosen_and_states_no_shared_error():
    found = gauge_curve(series_of(*map(image, range(COUNT))), "axial", kind="raw")
    np.testing.assert_allclose(found.curve.strain, 1.4e-4 * np.arange(COUNT))
    assert np.isnan(found.shared_std).all()
    assert found.curve.transverse is None


def test_images_without_a_reading_are_left_out_and_counted():
    lost = GaugeImage("step 7", failure="dark", known={"camera": "aside"})
    images = [*map(image, range(7)), lost, *map(image, range(8, COUNT))]
    found = gauge_curve(series_of(*images), "axial")
    assert (len(found.curve.strain), found.left_out) == (COUNT - 1, 1)


def test_camera_of_a_run_of_several_must_be_chosen():
    both = series_of(*(image(k, camera) for camera in ("aside", "straight") for k in range(COUNT)))
    with pytest.raises(GaugeError, match="choose a camera: expected one of aside, straight, got none"):
        gauge_curve(both, "axial")
    assert len(gauge_curve(both, "axial", camera="straight").curve.strain) == COUNT


def test_strain_without_load_is_refused():
    bare = series_of(*(GaugeImage(one.label, one.readings) for one in map(image, range(COUNT))))
    with pytest.raises(CurveError, match="a load for each image, got none; give the machine's record"):
        gauge_curve(bare, "axial")


E_MPA, AREA_MM2, NU = 200_000.0, 10.0, 0.3


def elastic_run(count):
    """Return a run with two cameras and a specimen that tilts in proportion to its load, up to 0.15°."""
    strains = np.linspace(0.0001, 0.0015, count)
    steps = [
        RunStep(2 + k, "load", 0.0, float(E_MPA * AREA_MM2 * e), 0.1, np.nan, 9.0 * k)
        for k, e in enumerate(strains)
    ]
    states = [
        State(Pose.sloped(0.15 * e / strains[-1], -0.1 * e / strains[-1], 0.0), np.diag([1 - NU * e, 1 + e]))
        for e in strains
    ]
    return run_of(steps, states, states)


def test_result_file_of_a_run_gives_the_load(tmp_path):
    save_run_result(elastic_run(2), tmp_path / "r.h5")
    gauge = "axial=extensometer start=0,-3 end=0,3 patch=1.5 unit=mm"
    arguments = "properties", tmp_path / "r.h5", "--declare", gauge, "--area-mm2", AREA_MM2
    assert "choose a camera: expected one of aside, straight" in refusal(*arguments)
    assert "at least 10 points, got 2" in refusal(*arguments, "--camera", "aside")


@pytest.mark.long
def test_modulus_of_a_tilting_specimen_is_right_if_corrected_and_its_error_is_stated():
    series = measure_gauges(elastic_run(14), [AXIAL, WIDTH])
    settings = PropertySettings(AREA_MM2)
    found = {}
    for kind in ("corrected", "calibrated"):
        read = gauge_curve(series, "axial", "width", kind=kind, camera="aside")
        plain = material_properties(read.curve, settings)
        judged = with_shared_error(plain, read.shared_std, read.shared_transverse, read.followed)
        found[kind] = judged.values["E_gpa"]
    truth = E_MPA / 1e3
    # A strain of 1500 µε is short: an error of 20 µε is 1.3 % of it.
    assert abs(found["corrected"].value - truth) < 0.02 * truth
    assert found["corrected"].std < 0.015 * truth
    assert abs(found["corrected"].value - truth) < 3.5 * found["corrected"].std
    assert abs(found["calibrated"].value - truth) > 0.1 * truth
    assert abs(found["calibrated"].value - truth) < 3.5 * found["calibrated"].std


def test_equal_times_of_images_are_no_times():
    """Exif tags in whole seconds cannot tell the images of a faster camera apart."""
    timed = [{"time_s": time_s, "time_source": "exif"} for time_s in (0.0, 1.0, 1.0, 2.0)]
    images = [GaugeImage(f"img{k}.jpg", known=known) for k, known in enumerate(timed)]
    words = (
        "a time of its own for each image, got 1 s for both img1.jpg and img2.jpg; give --image-interval-s"
    )
    with pytest.raises(CurveError, match=words):
        ImageClock().of(images)
    times_s, source = ImageClock().of(images[::2])
    assert (times_s.tolist(), source) == ([0.0, 1.0], "exif")
