"""Bad images are repeated a limited number of times, and a camera that returns is used again."""

from dataclasses import dataclass, replace

import h5py
import numpy as np

from drivers.errors import DeviceTimeout, LinkLost
from drivers.interfaces import CameraInfo
from rig.devices import Rig
from rig.engine.engine import Engine
from rig.protocol.images import Images
from tests.rig.conftest import FakeCamera

BIG = CameraInfo("fakes", "camera", "3", simulated=True, width_px=300, height_px=300, bits=8)


@dataclass
class Pictures(FakeCamera):
    """A simulated camera with noise, whose images a test can change by the function `spoil`."""

    info: CameraInfo = BIG
    spoil: object = lambda count, image: image

    def grab(self, timeout_s):
        frame = super().grab(timeout_s)
        rng = np.random.default_rng(self.grabs)
        image = np.kron(np.random.default_rng(7).integers(60, 140, (60, 60)), np.ones((5, 5)))
        image = self.spoil(self.grabs, image + rng.normal(0.0, 1.0, image.shape))
        return replace(frame, image=np.clip(image, 0, 255).astype(np.uint8))


def with_images(rig, **settings):
    """Give a fake rig one camera with a textured image, and settings of its images; return the camera."""
    rig.cameras = {"off_axis": Pictures(rig.clock)}
    rig.protocol = rig.protocol.model_copy(update={"images": Images(still=0, **settings)})
    return rig.cameras["off_axis"]


def warnings(rig) -> list[str]:
    return [event for event in rig.events() if "cameras" in event]


def dark(first: int, last: int):
    return lambda count, image: image * 0.3 if first <= count <= last else image


def test_a_bad_image_is_taken_again(rotation):
    camera = with_images(rotation)
    camera.spoil = dark(4, 5)
    outcome = rotation.engine().run()
    assert outcome.status == "completed"
    assert camera.grabs == outcome.steps_done + 2
    found = warnings(rotation)
    assert len(found) == 2
    assert all("the light changed by -70%" in event for event in found)
    with h5py.File(rotation.path) as file:
        # Only good images are on file.
        assert file["entry/instrument/off_axis/data"][:].mean(axis=(1, 2)).min() > 90.0


def test_a_lasting_fault_of_the_picture_is_kept_and_said(rotation):
    camera = with_images(rotation, attempts=2)
    camera.spoil = dark(4, 10**9)
    outcome = rotation.engine().run()
    assert outcome.status == "completed"
    bad_steps = outcome.steps_done - 3
    assert camera.grabs == 3 + 2 * bad_steps
    assert sum("the image of attempt 2 is kept" in event for event in warnings(rotation)) == bad_steps


def test_a_lasting_fault_of_the_picture_stops_the_run_if_the_protocol_says_so(rotation):
    camera = with_images(rotation, on_bad_image="stop")
    camera.spoil = dark(4, 10**9)
    outcome = rotation.engine().run()
    assert (outcome.status, outcome.steps_done) == ("failed", 3)
    assert "expected a good image within 3 attempts, got the light changed by -70%" in outcome.reason
    assert camera.grabs == 6


def test_a_frozen_picture_is_never_kept(rotation):
    camera = with_images(rotation)
    shown = []

    def freeze(count, image):
        shown.append(image)
        return shown[3] if count > 4 else image

    camera.spoil = freeze
    outcome = rotation.engine().run()
    assert (outcome.status, outcome.steps_done) == ("failed", 4)
    assert "the picture is frozen, the last of 3 attempts" in outcome.reason


def test_images_that_are_far_apart_are_taken_again_together(rotation):
    with_images(rotation, skew_max_s=1.0)
    first, second = Pictures(rotation.clock), Pictures(rotation.clock)
    rotation.cameras = {"one": first, "two": second}
    slow = []

    def late(count, frame):
        if count == 3 and not slow:
            slow.append(count)
            rotation.clock.sleep(3.0)
            return replace(frame, exposed_s=frame.exposed_s + 3.0, received_s=frame.received_s + 3.0)
        return frame

    second.on_grab = late
    outcome = rotation.engine().run()
    assert outcome.status == "completed"
    assert (first.grabs, second.grabs) == (outcome.steps_done + 1, outcome.steps_done + 1)
    assert any("s apart, more than images.skew_max_s, 1" in event for event in warnings(rotation))


