from datetime import timedelta
from types import SimpleNamespace

import numpy as np
import pytest

from drivers.clock import VirtualClock
from drivers.errors import DeviceError, DeviceTimeout, LinkLost
from drivers.interfaces import OpenContext
from drivers.registry import find_driver
from simulators.rig.camera import SPEC, SimulatedCamera
from simulators.rig.camera_settings import CameraSettings
from simulators.rig.surroundings import Surroundings
from simulators.scene.render import render
from simulators.scene.scene import Misalignment, Scene
from simulators.scene.specimen import SimulatedSpecimen, SpecimenSettings
from simulators.wire.faults import FaultPanel
from tests.mistakes import mistakes_of

SMALL = {"width_px": 80, "height_px": 60}


class Bench:
    """A scene on a stage that turns at constant speed, and its cameras."""

    def __init__(self, speed_deg_s=0.0):
        self.clock = VirtualClock()
        specimen = SimulatedSpecimen(SpecimenSettings())
        self.scene = Scene(
            seed=1,
            misalignment=Misalignment(),
            specimen=specimen,
            angle_deg=lambda: speed_deg_s * self.clock.now_s(),
            load_n=lambda: specimen.stretch_to(0.0),
        )

    def camera(self, name="on_axis", **settings):
        context = OpenContext(name, self.clock, SimpleNamespace(scene=self.scene))
        return SPEC.open(CameraSettings(**SMALL, **settings), context)


def test_it_is_found_by_its_name():
    assert find_driver("simulated-camera") is SPEC
    assert SPEC.kind == "camera"


def test_it_says_what_it_is():
    info = Bench().camera("left", bits=12).info
    assert (info.serial, info.width_px, info.height_px, info.bits, info.simulated) == (
        "left",
        80,
        60,
        12,
        True,
    )


def test_a_frame_is_exposed_after_the_call_and_takes_its_time():
    bench = Bench()
    camera = bench.camera(exposure_us=8_000.0, readout_us=15_000.0)
    bench.clock.sleep(3.0)
    utc = bench.clock.utc()
    frame = camera.grab(1.0)
    assert frame.exposed_s == 3.0
    assert frame.utc == utc
    assert frame.received_s == pytest.approx(3.023)
    assert bench.clock.utc() - utc == timedelta(milliseconds=23)
    assert (frame.exposure_us, frame.gain, frame.flags) == (8_000.0, 1.0, 0)


@pytest.mark.parametrize("speed_deg_s", [1e-3, 10.0])
def test_it_shows_the_mean_of_the_moving_scene_over_the_exposure(speed_deg_s):
    bench = Bench(speed_deg_s)
    camera = bench.camera(exposure_us=400_000.0, saturation_exposure_us=500_000.0, full_well_e=1e12)
    frame = camera.grab(1.0)
    moments = 40
    seen = Bench(speed_deg_s)
    seen.clock.sleep(0.2 / moments)
    expected = np.zeros_like(frame.image, float)
    for _ in range(moments):
        expected += render(camera.optics, seen.scene.surface()) * 0.8 * 255 / moments
        seen.clock.sleep(0.4 / moments)
    # the corners move by 3.5 px with the greater speed; the middle alone would be up to 50 grey levels off
    np.testing.assert_allclose(frame.image, expected, atol=0.8)


def test_frames_are_counted_and_each_has_its_own_noise():
    camera = Bench().camera()
    first, second = camera.grab(1.0), camera.grab(1.0)
    assert (first.sequence, second.sequence) == (0, 1)
    assert np.any(first.image != second.image)
    assert np.std(first.image.astype(float) - second.image) < 2.0


def test_the_same_run_repeats_bit_by_bit():
    first, again = Bench().camera(), Bench().camera()
    for _ in range(2):
        np.testing.assert_array_equal(first.grab(1.0).image, again.grab(1.0).image)


def test_two_cameras_at_one_place_differ_by_their_noise_only():
    left, right = (Bench().camera(name).grab(1.0).image.astype(float) for name in ("left", "right"))
    assert np.any(left != right)
    assert np.std(left - right) < 2.0


