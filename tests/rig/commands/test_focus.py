"""`rig focus` measures each image at once and the rest beside it; a camera that fails harms no other."""

import io
import json
import threading
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
import pytest
from rich.console import Console
from scipy.ndimage import gaussian_filter

from dic.quality.quality import assess_quality
from dic.targets import LineGridTarget
from drivers.clock import SystemClock, VirtualClock
from drivers.errors import DeviceTimeout
from drivers.interfaces import CameraInfo, Frame
from rig.commands.focus_figures import GridNow, find_grid, middle_of, slow_figures, target_of
from rig.commands.focus_stream import FocusStream
from rig.commands.focus_view import FocusPanel, camera_lines, sentence
from rig.commands.focusing import CameraFocus, Focus
from rig.devices import Rig
from rig.protocol.grid import DotGrid, Grid
from tests.command_line import run_rig
from tests.places import EXAMPLES, example, small_cameras
from tests.rig.conftest import FakeOperator

SIDE_PX = 240
INFO = CameraInfo("fakes", "camera", "1", width_px=SIDE_PX, height_px=SIDE_PX, bits=8)
CLOSED_PORT = 'address = "127.0.0.1:1"'


def speckles(sigma_px: float, side_px: int = SIDE_PX) -> np.ndarray:
    rng = np.random.default_rng(3)
    texture = gaussian_filter(rng.normal(size=(side_px, side_px)), 1.5)
    blurred = gaussian_filter(120.0 + 30.0 * texture / texture.std(), sigma_px)
    return np.clip(blurred + rng.normal(size=blurred.shape), 0, 255).astype(np.uint8)


@dataclass
class Pictures:
    """A camera that returns given pictures, one after the other, and then the last one again and again."""

    given: list[np.ndarray]
    fails: bool = False
    taken: int = 0
    info: CameraInfo = INFO
    clock: SystemClock = field(default_factory=SystemClock)

    def grab(self, timeout_s: float) -> Frame:
        if self.fails:
            raise DeviceTimeout("camera", "grab", "a frame", "none", "check the cable")
        image = self.given[min(self.taken, len(self.given) - 1)]
        self.taken += 1
        now_s = self.clock.now_s()
        return Frame(image, now_s, now_s, self.clock.utc(), self.taken, 0, 1000.0, 1.0)

    def close(self) -> None:
        pass


def rig_of(**cameras) -> Rig:
    return Rig(VirtualClock(), FakeOperator([]), cameras)


def test_the_sharpness_is_compared_with_the_best_until_that_is_forgotten():
    camera = Pictures([speckles(sigma) for sigma in (2.0, 0.5, 1.0, 1.0)])
    focus = CameraFocus("left", camera, rig_of(left=camera))
    found = []
    for _ in range(3):
        focus.take()
        found.append(focus.figures)
    assert found[1].sharpness > found[2].sharpness > found[0].sharpness
    assert [each.best for each in found] == [each.sharpness for each in (found[0], found[1], found[1])]
    focus.forget_best()
    focus.take()
    assert focus.figures.best == focus.figures.sharpness == pytest.approx(found[2].sharpness)


def test_light_and_frozen_pictures_are_told():
    image = np.maximum(speckles(0.5), 7)
    image[:60] = 255
    image[100, 100] = 7
    camera = Pictures([image, image])
    focus = CameraFocus("left", camera, rig_of(left=camera))
    focus.take()
    assert (focus.figures.darkest, focus.figures.brightest) == (7, 255)
    assert focus.figures.saturated == pytest.approx(60 / SIDE_PX, abs=0.01)
    assert not focus.figures.frozen
    focus.take()
    assert focus.figures.frozen
    assert any("FROZEN PICTURE" in line for line in camera_lines(focus))


def test_the_speckles_are_those_of_dic_quality_in_the_middle():
    image = speckles(0.5, 700)
    found = slow_figures(image, 8, None, 0.0)
    assert middle_of(image).shape == (512, 512)
    expected = assess_quality(image[94:606, 94:606].astype(np.float32), full_level=255).as_dict()
    assert found.quality == expected
    assert any(
        line.startswith(f"middle 512 px: speckles {expected['speckle_x_px']:.1f}")
        for line in camera_lines_of(found)
    )


