"""Each check of an image agrees with theory, with dic's measure of blur, and with simulated faults."""

import math
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, uniform_filter1d

from dic import assess_quality
from drivers.clock import VirtualClock
from drivers.interfaces import CameraInfo, Frame
from rig.engine.image_checks import ImageChecks, measure
from rig.protocol.images import Images
from simulators.rig.camera import SimulatedCamera
from simulators.rig.camera_settings import CameraSettings
from simulators.rig.picture_faults import PictureFaults
from simulators.rig.surroundings import Surroundings
from simulators.rig.virtual_rig import VirtualRig

WIDTH, HEIGHT, PERIOD_PX, MEAN, SWING = 400, 404, 16, 100.0, 50.0


def waves() -> np.ndarray:
    """An image of a wave along x and a wave along y, whose sharpness is known."""
    x, y = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    turn = 2.0 * np.pi / PERIOD_PX
    return MEAN + SWING / 2.0 * (np.sin(turn * x) + np.sin(turn * y))


def seen(image: np.ndarray, sequence: int = 1, **changes) -> Frame:
    frame = Frame(image, 1.0, 1.1, datetime(2026, 1, 1, tzinfo=UTC), sequence, 0, 1000.0, 1.0)
    return replace(frame, **changes)


@pytest.fixture
def checks() -> ImageChecks:
    """Image checks whose reference image is the image of waves."""
    made = ImageChecks(CameraInfo("a", "b", "c", width_px=WIDTH, height_px=HEIGHT), Images())
    frame = seen(grey(waves()))
    made.accept(frame, made.measure(frame), reference=True)
    return made


def grey(levels: np.ndarray) -> np.ndarray:
    return np.clip(np.rint(levels), 0, 255).astype(np.uint8)


def findings(checks: ImageChecks, levels: np.ndarray) -> str:
    return "; ".join(checks.findings(checks.measure(seen(grey(levels)))))


def test_the_measures_are_those_of_theory() -> None:
    # The difference of a wave over 2 px is a wave of 2 sin(π·2/period) times its swing.
    expected = SWING / 2.0 * 2.0 * math.sin(2.0 * math.pi / PERIOD_PX) / math.sqrt(2.0) / MEAN
    found = measure(grey(waves()), 8)
    assert found.mean == pytest.approx(MEAN, rel=0.01)
    assert found.sharpness_x == pytest.approx(expected, rel=0.02)
    assert found.sharpness_y == pytest.approx(expected, rel=0.02)
    assert found.saturated == 0.0