def test_twelve_bits_come_in_sixteen():
    image = Bench().camera(bits=12).grab(1.0).image
    assert image.dtype == np.uint16
    assert 255 < image.max() <= 4095


def test_a_frame_that_takes_too_long_times_out_at_the_deadline():
    bench = Bench()
    camera = bench.camera(exposure_us=2e6)
    with pytest.raises(DeviceTimeout, match=r"on_axis: grab: expected a frame within 1 s, got none"):
        camera.grab(1.0)
    assert bench.clock.now_s() == 1.0


def test_a_closed_camera_says_so():
    camera = Bench().camera()
    camera.close()
    camera.close()
    with pytest.raises(DeviceError, match="expected an open camera"):
        camera.grab(1.0)


def test_it_needs_a_virtual_rig():
    with pytest.raises(DeviceError, match="expected the scene of a virtual rig") as caught:
        SPEC.open(CameraSettings(), OpenContext("on_axis", VirtualClock()))
    assert "on_axis" in str(caught.value)


def test_all_mistakes_in_its_settings_are_reported_together():
    mistakes = mistakes_of(CameraSettings, {"bits": 10, "pan_deg": 75.0, "tilt": 3.0})
    assert len(mistakes) == 3
    assert any("tilt: unknown key" in mistake for mistake in mistakes)


def test_a_lens_that_cannot_see_the_corners_is_refused():
    (mistake,) = mistakes_of(CameraSettings, {"k1_per_px2": -1e-6})
    assert "folds the image over before its corners" in mistake


def test_a_camera_that_looks_past_the_specimens_plane_is_refused():
    # half the picture is atan(450 / 450) = 45°: raised by 50°, its upper edge looks 5° above the plane
    (mistake,) = mistakes_of(CameraSettings, {"focal_px": 450.0, "tilt_deg": 50.0})
    assert "looks past the specimen's plane" in mistake
    CameraSettings(focal_px=450.0, tilt_deg=20.0)


def camera_with_faults():
    bench, faults = Bench(), FaultPanel("camera")
    around = Surroundings.of(bench.clock, faults)
    return SimulatedCamera("on_axis", CameraSettings(**SMALL), bench.scene, bench.clock, around), faults


def test_a_lost_frame_leaves_a_gap_in_the_count():
    camera, faults = camera_with_faults()
    assert camera.grab(1.0).sequence == 0
    faults.switch_on("drop:1")
    assert [camera.grab(1.0).sequence for _ in range(2)] == [2, 3]


def test_a_damaged_frame_says_so():
    camera, faults = camera_with_faults()
    faults.switch_on("corrupt:1")
    damaged, good = camera.grab(1.0), camera.grab(1.0)
    # V4L2_BUF_FLAG_ERROR of Linux' videodev2.h
    assert (damaged.flags, good.flags) == (0x40, 0)
    assert np.all(damaged.image[len(damaged.image) // 2 :] == 0)
    assert np.all(good.image > 0)


def test_a_stale_frame_is_the_one_before():
    camera, faults = camera_with_faults()
    before = camera.grab(1.0)
    faults.switch_on("stale:1")
    assert camera.grab(1.0) is before
    assert camera.grab(1.0).exposed_s > before.exposed_s


def test_a_delayed_frame_comes_later_or_not_in_time():
    camera, faults = camera_with_faults()
    prompt = camera.grab(1.0)
    faults.switch_on("delay:0.5")
    late = camera.grab(1.0)
    assert late.received_s - late.exposed_s == pytest.approx(prompt.received_s - prompt.exposed_s + 0.5)
    with pytest.raises(DeviceTimeout):
        camera.grab(0.5)


@pytest.mark.parametrize(("fault", "error"), [("stall", DeviceTimeout), ("unplug", LinkLost)])
def test_a_camera_gives_frames_again_once_its_fault_is_gone(fault, error):
    camera, faults = camera_with_faults()
    faults.switch_on(fault)
    with pytest.raises(error):
        camera.grab(1.0)
    faults.clear()
    assert camera.grab(1.0).flags == 0