def camera_lines_of(slow) -> list[str]:
    camera = CameraFocus("left", Pictures([speckles(0.5)]), rig_of())
    camera.slow = slow
    return camera_lines(camera)


@pytest.mark.parametrize("times", [1, 3])
def test_the_residual_of_the_grid_is_in_pixels_of_the_image(times):
    """Lines that are displaced by a known amount: each second one by ±d, which no smooth map follows."""
    image = np.full((480, 480), 230.0, np.float32)
    shift_px = 0.4
    lines = 60.0 + 18.0 * np.arange(21) + shift_px * (-1.0) ** np.arange(21)
    at = np.arange(480.0)
    dark = np.minimum.reduce([1.0 - 0.8 * np.exp(-0.5 * ((at - each) / 1.4) ** 2) for each in lines])
    image *= np.minimum(dark[:, None], 1.0) * np.minimum(dark[None, :], 1.0)
    image[:50], image[430:], image[:, :50], image[:, 430:] = 230.0, 230.0, 230.0, 230.0
    large = np.repeat(np.repeat(image, times, 0), times, 1).astype(np.uint8)
    found = find_grid(large, LineGridTarget((21, 21), pitch_mm=0.5))
    assert isinstance(found, GridNow), found
    assert found.points == 441
    assert found.rms_px == pytest.approx(times * np.hypot(shift_px, shift_px), rel=0.15)


def test_a_grid_that_is_not_there_is_told_and_the_speckles_are_judged():
    found = slow_figures(speckles(0.5), 8, target_of(Grid()), 0.0)
    assert found.grid is None
    assert found.no_grid
    assert found.quality["speckle_x_px"] > 0.0


def test_the_target_is_the_one_of_the_protocol():
    made = target_of(DotGrid(target="dots", dots_x=9, dots_y=7, pitch_mm=2.0))
    assert (type(made).__name__, made.counts, made.pitch_mm) == ("DotTarget", (9, 7), 2.0)


def test_a_camera_that_fails_is_told_and_the_others_go_on():
    good, bad = Pictures([speckles(0.5), speckles(0.6)]), Pictures([speckles(0.5)], fails=True)
    focus = Focus(rig_of(good=good, bad=bad), None)
    focus.once()
    assert [each.newest is not None for each in focus.cameras] == [True, False]
    assert "bad: NO IMAGE: camera: grab: expected a frame, got none; check the cable" in sentence(focus, 0.0)
    bad.fails = False
    focus.once()
    assert "NO IMAGE" not in sentence(focus, 0.0)


def test_a_camera_that_hangs_is_given_up_and_not_closed():
    released = threading.Event()

    class Hanging(Pictures):
        def grab(self, timeout_s: float) -> Frame:
            released.wait(60.0)
            return super().grab(timeout_s)

    rig = rig_of(left=Hanging([speckles(0.5)]))
    focus = CameraFocus("left", rig.cameras["left"], rig, deadline_s=0.05)
    focus.run()  # it returns, because nothing can be expected of this camera any more
    released.set()
    assert focus.lost
    assert "none: the call hangs" in focus.trouble
    assert list(rig.lost) == ["cameras.left"]


def test_a_stream_shows_new_images_beside_old_figures_and_ends_by_itself():
    cameras = {"left": Pictures([speckles(0.5)]), "right": Pictures([speckles(1.0)])}
    focus = Focus(Rig(SystemClock(), FakeOperator([]), cameras), None)
    lines: list[str] = []
    enough = threading.Event()

    class Clock(SystemClock):
        """The test ends the stream once every figure is known, and not after a time."""

        def sleep(self, duration_s: float) -> None:
            super().sleep(duration_s)
            if all(each.slow is not None and each.taken_s > each.slow.taken_s for each in focus.cameras):
                enough.set()
                stream._obey("q")

    stream = FocusStream(focus, Clock(), lines.append, None, None)
    stream.follow(120.0)
    assert enough.is_set()
    assert all(each.slow is not None for each in focus.cameras)
    assert not any(each.is_alive() for each in focus.cameras)
    text = " ".join(sentence(focus, SystemClock().now_s()).split())
    assert "s old)" in text


