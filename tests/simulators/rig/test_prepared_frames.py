"""Frames from prepared pictures: `dic` measures in them what it measures in exact frames."""

from dataclasses import replace

import numpy as np
import pytest

from dic import Correlator
from drivers.clock import VirtualClock
from drivers.errors import DeviceFault
from simulators.rig.camera import SimulatedCamera
from simulators.rig.camera_settings import CameraSettings
from simulators.rig.light import Light
from simulators.rig.painters import ExactPainter, PreparedPainter
from simulators.rig.surroundings import PreparedSettings, Surroundings
from simulators.scene.band import Band
from simulators.scene.between import Look, between, moments
from simulators.scene.pose import Pose
from simulators.scene.prepared import PreparedPicture
from simulators.scene.scene import Misalignment, Scene, Surface
from simulators.scene.specimen import SimulatedSpecimen, SpecimenSettings
from simulators.scene.texture import Speckle
from simulators.scene.torn import Torn
from tests.cost import processor_s

SIDE = 320
QUIET = {"bits": 12, "full_well_e": 1e12, "read_noise_e": 0.0, "width_px": SIDE, "height_px": SIDE}
SPECKLE = Speckle.sprayed(1)
CAMERAS = {"straight": {}, "raised": {"tilt_deg": 30.0}, "bulging": {"tilt_deg": 30.0, "k1_per_px2": -4e-8}}
STATES = {
    "shifted": Surface(SPECKLE, shift_mm=np.array([0.0123, 0.0071])),
    "elastic": Surface(SPECKLE, Pose.sloped(0.0, -0.1), np.diag([1 - 0.6e-3, 1 + 2e-3])),
    "plastic": Surface(SPECKLE, Pose.sloped(0.2, -0.1, 0.02), np.diag([0.975, 1.05])),
    "turned": Surface(SPECKLE, Pose.turned(np.array([0.01, 0.0, 1.0]), 4.0, np.array([0.1, 0.0, 0.0]))),
}


for _name, _width_mm in (("band", 4.0), ("narrow band", 0.5)):
    _band = Band(0.3, _width_mm, True, 0.02, 1.8e-3, -5e-4, 0.5, 60.0)
    STATES[_name] = Surface(SPECKLE, Pose(), _band.elastic_gradient, np.array([0.0, 0.004]), band=_band)


def painters(camera="straight", margin_px=120, **changes):
    """Return an exact painter, and one that has prepared the picture of the specimen at rest."""
    settings = CameraSettings(**QUIET | CAMERAS[camera] | changes)
    fast = PreparedPainter(settings, 1, camera, margin_px, None, lambda line: None)
    fast.prepare(Surface(SPECKLE))
    return ExactPainter(settings, 1, camera), fast


def at_rest():
    return Scene(
        seed=1,
        misalignment=Misalignment(),
        specimen=SimulatedSpecimen(SpecimenSettings()),
        angle_deg=lambda: 0.0,
        load_n=lambda: 0.0,
    )


def painted(painter, surface, light=None, number=1):
    return painter.paint([(1.0, surface)], light or Light(), number)


@pytest.mark.parametrize("camera", CAMERAS)
def test_dic_measures_the_same_displacement_as_in_exact_frames(camera):
    exact, fast = painters(camera)
    correlator = Correlator(painted(exact, Surface(SPECKLE)))
    for state, surface in STATES.items():
        found, expected = (correlator.correlate(painted(each, surface)) for each in (fast, exact))
        good = found.converged & expected.converged
        assert good.sum() > 700, state
        for off in ((found.u_px - expected.u_px)[good], (found.v_px - expected.v_px)[good]):
            assert abs(off.mean()) < 6e-4, state
            assert off.std() < 6e-4, state
            assert np.abs(off).max() < 0.002, state


def test_a_tear_is_drawn_in_the_same_place():
    exact, fast = painters("raised")
    torn = Surface(Torn(SPECKLE, 0.1, 0.04), Pose.sloped(0.1, 0.0), np.diag([1.0, 1.01]))
    ours, theirs = (painted(each, torn).astype(float) for each in (fast, exact))
    assert np.abs(ours - theirs).max() < 0.02 * 4095
    assert (theirs < 0.03 * 4095).any(
        axis=1
    ).sum() < 10  # rows of the gap, of 2.4 px, that are seen at a slope
    whole = painted(exact, Surface(SPECKLE, torn.pose, torn.deformation_gradient)).astype(float)
    assert np.std(ours - whole) > 0.1 * 4095


@pytest.mark.parametrize(
    "light", [Light(0.7, covered_px=120.0, glare_px=40.0), Light(defocus_px=2.0), Light(smear_px=6.0)]
)
def test_faults_of_the_light_look_the_same(light):
    exact, fast = painters()
    ours, theirs = (painted(each, STATES["elastic"], light).astype(float) for each in (fast, exact))
    assert np.abs(ours - theirs).max() < 0.02 * 4095
    assert np.std(ours - painted(exact, STATES["elastic"])) > 0.05 * 4095


def test_the_noise_is_that_of_the_sensor_and_differs_from_frame_to_frame():
    surface, noisy = STATES["shifted"], {"full_well_e": 32_500.0, "read_noise_e": 20.0, "bits": 8}
    means = painted(painters()[0], surface) / 4095 * 255
    for painter in painters(**noisy):
        frames = [painted(painter, surface, number=number).astype(float) for number in range(1, 5)]
        noise = [frame - means for frame in frames]
        # shot noise and dark noise in grey levels, and the rounding
        expected = np.sqrt((means + 400 * 255 / 32_500) * 255 / 32_500 + 1 / 12)
        # between its points, the prepared picture is off by a quarter of a grey level
        assert np.std(noise[0] / expected) == pytest.approx(1.0, abs=0.04)
        assert abs(np.mean(noise[0])) < 0.03
        first, second = (noise[k] - noise[k + 1] for k in (0, 2))
        assert abs(np.corrcoef(first.ravel(), second.ravel())[0, 1]) < 0.02
        assert abs(np.corrcoef(first[:, 1:].ravel(), first[:, :-1].ravel())[0, 1]) < 0.02
        assert (painted(painter, surface, number=1) == frames[0]).all()


