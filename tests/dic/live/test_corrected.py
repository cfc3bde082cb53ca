"""Live strain that is corrected for motion out of the plane, beside the offline correction of the frames.

Fields are solved now and then, and their motion is used some frames later, as by another process.
"""

import numpy as np
import pytest

from dic.errors import GaugeError
from dic.gauges import Extensometer, StrainGauge
from dic.live import FieldSolver, LiveCamera, LivePair, PairSolver, Reason, surface_of
from dic.out_of_plane.correct import correct
from dic.out_of_plane.correction import stated
from dic.out_of_plane.motion import Motion
from dic.out_of_plane.two_cameras import correct_with_two_cameras
from simulators.scene.pose import Pose
from tests.dic.live.rendered_frames import TENSION, RenderedCamera, offline, stretched

GAUGES = (
    Extensometer(name="axial", unit="mm", start=(-0.6, -1.2), end=(-0.6, 1.2), patch=0.6),
    StrainGauge(name="area", unit="mm", centre=(0.5, 0.4), size=(0.9, 0.9), direction_deg=90.0),
)
FRAMES, PERIOD_S, EVERY, LATE = 10, 0.25, 3, 1


def state(k):
    """Return pose and deformation of the specimen at a frame: it straightens while it is stretched."""
    part = 1.0 - np.exp(-k / 5.0)
    return Pose.sloped(0.1 * part, -0.15 * part, 0.01 * part), stretched(4e-4 * k)


def followed(live, solver, cameras, corrections_of):
    """Return of each valid corrected value its difference to offline, its std, its true error and its age."""
    found, waiting = [], {}
    for k in range(FRAMES):
        frames = tuple(camera.frame(*state(k)) for camera in cameras)
        if k % EVERY == 0:
            waiting[k + LATE] = solver(frames, PERIOD_S * k)
        images = live.measure(frames, PERIOD_S * k)
        if k in waiting:
            live.take(waiting[k])
        for image, (setup, measured, correction) in zip(images, corrections_of(frames), strict=True):
            if correction.declined:
                continue
            there = setup.placed.read(stated(measured, correction), correction)
            for gauge in image.gauges.values():
                value, expected = gauge.value(), there[gauge.name]["corrected"]
                if value.valid:
                    assert value.kind == "corrected"
                    error = value.strain - (state(k)[1][1, 1] - 1.0)
                    found.append((value.strain - expected.strain, value.std, error, image.age_s))
    return np.array(found).T


def test_two_cameras_correct_each_frame_by_themselves():
    cameras = RenderedCamera(0, 30.0), RenderedCamera(1, -20.0)
    setups = tuple(camera.setup(GAUGES, motion=TENSION) for camera in cameras)
    surface = surface_of(*setups)
    live, solver = LivePair(*map(LiveCamera, setups), surface), PairSolver(*setups, surface)
    calibrations = tuple(setup.calibration for setup in setups)

    def corrections_of(frames):
        measured = tuple(offline(*both) for both in zip(setups, frames, strict=True))
        step = correct_with_two_cameras(measured, calibrations, surface)
        return list(zip(setups, measured, step.corrections, strict=True))

    off, std, error, _ = followed(live, solver.solve, cameras, corrections_of)
    assert len(off) >= 20
    assert np.mean(np.abs(off) <= 2 * std) >= 0.93
    # Not because of large standard deviations: the values are close, and the errors are as stated.
    assert np.sqrt(np.mean(off**2)) < 30e-6
    assert 0.6 < np.sqrt(np.mean((error / std) ** 2)) < 1.5