def test_keys_keep_images_under_free_names_and_say_so(tmp_path):
    from rig.commands.check import keep_in

    image = speckles(0.5)
    focus = Focus(rig_of(left=Pictures([image])), None)
    stream = FocusStream(focus, SystemClock(), lambda line: None, keep_in(tmp_path), tmp_path)
    focus.cameras[0].take()
    (tmp_path / "left-1.png").write_bytes(b"of yesterday")
    stream._obey("s")
    assert (tmp_path / "left-1.png").read_bytes() == b"of yesterday"
    assert np.array_equal(cv2.imread(str(tmp_path / "left-2.png"), cv2.IMREAD_UNCHANGED), image)
    assert stream._note == f"saved in {tmp_path}: left-2.png"
    without = FocusStream(focus, SystemClock(), lambda line: None, None, None)
    without._obey("s")
    assert without._note == "no image was saved: name a folder with -o"


@pytest.mark.parametrize("columns", [60, 80])
def test_the_panel_fits_the_terminal_and_says_all(columns):
    focus = Focus(rig_of(left=Pictures([speckles(0.5)]), right=Pictures([speckles(0.5)], fails=True)), None)
    focus.once()
    output = Console(file=io.StringIO(), width=columns, height=24, force_terminal=True, color_system=None)
    output.print(FocusPanel(focus, focus.cameras[0].taken_s + 1.5, "a note", True))
    lines = output.file.getvalue().splitlines()
    assert max(map(len, lines)) <= columns
    text = " ".join(" ".join(lines).split())
    for said in ("left ━", "sharpness 0.", "(1.5 s old)", "right NO IMAGE: camera: grab", "q: end"):
        assert said in text


@pytest.fixture
def rig_file(tmp_path, monkeypatch) -> Path:
    """A virtual rig with small cameras, whose load frame nobody can reach."""
    monkeypatch.chdir(tmp_path)
    text = example("rig-virtual-tension", small_cameras(300, 950.0), ('address = "@load_frame"', CLOSED_PORT))
    Path("rig.toml").write_text(text)
    return Path("rig.toml")


def test_the_command_opens_nothing_but_cameras_and_keeps_what_it_measured(rig_file):
    """The load frame of this rig cannot be opened."""
    done = run_rig(
        "focus", rig_file, "--once", "--camera", "on_axis", "-o", "pictures", "--json", "focus.json"
    )
    assert done.err == ""
    assert "on_axis: sharpness 0." in done.out
    assert "off_axis" not in done.out
    kept = cv2.imread("pictures/on_axis.png", cv2.IMREAD_UNCHANGED)
    figures = json.loads(Path("focus.json").read_text())["cameras"]["on_axis"]
    assert figures["figures"]["brightest"] == int(kept.max())
    assert figures["figures"]["saturated"] == 0.0
    assert figures["slow"]["quality"] == assess_quality(kept.astype(np.float32), full_level=255).as_dict()
    assert done.status == int(bool(figures["slow"]["findings"]))


def test_the_command_streams_for_some_seconds_without_a_terminal(rig_file):
    done = run_rig("focus", rig_file, "--seconds", "0.5", "--json", "focus.json")
    assert done.status in (0, 1)
    assert set(done.report["cameras"]) == {"on_axis", "off_axis"}
    assert all(each["figures"] is not None for each in done.report["cameras"].values())


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--camera", "left"), "expected cameras of the rig (on_axis, off_axis), got 'left'"),
        (("--once", "--seconds", "3"), "give --seconds only without --once"),
        (("--seconds", "0"), "is not in the range"),
        (("--grid", "rig.toml", "--once"), "expected a protocol, got a rig file"),
    ],
)
def test_what_cannot_be_done_is_one_sentence(rig_file, options, said):
    done = run_rig("focus", rig_file, *options)
    assert done.status == 2
    assert said in done.err


def test_the_paper_s_grid_in_an_image_has_the_residual_of_its_calibration():
    image = cv2.imread(str(EXAMPLES / "images" / "grid.png"), cv2.IMREAD_UNCHANGED)
    found = find_grid(image, target_of(Grid()))
    assert isinstance(found, GridNow)
    assert found.points == 441
    # an image of the examples is rendered; its noise moves an intersection by less than this
    assert 0.001 < found.rms_px < 0.03
    assert found.rms_px < found.max_px < 6.0 * found.rms_px
