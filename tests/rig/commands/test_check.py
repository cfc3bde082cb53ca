"""Tests of `rig check` on images with known speckles, light and focus, and on the virtual rig."""

import threading

import cv2
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from dic.quality.findings import quality_findings
from dic.quality.quality import assess_quality
from drivers.clock import SystemClock
from drivers.interfaces import CameraInfo, Frame
from rig.commands.check import NO_PATTERN, check_rig, judge
from rig.devices import OpenedInterlock, Rig
from tests.command_line import run_rig
from tests.places import example
from tests.rig.conftest import FakeInterlock, FakeLoadFrame, FakeOperator, FakeStage

SIGMA_PX = 1.5


def speckles(mean: float, std: float, sigma_px: float = SIGMA_PX) -> np.ndarray:
    """Return an image of Gaussian blobs: 3.33 sigma wide, with edges that are blurred by at most sigma."""
    rng = np.random.default_rng(1)
    texture = gaussian_filter(rng.normal(size=(200, 220)), sigma_px)
    return np.clip(mean + std * texture / texture.std() + rng.normal(size=texture.shape), 0, 255).astype(
        np.uint8
    )


def test_a_good_picture_has_the_figures_of_dic_quality_and_nothing_to_say():
    image = speckles(120.0, 35.0)
    figures, sentences = judge(image, 8)
    assert sentences == []
    assert figures == assess_quality(image.astype(np.float32)).as_dict()
    assert figures["speckle_x_px"] == pytest.approx(4 * np.sqrt(np.log(2)) * SIGMA_PX, rel=0.05)


def test_a_speckle_picture_is_judged_by_the_findings_of_dic_quality():
    image = speckles(120.0, 60.0, 0.6)
    _, sentences = judge(image, 8)
    assert sentences == quality_findings(assess_quality(image.astype(np.float32)))
    assert any("finer than 3 px" in sentence for sentence in sentences)


def test_the_sensors_highest_level_counts_and_not_the_pictures():
    dark = np.minimum(speckles(120.0, 35.0) * 0.03, 4).astype(np.uint8)
    assert any(
        "brightest" in sentence for sentence in quality_findings(assess_quality(dark.astype(np.float32)))
    )
    _, sentences = judge(dark, 8)
    assert sentences
    assert not any("brightest" in sentence for sentence in sentences)
    _, sentences = judge(np.minimum(speckles(200.0, 60.0), 254), 8)
    assert not any("brightest" in sentence for sentence in sentences)
    _, sentences = judge(speckles(200.0, 60.0), 8)
    assert any("clipped at the brightest" in sentence for sentence in sentences)


def test_a_picture_without_a_pattern_is_judged_by_light_and_focus():
    white = np.full((200, 220), 4095, np.uint16)
    figures, sentences = judge(white, 12)
    assert (figures["bright_share"], figures["contrast"], figures["blur_px"]) == (1.0, 0.0, None)
    assert sentences[-1] == NO_PATTERN
    assert any("100.0% of the pixels are clipped at the brightest" in sentence for sentence in sentences)
    assert any("contrast is 0.00, below 0.2" in sentence for sentence in sentences)
    # one edge, far from focus: a step that is blurred by 6 px
    step = gaussian_filter(np.where(np.arange(220) < 110, 40.0, 200.0) * np.ones((200, 1)), 6.0)
    figures, sentences = judge(step.astype(np.uint8), 8)
    assert sentences[-1] == NO_PATTERN
    assert any("edges are blurred by 6." in sentence for sentence in sentences)


@pytest.fixture
def check(tmp_path):
    def call(camera: str, others: str = "") -> tuple[int, str, dict]:
        driver = 'driver = "simulated-camera"'
        rig_file = tmp_path / "rig.toml"
        rig_file.write_text(example("rig-virtual-rotation-30", (driver, f"{driver}\n{camera}")) + others)
        done = run_rig("check", rig_file, "--json", tmp_path / "check.json")
        return done.status, done.out, done.report

    return call


def test_shows_devices_and_images_and_moves_nothing(check):
    status, out, table = check("width_px = 160\nheight_px = 120")
    devices = table["devices"]
    assert (status, table["problems"]) == (0, [])
    assert devices["stage"]["state"]["homed"] is False
    assert set(devices) == {"stage", "cameras.on_axis", "cameras.off_axis"}
    camera = devices["cameras.on_axis"]
    assert 0 < camera["state"]["minimum"] < camera["state"]["mean"] < camera["state"]["maximum"] < 255
    assert camera["state"]["saturated"] == 0.0
    assert camera["quality"]["contrast"] > 0.2
    assert camera["findings"] == []
    assert "cameras.off_axis" in out
    assert "  quality: speckle_x_px " in out
    # what the simulated stage and camera were set to by their drivers
    assert devices["stage"]["settings"]["angle_max_deg"] == 365.0
    assert camera["settings"]["exposure_us"] == 10_000.0
    assert "  settings: angle_min_deg -5, angle_max_deg 365, " in out