def test_one_camera_holds_the_motion_of_the_last_field_and_states_its_age():
    cameras = (RenderedCamera(0, 30.0),)
    # The shift is stated as known, so that the age of the motion is the main error of the difference.
    setup = cameras[0].setup(GAUGES, motion=Motion("tension", shift_std_um=1.0))

    class Alone:
        camera = LiveCamera(setup)

        def measure(self, frames, time_s):
            return (self.camera.measure(frames[0], time_s),)

        def take(self, motion):
            self.camera.take(motion)

    solver = FieldSolver(setup, coarser=1)

    def corrections_of(frames):
        measured = offline(setup, frames[0])
        return [(setup, measured, correct([measured], setup.calibration, setup.motion).images[0])]

    off, std, _, age_s = followed(
        Alone(), lambda frames, time_s: solver.solve(frames[0], time_s), cameras, corrections_of
    )
    assert len(off) >= 8
    assert np.mean(np.abs(off) <= 2 * std) >= 0.93
    assert set(np.round(age_s / PERIOD_S)) <= {2.0, 3.0, 4.0}
    # The older the motion, the larger the standard deviation.
    assert std[age_s > 0.9].mean() > std[age_s < 0.6].mean()


@pytest.fixture(scope="module")
def aside():
    camera = RenderedCamera(0, 30.0)
    return camera, camera.setup(GAUGES, motion=TENSION)


def test_without_a_field_the_corrected_value_is_not_valid_and_the_calibrated_one_is(aside):
    seen, setup = aside
    camera, solver = LiveCamera(setup), FieldSolver(setup)
    gauge = camera.measure(seen.frame(), 0.0)["area"]
    assert gauge.value().reason == Reason.NO_MOTION
    assert gauge.value("calibrated").valid
    assert gauge.value("calibrated").std > 0.0
    for k in (1, 2):
        camera.take(solver.solve(seen.frame(), 0.1 * k))
        gauge = camera.measure(seen.frame(), 0.2 * k)["area"]
    assert gauge.value().valid
    assert abs(gauge.value().strain) < 3 * gauge.value().std
    old = camera.measure(seen.frame(), 0.2 + setup.live.most_age_s + 0.1)["area"]
    assert old.value().reason == Reason.OLD


def test_a_field_that_cannot_be_corrected_makes_corrected_values_invalid(aside):
    seen, setup = aside
    camera, solver = LiveCamera(setup), FieldSolver(setup)
    for k in range(3):
        camera.take(solver.solve(seen.frame(), 0.1 * k))
        camera.measure(seen.frame(), 0.1 * k)
    turned = solver.solve(seen.frame(Pose.turned(np.array([0.0, 0.0, 1.0]), 6.0, np.zeros(3))), 0.4)
    assert "turned" in turned.declined
    camera.take(turned)
    assert camera.measure(seen.frame(), 0.5)["area"].value().reason == Reason.DECLINED
    assert camera.measure(seen.frame(), 0.6)["area"].value("raw").valid


def test_cameras_that_do_not_agree_say_so(aside):
    first = RenderedCamera(0, 30.0)
    second = RenderedCamera(1, -20.0)
    setups = tuple(camera.setup(GAUGES, motion=TENSION) for camera in (first, second))
    live, solver = LivePair(*map(LiveCamera, setups)), PairSolver(*setups)
    for k in range(3):
        frames = first.frame(*state(k)), second.frame(*state(k))
        live.take(solver.solve(frames, 0.1 * k))
        images = live.measure(frames, 0.1 * k)
    assert images[0]["area"].value().valid
    # The second camera slides by half a pixel across the parallax.
    frames = first.frame(*state(2)), second.frame(*state(2), shift_mm=(0.5 / 70.0, 0.0))
    assert live.measure(frames, 0.4)[0]["area"].value().reason == Reason.CAMERAS_DISAGREE


def test_a_camera_without_a_pinhole_model_cannot_be_corrected():
    seen = RenderedCamera()
    setup = seen.setup(calibrated=False, gauges=(StrainGauge(name="a", centre=(200, 200), size=(60, 60)),))
    camera, solver = LiveCamera(setup), FieldSolver(setup)
    with pytest.raises(GaugeError, match="expected a calibration, got none"):
        solver.solve(seen.frame(), 0.0)
    calibrated = FieldSolver(seen.setup()).solve(seen.frame(), 0.0)
    with pytest.raises(GaugeError, match="a calibration with a pinhole model"):
        camera.take(calibrated)
    with pytest.raises(GaugeError, match="calibrate both cameras with the same grid"):
        LivePair(camera, camera)