def test_material_from_beyond_the_margin_is_prepared_anew():
    told = []
    settings = CameraSettings(**QUIET)
    fast = PreparedPainter(settings, 1, "camera", 64, None, told.append)
    far = Surface(SPECKLE, shift_mm=np.array([0.0, 3.0]))
    for surface in (Surface(SPECKLE), far):
        ours = painted(fast, surface).astype(float)
        theirs = painted(ExactPainter(settings, 1, "camera"), surface)
        assert np.abs(ours - theirs).max() < 0.02 * 4095
    with pytest.raises(DeviceFault, match=r"a motion of less than 64 px .*raise margin_px"):
        fast.paint([(0.5, Surface(SPECKLE)), (0.5, far)], Light(), 1)


def test_a_folder_keeps_pictures_and_a_damaged_one_is_drawn_again(tmp_path, monkeypatch):
    scene = at_rest()

    def image(folder):
        clock = VirtualClock()
        around = Surroundings.of(clock, prepared=PreparedSettings(folder=str(folder)))
        return SimulatedCamera("camera", CameraSettings(**QUIET), scene, clock, around).grab(1.0).image

    first = image(tmp_path / "kept")
    of_grid_and_specimen = list((tmp_path / "kept").iterdir())
    assert len(of_grid_and_specimen) == 2
    with monkeypatch.context() as forbidden:
        forbidden.setattr(PreparedPicture, "prepare", None)
        np.testing.assert_array_equal(image(tmp_path / "kept"), first)
    for kept in of_grid_and_specimen:
        kept.write_bytes(kept.read_bytes()[:1000])
    np.testing.assert_array_equal(image(tmp_path / "kept"), first)
    (tmp_path / "file").touch()
    with pytest.raises(DeviceFault, match="expected room in a folder that can be written"):
        image(tmp_path / "file")


def test_a_lens_that_has_no_rays_beyond_the_image_is_refused():
    clock = VirtualClock()
    scene = at_rest()
    around = Surroundings.of(clock, prepared=PreparedSettings(margin_px=2000))
    settings = CameraSettings(**QUIET | {"focal_px": 700.0, "tilt_deg": 50.0})
    with pytest.raises(DeviceFault, match=r"lower margin_px in \[simulation.prepared\]"):
        SimulatedCamera("camera", settings, scene, clock, around)


def test_a_steady_motion_passes_through_its_states():
    axis = np.array([0.2, -0.1, 1.0])
    start = Surface(SPECKLE, Pose.turned(axis, 1.0, np.zeros(3)), load_n=1.0)
    end = Surface(
        SPECKLE, Pose.turned(axis, 4.0, np.zeros(3)), np.diag([1.0, 1.1]), np.array([0.3, 0.0]), 4.0
    )
    third = between(start, end, 1 / 3)
    np.testing.assert_allclose(third.pose.rotation, Pose.turned(axis, 2.0, np.zeros(3)).rotation, atol=1e-12)
    assert third.deformation_gradient[1, 1] == pytest.approx(1 + 0.1 / 3)
    assert (third.shift_mm[0], third.load_n) == (pytest.approx(0.1), pytest.approx(2.0))
    early, late = STATES["band"], replace(STATES["band"], band=replace(STATES["band"].band, front_mm=0.5))
    assert between(early, late, 0.5).band.front_mm == pytest.approx(0.4)


def test_moments_of_an_exposure_are_closer_than_a_pixel_and_late_looks_count_by_their_time():
    camera = CameraSettings(**QUIET).optics()
    steady = [
        Look(time_s, Surface(SPECKLE, shift_mm=np.array([time_s * 10.0, 0.0])))
        for time_s in (0.0, 5e-3, 0.03)
    ]
    found = moments(camera, steady, exposure_s=0.01)
    assert sum(share for share, _ in found) == pytest.approx(1.0)
    places_mm = np.array([surface.shift_mm[0] for _, surface in found])
    # the looks are 0.1 mm apart in an exposure, 7 px
    assert (places_mm.min() > 0.0) & (places_mm.max() < 0.1)
    assert np.diff(places_mm).max() * 70 < 1.5
    assert sum(share * place for (share, _), place in zip(found, places_mm, strict=True)) == pytest.approx(
        0.05
    )
    still = [Look(look.time_s, steady[0].surface) for look in steady]
    assert moments(camera, still, 0.01) == [(1.0, steady[0].surface)]


@pytest.mark.extended
def test_a_frame_of_2048_px_costs_little_time():
    settings = CameraSettings(width_px=2048, height_px=2048, focal_px=6160.0, tilt_deg=30.0)
    fast = PreparedPainter(settings, 1, "camera", 160, None, lambda line: None)
    painted(fast, STATES["plastic"])
    for state, most_ms in (("plastic", 15.0), ("band", 25.0)):
        painted(fast, STATES[state])
        # the system counts processor time in steps of 10 ms
        begun_s, frames = processor_s(), 20
        for number in range(frames):
            painted(fast, STATES[state], number=number)
        cost_ms = 1e3 * (processor_s() - begun_s) / frames
        print(f"a frame of 2048 x 2048 px, {state}, costs {cost_ms:.1f} ms of processor time")
        assert cost_ms < most_ms
