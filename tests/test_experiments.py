"""Complete virtual experiments, from protocol files to strains, reproduce the paper's results."""

import numpy as np
import pytest

from dic.correlation.settings import CorrelationSettings
from dic.pipeline.run import process_run
from rig.run import run_protocol
from tests.places import example, small_cameras

# A quarter of the default's points: means over a thousand of them still have less than 2 µε of noise.
COARSE = CorrelationSettings(subset_px=31, step_px=20, shape="quadratic")
SMALL = small_cameras(450, 1400.0)
"""The view of the examples with fewer pixels: means of some 300 points have less than 4 µε of noise."""
MICRO = 1e6


def experiment(folder, protocol, rig, increment, *changes):
    """Run an example protocol on an example rig, both with changed lines, and measure the run."""
    files = [folder / "protocol.toml", folder / "rig.toml"]
    for path, name, edits in zip(files, (protocol, rig), ([increment], changes), strict=True):
        path.write_text(example(name, *edits))
    outcome = run_protocol(*files, folder / "run.h5")
    assert outcome.status == "completed", outcome.reason
    result = process_run(folder / "run.h5", COARSE)
    assert not [failure for camera in result.cameras for failure in camera.failures]
    return {camera.camera: camera for camera in result.cameras}, result.corrections


def calibrated(camera):
    """Return the calibrated exx, eyy, exy of all steps, µε, shape (steps, 3)."""
    means = [m.calibrated_mean for m in camera.measurements]
    return MICRO * np.array([[m.exx, m.eyy, m.exy] for m in means])


def corrected(corrections):
    """Return the corrected exx, eyy, exy of all steps, µε, shape (steps, 3); NaN if declined."""
    return MICRO * np.array(
        [[np.nan] * 3 if c.declined else [c.mean.exx, c.mean.eyy, c.mean.exy] for c in corrections]
    )


def raw(camera):
    return MICRO * np.array([[m.raw_mean.exx, m.raw_mean.eyy, m.raw_mean.exy] for m in camera.measurements])


def at(camera, angle_deg):
    return next(k for k, step in enumerate(camera.steps) if abs(step.angle_deg - angle_deg) < 0.1)


@pytest.mark.long
@pytest.mark.parametrize("increment_deg", [45.0, 22.5])
def test_an_aligned_rotation_is_free_of_strain_at_30_degrees(tmp_path, increment_deg):
    aligned = ("axis_slope_x_deg = 0.2", "axis_slope_x_deg = 0.0")
    increment = ("increment_deg = 22.5", f"increment_deg = {increment_deg}")
    cameras, corrections = experiment(tmp_path, "rotation", "rig-virtual-rotation-30", increment, aligned)
    assert len(cameras["off_axis"].measurements) == 360.0 / increment_deg
    for camera in cameras.values():
        assert np.abs(calibrated(camera)).max() < 100
        assert all(m.field.converged.sum() >= 0.99 * m.field.in_view for m in camera.measurements)
        assert {m.field.start for m in camera.measurements} == {"hint"}
    assert np.abs(raw(cameras["off_axis"])).max() > 150_000
    # Nothing to correct: the correction may add no more than its own uncertainty.
    assert corrections.motion == "rigid"
    images = corrections.cameras["off_axis"].images
    bias = corrected(images) - calibrated(cameras["off_axis"])
    std = MICRO * np.array([[c.mean.exx_std, c.mean.eyy_std, c.mean.exy_std] for c in images])
    assert np.abs(corrected(images)).max() < 20
    assert (np.abs(bias) < 3 * std + 10).all()


@pytest.mark.parametrize(
    ("angle_deg", "bias"),
    [
        pytest.param(10, 1232, marks=pytest.mark.long),
        pytest.param(20, 2548, marks=pytest.mark.long),
        (30, 4047),
    ],
)
def test_an_axis_off_by_a_fifth_of_a_degree_gives_the_papers_bias(tmp_path, angle_deg, bias):
    # Figures of exact geometry, independent of this code: a wobble of 0.2 degrees seen at 180 degrees.
    # A quarter of the paper's steps tells the same.
    coarse = ("increment_deg = 22.5", "increment_deg = 90.0")
    cameras, corrections = experiment(
        tmp_path, "rotation", f"rig-virtual-rotation-{angle_deg}", coarse, SMALL
    )
    off_axis = cameras["off_axis"]
    half_turn = at(off_axis, 180.0)
    exx = calibrated(off_axis)[:, 0]
    assert exx[half_turn] == pytest.approx(bias, rel=0.10)
    assert np.argmax(np.abs(exx)) == half_turn
    assert np.abs(calibrated(cameras["on_axis"])).max() < 100
    # And the same images without it.
    found = corrections.cameras["off_axis"]
    assert np.abs(corrected(found.images)).max() < 20
    np.testing.assert_allclose(found.alignment.wobble_deg, [0.2, 0.0], atol=0.005)
    assert any("stage's axis leans" in finding for finding in corrections.findings["off_axis"])


@pytest.mark.extended
def test_tension_on_axis_is_the_strain_that_the_specimen_had(tmp_path):
    coarse = ("increment_mm = 0.3", "increment_mm = 1.0")
    cameras, corrections = experiment(tmp_path, "tension", "rig-virtual-tension", coarse, SMALL)
    on_axis, off_axis = cameras["on_axis"], cameras["off_axis"]
    steps = on_axis.steps
    assert [s.kind for s in steps[:4]] == ["load"] * 4
    assert steps[-1].displacement_mm == pytest.approx(5.0, abs=0.003)
    elastic = [k for k, step in enumerate(steps) if step.kind == "load" and step.load_n < 6100]
    assert len(elastic) == 3
    measured = calibrated(on_axis)
    for k in elastic:
        # Hooke on the declared section: 1 mm x 25 mm of 2024-T3, E = 73.1 GPa, nu = 0.33 (MIL-HDBK-5J).
        axial = steps[k].load_n / 25.0 / 73_100
        expected = MICRO * np.array([((1 - 0.33 * axial) ** 2 - 1) / 2, ((1 + axial) ** 2 - 1) / 2, 0.0])
        np.testing.assert_allclose(measured[k], expected, atol=50)
    # The paper's bias: about a thousand µε in the direction of the camera's tilt, none across it.
    difference = calibrated(off_axis) - measured
    assert 500 < np.abs(difference[elastic[-1], 1]) < 1500
    assert np.abs(difference[elastic][:, [0, 2]]).max() < 60
    # Corrected, by one camera and by two, it is the strain that the specimen had.
    assert corrections.motion == "tension"
    assert corrections.joint.cameras == ("off_axis", "on_axis")
    one = corrected(corrections.cameras["off_axis"].images)
    two = MICRO * np.array(
        [[b.mean.exx, b.mean.eyy, b.mean.exy] for _, b in sorted(corrections.joint.steps.items()) if b.mean]
    )
    assert len(two) == len(measured)
    np.testing.assert_allclose(one[elastic], measured[elastic], atol=50)
    np.testing.assert_allclose(two[elastic], measured[elastic], atol=20)
    scale = np.abs(measured).max(axis=1, keepdims=True)
    assert (np.abs(one - measured) < 0.002 * scale + 50).all()
    assert (np.abs(two - measured) < 0.002 * scale + 20).all()
    # The grips tip the specimen by up to 0.1 degrees about X.
    last = corrections.joint.steps[steps[-1].index].plane
    np.testing.assert_allclose(np.degrees([last.slope_x, last.slope_y]), [0.0, -0.1], atol=0.005)