def test_a_motion_during_the_exposure_is_seen(rotation):
    camera = with_images(rotation)
    stage = rotation.stage
    pushed = []

    def push(count, frame):
        if count == 4 and not pushed:
            pushed.append(stage._target)
            stage._target = (0.0, stage.angle_deg + 1.0)
        elif pushed and count == 5:
            stage._target = pushed[0]
        return frame

    camera.on_grab = push
    assert rotation.engine().run().status == "completed"
    assert camera.grabs > 4
    assert any("the value changed by 1 since it had settled" in event for event in warnings(rotation))


class Loose(Pictures):
    """A camera that fails after its cable was pulled; a reopened camera works after some time."""

    def __init__(self, clock, cable) -> None:
        super().__init__(clock)
        self.cable = cable
        self.dead = False

    def grab(self, timeout_s):
        self.cable["grabs"] += 1
        if self.cable["grabs"] in self.cable["pulled_at"]:
            self.cable["back_s"] = self.clock.now_s() + self.cable["gone_s"]
            self.dead = True
        if self.dead:
            raise LinkLost("cameras.off_axis", "grab", "a camera", "none", "plug it in")
        return super().grab(timeout_s)

    def close(self):
        self.cable["closed"] += 1


def loose_rig(rig, *, gone_s, pulled_at=(4,), **settings) -> tuple[Engine, dict]:
    with_images(rig, **settings)
    cable = {"grabs": 0, "pulled_at": set(pulled_at), "back_s": 0.0, "closed": 0, "gone_s": gone_s}
    rig.cameras = {"off_axis": Loose(rig.clock, cable), "on_axis": Pictures(rig.clock)}

    def reopen():
        if rig.clock.now_s() < cable["back_s"]:
            raise DeviceTimeout("cameras.off_axis", "open", "a camera", "none", "plug it in")
        return Loose(rig.clock, cable)

    engine = rig.engine()
    devices = Rig(rig.clock, rig.operator, rig.cameras, rig.stage, virtual=True, reopen={"off_axis": reopen})
    return Engine(rig.protocol, devices, engine.context.recorder), cable


def test_a_camera_that_comes_back_is_used_again_and_the_step_repeated(rotation):
    engine, cable = loose_rig(rotation, gone_s=10.0)
    outcome = engine.run()
    assert outcome.status == "completed"
    assert cable["closed"] == 11  # at each attempt the old handle is closed first
    found = rotation.events()
    assert any("it is opened again for at most 60 s" in event for event in found)
    assert any("the camera is back after 10.0 s" in event for event in found)
    assert "step 3 (rotation 45 deg) is repeated, because a camera had dropped out" in found
    # Each step has one image of each camera; of the repeated step, none but the repeated.
    assert all(count == 1 for record in outcome.steps for _, count in record.frames.values())
    with h5py.File(rotation.path) as file:
        assert len(file["entry/instrument/on_axis/data"]) == outcome.steps_done


def test_a_camera_that_stays_away_ends_the_run_in_time(rotation):
    engine, _ = loose_rig(rotation, gone_s=1e6, camera_return_s=20.0)
    outcome = engine.run()
    assert (outcome.status, outcome.steps_done) == ("failed", 3)
    assert "got none, and no return of the camera within 20 s" in outcome.reason
    assert 20.0 <= rotation.clock.now_s() < 120.0


def test_a_camera_that_drops_out_again_and_again_ends_the_run(rotation):
    # After each return one image proves that the camera works; the next one fails.
    engine, cable = loose_rig(rotation, gone_s=2.0, pulled_at=range(4, 100, 2))
    outcome = engine.run()
    assert outcome.status == "failed"
    assert cable["grabs"] == 4 + 2 * 3


def test_no_return_is_awaited_if_the_protocol_says_so(rotation):
    engine, cable = loose_rig(rotation, gone_s=1.0, camera_return_s=0.0)
    assert engine.run().status == "failed"
    assert cable["closed"] == 0


def test_limits_are_watched_while_a_camera_is_away(tension):
    engine, _ = loose_rig(tension, gone_s=30.0)
    engine = Engine(
        tension.protocol, replace(engine.context.rig, load_frame=tension.load_frame), engine.context.recorder
    )
    away = tension.cameras["off_axis"]
    tension.load_frame.on_read = lambda count, state: replace(state, load_n=1e5) if away.dead else state
    outcome = engine.run()
    assert outcome.status == "failed"
    assert "expected a load within" in outcome.reason