@pytest.mark.parametrize("bits", [8, 12])
def test_saturated_pixels_are_counted(bits: int) -> None:
    image = np.full((HEIGHT, WIDTH), 100, np.uint8 if bits == 8 else np.uint16)
    image[:, : WIDTH // 10] = (1 << bits) - 1
    assert measure(image, bits).saturated == pytest.approx(0.1)


def test_a_good_picture_passes(checks: ImageChecks) -> None:
    rng = np.random.default_rng(1)
    shifted = np.roll(waves(), (3, 5), (0, 1)) + rng.normal(0.0, 2.0, (HEIGHT, WIDTH))
    assert findings(checks, 0.9 * shifted) == ""


@pytest.mark.parametrize(
    ("change", "finding"),
    [
        (lambda levels: 0.6 * levels, "the light changed by -40%"),
        (lambda levels: 1.4 * levels, "the light changed by +40%"),
        (lambda levels: 0.0 * levels, "the light changed by -100%"),
        (lambda levels: gaussian_filter(levels, 4.0, mode="wrap"), "the sharpness is 29% of the reference's"),
        (lambda levels: uniform_filter1d(levels, 9, axis=1, mode="wrap"), "blurred along x"),
        (lambda levels: uniform_filter1d(levels, 9, axis=0, mode="wrap"), "blurred along y"),
        (lambda levels: levels + 120.0, "of the pixels are saturated"),
    ],
)
def test_a_bad_picture_is_found(checks: ImageChecks, change, finding: str) -> None:
    assert finding in findings(checks, change(waves()))


def test_less_light_is_no_loss_of_sharpness(checks: ImageChecks) -> None:
    assert "sharpness" not in findings(checks, 0.5 * waves())


def test_a_picture_without_contrast_is_no_reference() -> None:
    made = ImageChecks(CameraInfo("a", "b", "c", width_px=WIDTH, height_px=HEIGHT), Images())
    flat = seen(grey(np.full((HEIGHT, WIDTH), 10.0)))
    made.accept(flat, made.measure(flat), reference=True)
    assert findings(made, waves()) == ""
    assert not made.is_frozen(made.measure(flat))


@pytest.mark.parametrize(
    ("changes", "got"),
    [
        ({"exposed_s": 0.4}, "one exposed 0.500 s before"),
        ({"flags": 0x40}, "one with the flags 0x40"),
        ({"sequence": 1}, "number 1"),
        ({"sequence": 0}, "number 0"),
        ({"sequence": 7}, None),
    ],
)
def test_a_frame_that_proves_nothing_new_is_told(checks: ImageChecks, changes, got) -> None:
    stale = checks.not_fresh(seen(grey(waves()), **{"sequence": 2, **changes}), asked_s=0.9)
    assert (stale and stale[1]) == got


def test_a_camera_that_was_opened_again_counts_anew(checks: ImageChecks) -> None:
    checks.reopened()
    assert checks.not_fresh(seen(grey(waves()), sequence=0), asked_s=0.9) is None


@pytest.fixture
def simulated():
    """A simulated camera, its faults, and image checks whose reference is the camera's first image."""
    clock = VirtualClock()
    rig = VirtualRig(clock=clock)
    faults = PictureFaults(clock)
    settings = CameraSettings(width_px=400, height_px=400)
    camera = SimulatedCamera("one", settings, rig.scene, clock, Surroundings.of(clock, pictures=faults))
    made = ImageChecks(camera.info, Images())
    frame = camera.grab(5.0)
    made.accept(frame, made.measure(frame), reference=True)
    yield camera, faults.panel, made
    rig.close()


@pytest.mark.parametrize(
    ("fault", "finding"),
    [
        ("light:60", "the light changed by -40%"),
        ("light:250", "saturated"),
        ("defocus:3", "the sharpness is"),
        ("blur:8", "blurred along x"),
    ],
)
def test_the_simulators_faults_are_found(simulated, fault: str, finding: str) -> None:
    camera, panel, made = simulated
    assert made.findings(made.measure(camera.grab(5.0))) == []
    panel.switch_on(fault)
    assert finding in "; ".join(made.findings(made.measure(camera.grab(5.0))))
    panel.clear()
    assert made.findings(made.measure(camera.grab(5.0))) == []


def test_a_frozen_picture_is_found_by_its_pixels_alone(simulated) -> None:
    camera, panel, made = simulated
    panel.switch_on("frozen")
    frozen = camera.grab(5.0)
    assert made.not_fresh(frozen, frozen.exposed_s) is None
    assert made.is_frozen(made.measure(frozen))
    panel.clear()
    assert not made.is_frozen(made.measure(camera.grab(5.0)))


@pytest.mark.extended
def test_the_sharpness_falls_as_the_blur_that_dic_measures_grows(simulated) -> None:
    """dic measures the blur in pixels, by another method, on the same pictures."""
    camera, panel, _ = simulated
    sharpness, blur_px = [], []
    for defocus_px in (0, 1, 2):
        panel.switch_on(f"defocus:{defocus_px}")
        image = camera.grab(5.0).image
        sharpness.append(measure(image, 8).sharpness)
        blur_px.append(np.nanmedian(assess_quality(image.astype(np.float32), full_level=255).blur_px))
    assert sharpness == sorted(sharpness, reverse=True)
    assert blur_px == sorted(blur_px)
    assert blur_px[-1] - blur_px[0] > 0.5