def test_goes_on_after_devices_that_fail_and_keeps_the_pictures(tmp_path):
    small = 'driver = "simulated-camera"\nwidth_px = 160\nheight_px = 120'
    text = example("rig-virtual-rotation-30", ('driver = "simulated-camera"', small))
    rig_file, folder = tmp_path / "rig.toml", tmp_path / "pictures"
    rig_file.write_text(text.replace('"@stage"', f'"{tmp_path}/no-such-port"'))
    arguments = ("check", rig_file, "-o", folder, "--json", tmp_path / "check.json")
    done = run_rig(*arguments)
    assert done.status == 2
    assert done.err.startswith("rig: stage")
    assert "no-such-port" in done.err
    assert list(done.report["failed"]) == ["stage"]
    assert set(done.report["devices"]) == {"cameras.on_axis", "cameras.off_axis"}
    for name in ("on_axis", "off_axis"):
        picture = cv2.imread(str(folder / f"{name}.png"), cv2.IMREAD_UNCHANGED)
        state = done.report["devices"][f"cameras.{name}"]["state"]
        assert picture.shape == (120, 160)
        assert (picture.min(), picture.max()) == (state["minimum"], state["maximum"])
    # earlier pictures are replaced only if the user says so
    assert "--force" in run_rig(*arguments).err


SMALL = "width_px = 160\nheight_px = 120"
DOOR = """
[interlocks.door]
driver = "modbus-input"
address = "@interlocks"
number = 2
allowed_min = 1
[interlocks.oven]
driver = "modbus-input"
address = "@interlocks"
table = "input"
number = 0
quantity = "°C"
offset = 21.5
allowed_min = 15
allowed_max = 20
"""


def test_shows_interlocks_with_value_and_range_and_says_which_one_allows_no_run(check):
    # The simulated door is closed. The register of the oven is 0 at first, so the oven is at 21.5 °C.
    status, out, table = check(SMALL, DOOR)
    assert status == 1
    assert "interlocks.door: vendor Modbus, model discrete 2 of unit 1" in out
    assert "  allowed: at least 15 °C and at most 20 °C" in out
    problem = (
        "interlocks.oven: the value is 21.5 °C, but a run needs at least 15 °C and at most 20 °C; "
        "find out why the interlock does not allow a run"
    )
    assert table["problems"] == [problem]
    assert f"not good: {problem}" in out
    door, oven = (table["devices"][f"interlocks.{name}"] for name in ("door", "oven"))
    assert (door["state"]["value"], door["unit"], door["allows"]) == (1.0, "", True)
    assert (door["allowed_min"], door["allowed_max"]) == (1.0, None)
    assert (oven["state"]["value"], oven["unit"], oven["allows"]) == (21.5, "°C", False)


def test_goes_on_after_an_interlock_that_cannot_be_opened(check):
    status, out, table = check(SMALL, DOOR.replace("number = 2", "number = 99"))
    assert status == 2
    assert list(table["failed"]) == ["interlocks.door"]
    assert "illegal data address" in table["failed"]["interlocks.door"]
    assert {"stage", "interlocks.oven", "cameras.on_axis", "cameras.off_axis"} == set(table["devices"])
    assert "interlocks.oven: " in out


BOX = """
[channels.box]
driver = "modbus-channels"
address = "@interlocks"
rate_hz = 20
[channels.box.signals.heat]
input = 0
unit = "°C"
offset = 21.5
range = [15, 30]
[channels.box.signals.force]
input = 1
unit = "N"
range = [5, 100]
"""


def test_shows_channels_with_their_values_and_says_which_one_is_out_of_its_range(check):
    # all registers of the simulated module are 0 at first
    status, out, table = check(SMALL, BOX)
    assert status == 1
    assert "channels.box: vendor Modbus, model inputs of unit 1" in out
    assert "  heat 21.5 °C, noise 0 °C, range 15 to 30 °C" in out
    assert "  force 0 N, noise 0 N, range 5 to 100 N" in out
    problem = (
        "channels.force: it is 0 N, expected 5 to 100 N; check the sensor and its cable, or widen its range"
    )
    assert table["problems"] == [problem]
    signals = table["devices"]["channels.box"]["signals"]
    assert {name: each["newest"] for name, each in signals.items()} == {"heat": 21.5, "force": 0.0}


class SpeckledCamera:
    """A simulated camera whose images show good speckles."""

    info = CameraInfo("v", "m", "s", width_px=220, height_px=200, bits=8)

    def grab(self, timeout_s: float) -> Frame:
        clock = SystemClock()
        image = speckles(120.0, 35.0)
        return Frame(image, clock.now_s(), clock.now_s(), clock.utc(), 1, 0, 1000.0, 1.0)

    def close(self) -> None:
        pass


def test_a_device_that_hangs_fails_alone_and_is_not_closed():
    clock, released = SystemClock(), threading.Event()
    stage, frame = FakeStage(clock, []), FakeLoadFrame(clock, [])
    door, oven = (FakeInterlock(clock, lambda count: 1.0) for _ in range(2))
    stage.on_read = door.value_of = lambda state: released.wait() and state
    rig = Rig(
        clock,
        FakeOperator([]),
        {"front": SpeckledCamera()},
        stage,
        frame,
        call_timeout_s=5.0,
        interlocks={"door": OpenedInterlock(door, 1.0, None), "oven": OpenedInterlock(oven, 1.0, None)},
    )
    try:
        found = check_rig(rig)
    finally:
        released.set()
    assert set(found.devices) == {"load_frame", "interlocks.oven", "cameras.front"}
    assert set(found.failed) == set(rig.lost) == {"stage", "interlocks.door"}
    assert "stage: read: expected an end within 5 s, got none: the call hangs" in found.failed["stage"]
    assert found.problems == []


def test_says_when_an_image_is_saturated(check):
    status, out, table = check("width_px = 160\nheight_px = 120\nexposure_us = 100000.0")
    assert status == 1
    assert "not good: cameras.on_axis: " in out
    assert "clipped at the brightest grey level; use less light, gain or exposure" in out
    assert table["devices"]["cameras.on_axis"]["findings"]
