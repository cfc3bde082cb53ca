"""Take the images of a step. Check each image, repeat bad images, and reopen a camera that fails."""

import math
from collections.abc import Mapping
from contextlib import suppress

from drivers.errors import DeviceError, DeviceFault
from drivers.interfaces import Frame
from rig.engine.context import RunContext
from rig.engine.devices import CameraLost
from rig.engine.filing import record_frame
from rig.engine.image_checks import ImageChecks, Measures
from rig.engine.motion import RunMotion
from rig.errors import BadImage, RigError
from rig.protocol.step import ProtocolStep, RigReading

RETURNS_MAX = 3
"""Largest accepted number of failures of a camera in one step. More mean a bad cable or power supply."""
REOPEN_PERIOD_S = 1.0
"""Time in s between two attempts to reopen a camera that failed."""
Frames = dict[str, tuple[int, int]]
"""The images of a step: for each camera the row of the first one in the run file, and their number."""


class StepImages:
    """Takes and records the images of all cameras during one run.

    `newest` is the newest good image of each camera. Any thread may read this attribute. `cameras` are the
    cameras, of which one that was opened again replaces the lost one.
    """

    def __init__(self, run: RunContext, motion: RunMotion) -> None:
        self.newest: dict[str, Frame] = {}
        self._run = run
        self._motion = motion
        self.cameras = run.devices.cameras
        self._settings = run.protocol.images
        self._checks = {name: ImageChecks(each.info, self._settings) for name, each in self.cameras.items()}

    def take(self, step: ProtocolStep, reading: RigReading, frames: Frames) -> Frames:
        """Take and record one image of each camera, and return the images of the step including these.

        `reading` is the reading at the time of these images, and `frames` are the images of the step before.

        Raise `DeviceError` if a camera fails and cannot be reopened, or delivers no image that was exposed in
        this step, and `BadImage` if an image violates a limit and `images.on_bad_image` is "stop".
        """
        taken = dict(frames)
        self._run.pulses.give("exposure")
        for name, frame in self._take_in_spite_of_losses(step, reading).items():
            row = record_frame(self._run, name, frame)
            first, count = taken.get(name, (row, 0))
            taken[name] = (first, count + 1)
            self.newest[name] = frame
        return taken

    def _take_in_spite_of_losses(self, step: ProtocolStep, settled: RigReading) -> dict[str, Frame]:
        for _ in range(RETURNS_MAX):
            try:
                return self._take_at_once(step, settled)
            except CameraLost as lost:
                self.bring_back(lost, str(step))
                self._run.log("info", f"{step} is repeated, because a camera had dropped out")
                settled = self._motion.settle_again(step)
        try:
            return self._take_at_once(step, settled)
        except CameraLost as lost:
            raise lost.error from None

    def _take_at_once(self, step: ProtocolStep, settled: RigReading) -> dict[str, Frame]:
        """Take one image with each camera, all within the time `skew_max_s`."""
        found = ""
        for _ in range(self._settings.attempts):
            frames = self._take_one_each(step, settled)
            exposed_s = [frame.exposed_s for frame in frames.values()]
            skew_s = max(exposed_s, default=0.0) - min(exposed_s, default=0.0)
            if skew_s <= self._settings.skew_max_s:
                return frames
            found = _apart(skew_s, self._settings.skew_max_s)
            self._run.log("warning", f"cameras: {step}: {found}")
        self._keep_or_stop("cameras", step, found)
        return frames

    def _take_one_each(self, step: ProtocolStep, settled: RigReading) -> dict[str, Frame]:
        frames: dict[str, Frame] = {}
        try:
            for name in self.cameras:
                frames[name] = self._take_one(name, step, settled)
        except CameraLost:
            raise
        except BaseException:
            # The run ends. Record the images that were taken before, although the step is not finished.
            with suppress(RigError):
                for name, frame in frames.items():
                    record_frame(self._run, name, frame)
            raise
        return frames

    def _take_one(self, name: str, step: ProtocolStep, settled: RigReading) -> Frame:
        """Return an image that passes its checks. If all attempts fail, return the last image or raise."""
        device, checks = f"cameras.{name}", self._checks[name]
        stale: tuple[str, str, str] | None = None
        kept: tuple[Frame, Measures] | None = None
        found: list[str] = []
        for _ in range(self._settings.attempts):
            asked_s = self._run.clock.now_s()
            frame = self.cameras[name].grab(self._settings.timeout_s)
            checks.require_format(frame, device, str(step))
            # Read the devices after every image, because a reading checks the limits and resets the watchdog.
            reading = self._run.read()
            stale = checks.not_fresh(frame, asked_s)
            if stale is None:
                measured = checks.measure(frame)
                if checks.is_frozen(measured):
                    stale = _FROZEN
            if stale is not None:
                self._run.log("warning", f"{device}: {step}: image dropped: {stale[1]}")
                continue
            kept = frame, measured
            found = [*checks.findings(measured), *_motion(step, settled, reading)]
            if not found:
                break
            self._run.log("warning", f"{device}: {step}: {'; '.join(found)}")
        if kept is None:
            assert stale is not None  # no image can be kept, because the last one may be old or damaged
            expected, got, remedy = stale
            got = f"{got}, the last of {self._settings.attempts} attempts"
            raise DeviceFault(device, str(step), expected, got, remedy)
        if found:
            self._keep_or_stop(device, step, "; ".join(found))
        checks.accept(*kept, reference=step.kind == "reference")
        return kept[0]

    def judge(self, step: ProtocolStep, frames: Mapping[str, Frame]) -> dict[str, str]:
        """Return one sentence for each camera whose image is not good, for images that cannot be repeated.

        A damaged or frozen image is kept, because nothing else shows this moment. Raise `DeviceFault` if an
        image has another format than its camera announced, and `BadImage` if `images.on_bad_image` is "stop".
        """
        found: dict[str, str] = {}
        for name, frame in frames.items():
            device, checks = f"cameras.{name}", self._checks[name]
            checks.require_format(frame, device, str(step))
            measured = checks.measure(frame)
            wrong = checks.findings(measured)
            if (stale := checks.not_fresh(frame, -math.inf)) is not None:
                wrong.append(f"{stale[0]} is expected, it is {stale[1]}")
            if checks.is_frozen(measured):
                wrong.append("its pixels are those of the image before: the picture is frozen")
            checks.accept(frame, measured, reference=step.kind == "reference")
            if wrong:
                found[device] = "; ".join(wrong)
        middles_s = [frame.middle[0] for frame in frames.values()]
        skew_s = max(middles_s, default=0.0) - min(middles_s, default=0.0)
        if skew_s > self._settings.skew_max_s:
            found["cameras"] = _apart(skew_s, self._settings.skew_max_s)
        if found and self._settings.on_bad_image == "stop":
            sentences = "; ".join(f"{device}: {sentence}" for device, sentence in found.items())
            raise BadImage(str(step), "good images", sentences, _MEND)
        return found

    @property
    def last_exposed_s(self) -> float | None:
        """The end of the newest exposure on the rig's clock, None before the first image."""
        ends_s = [
            frame.middle[0] + (0.0 if math.isnan(frame.exposure_us) else 0.5e-6 * frame.exposure_us)
            for frame in self.newest.values()
        ]
        return max(ends_s, default=None)

    def begin_numbers_anew(self) -> None:
        """Forget the numbers of the last frames, because a stream may have numbers of its own."""
        for checks in self._checks.values():
            checks.reopened()

    def bring_back(self, lost: CameraLost, step: str) -> None:
        """Try to reopen a camera until it delivers images or the protocol's `camera_return_s` has passed."""
        device, error = f"cameras.{lost.name}", lost.error
        wait_s = self._settings.camera_return_s
        since_s = self._run.clock.now_s()
        self._run.log("warning", f"{error}; it is opened again for at most {wait_s:g} s")
        while self._run.clock.now_s() - since_s < wait_s:
            if self._delivers(lost.name):
                passed_s = self._run.clock.now_s() - since_s
                self._run.log("warning", f"{device}: {step}: the camera is back after {passed_s:.1f} s")
                return
            self._run.read()
            self._run.calls.pause(REOPEN_PERIOD_S)
        raise type(error)(
            error.device,
            error.step,
            error.expected,
            f"{error.got}, and no return of the camera within {wait_s:g} s",
            error.remedy,
        )

    def _delivers(self, name: str) -> bool:
        """Reopen a camera, and return whether it then delivers an image."""
        camera = self.cameras[name].reopened()
        if isinstance(camera, DeviceError):
            return False
        self.cameras[name] = camera
        self._checks[name].reopened()
        try:
            # Take an image, because some drivers report no error when they open a camera that is not
            # connected.
            camera.grab(self._settings.timeout_s)
        except CameraLost:
            return False
        return True

    def _keep_or_stop(self, device: str, step: ProtocolStep, found: str) -> None:
        attempts = self._settings.attempts
        if self._settings.on_bad_image == "keep":
            self._run.log("warning", f"{device}: {step}: the image of attempt {attempts} is kept: {found}")
            return
        raise BadImage(
            f"{device}, {step}",
            f"a good image within {attempts} attempts",
            found,
            _MEND,
        )


_MEND = 'mend the light or the lens, or raise the limit, or set images.on_bad_image = "keep"'
_FROZEN = (
    "a new picture",
    "exactly the pixels of the image before: the picture is frozen",
    "switch the camera off and on, and check its driver",
)


def _apart(skew_s: float, most_s: float) -> str:
    return f"the images of all cameras are {skew_s:.2f} s apart, more than images.skew_max_s, {most_s:g}"


def _motion(step: ProtocolStep, settled: RigReading, reading: RigReading) -> list[str]:
    """Return a sentence if the specimen moved between the settled reading and the reading after an image."""
    if not step.stands:
        return []  # ignore the motion, because these images are taken during a motion
    if reading.moving:
        return ["a device moved during the exposure"]
    change = abs(step.value(reading) - step.value(settled))
    # Allow twice the tolerance, because two readings at its opposite ends are possible without a motion.
    if change > 2.0 * step.tolerance:
        return [
            f"the value changed by {change:.4g} since it had settled, more than twice its tolerance, "
            f"{step.tolerance:g}"
        ]
    return []
