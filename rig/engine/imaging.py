"""Take the images of one step. Check each image, repeat bad images, and reopen a camera that fails."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import NoReturn

from dic.runfile.schema import Level
from drivers.clock import Clock
from drivers.errors import DeviceError, DeviceFault
from drivers.interfaces import Frame
from rig.engine.devices import CalledCamera, CameraLost
from rig.engine.filing import Filing
from rig.engine.image_checks import ImageChecks, Measures
from rig.errors import BadImage, RigError
from rig.protocol.images import Images
from rig.protocol.step import ProtocolStep, Reading

RETURNS_MAX = 3
"""Largest accepted number of failures of a camera in one step. More mean a bad cable or power supply."""
REOPEN_PERIOD_S = 1.0
"""Time in s between two attempts to reopen a camera that failed."""


@dataclass(frozen=True)
class Surroundings:
    """Functions of the engine that `StepImages` needs.

    Attributes
    ----------
    read : callable
        Reads stage and load frame, checks the limits, and returns the reading.
    settle : callable
        Waits until the readings of the step have settled, and returns the settled reading.
    pause : callable
        Waits for the given time in s.
    log : callable
        Records an event with its level and its message.
    """

    read: Callable[[], Reading]
    settle: Callable[[ProtocolStep], Reading]
    pause: Callable[[float], None]
    log: Callable[[Level, str], None]


class StepImages:
    """Takes and records the images of all cameras, step by step, during one run.

    Parameters
    ----------
    cameras : dict of str to CalledCamera
    settings : Images
    clock : Clock
    filing : Filing
    surroundings : Surroundings

    Attributes
    ----------
    newest : dict of str to Frame
        The newest good image of each camera. Any thread may read this attribute.
    """

    def __init__(
        self,
        cameras: dict[str, CalledCamera],
        settings: Images,
        clock: Clock,
        filing: Filing,
        surroundings: Surroundings,
    ) -> None:
        self.newest: dict[str, Frame] = {}
        self._cameras = dict(cameras)
        self._settings = settings
        self._clock = clock
        self._filing = filing
        self._around = surroundings
        self._checks = {name: ImageChecks(camera.info, settings) for name, camera in cameras.items()}

    @property
    def cameras(self) -> dict[str, CalledCamera]:
        """The cameras in use, by name. A camera that was opened again is a new object."""
        return dict(self._cameras)

    def take(self, step: ProtocolStep, settled: Reading) -> tuple[dict[str, tuple[int, int]], Reading]:
        """Take and record the images of one step.

        Returns
        -------
        frames : dict of str to (int, int)
            For each camera the row of the first image in the run file and the number of images.
        settled : Reading
            The settled reading that belongs to the recorded images. If images were repeated, it is a new one.

        Raises
        ------
        DeviceError
            If a camera fails and cannot be reopened, or delivers no image that was exposed in this step.
        BadImage
            If an image violates a limit and `images.on_bad_image` is "stop".
        """
        frames: dict[str, tuple[int, int]] = {}
        for _ in range(self._settings.per_step):
            taken, settled = self._take_in_spite_of_losses(step, settled)
            for name, frame in taken.items():
                row = self._filing.frame(name, frame)
                first, count = frames.get(name, (row, 0))
                frames[name] = (first, count + 1)
                self.newest[name] = frame
        return frames, settled

    def _take_in_spite_of_losses(
        self, step: ProtocolStep, settled: Reading
    ) -> tuple[dict[str, Frame], Reading]:
        for _ in range(RETURNS_MAX):
            try:
                return self._take_at_once(step, settled), settled
            except CameraLost as lost:
                self._bring_back(lost, step)
                self._around.log("info", f"{step} is repeated, because a camera had dropped out")
                settled = self._around.settle(step)
        try:
            return self._take_at_once(step, settled), settled
        except CameraLost as lost:
            raise lost.error from None

    def _take_at_once(self, step: ProtocolStep, settled: Reading) -> dict[str, Frame]:
        """Take one image with each camera, all within the time `skew_max_s`."""
        found = ""
        for _ in range(self._settings.attempts):
            frames = self._take_one_each(step, settled)
            exposed_s = [frame.exposed_s for frame in frames.values()]
            skew_s = max(exposed_s, default=0.0) - min(exposed_s, default=0.0)
            if skew_s <= self._settings.skew_max_s:
                return frames
            found = (
                f"the images of all cameras are {skew_s:.2f} s apart, more than images.skew_max_s, "
                f"{self._settings.skew_max_s:g}"
            )
            self._around.log("warning", f"cameras: {step}: {found}")
        self._keep_or_stop("cameras", step, found)
        return frames

    def _take_one_each(self, step: ProtocolStep, settled: Reading) -> dict[str, Frame]:
        frames: dict[str, Frame] = {}
        try:
            for name in self._cameras:
                frames[name] = self._take_one(name, step, settled)
        except CameraLost:
            raise
        except BaseException:
            # The run ends. Record the images that were taken before, although the step is not finished.
            with suppress(RigError):
                for name, frame in frames.items():
                    self._filing.frame(name, frame)
            raise
        return frames

    def _take_one(self, name: str, step: ProtocolStep, settled: Reading) -> Frame:
        """Return an image that passes its checks. If all attempts fail, return the last image or raise."""
        device, checks = f"cameras.{name}", self._checks[name]
        stale: tuple[str, str, str] | None = None
        kept: tuple[Frame, Measures] | None = None
        found: list[str] = []
        for _ in range(self._settings.attempts):
            asked_s = self._clock.now_s()
            frame = self._cameras[name].grab(self._settings.timeout_s)
            checks.require_format(frame, device, str(step))
            # Read the devices after every image, because a reading checks the limits and resets the watchdog.
            reading = self._around.read()
            stale = checks.not_fresh(frame, asked_s)
            if stale is None:
                measured = checks.measure(frame)
                if checks.is_frozen(measured):
                    stale = _FROZEN
            if stale is not None:
                self._around.log("warning", f"{device}: {step}: image dropped: {stale[1]}")
                continue
            kept = frame, measured
            found = [*checks.findings(measured), *_motion(step, settled, reading)]
            if not found:
                break
            self._around.log("warning", f"{device}: {step}: {'; '.join(found)}")
        if kept is None:
            self._refuse(device, step, stale)
        if found:
            self._keep_or_stop(device, step, "; ".join(found))
        checks.accept(*kept, reference=step.kind == "reference")
        return kept[0]

    def _bring_back(self, lost: CameraLost, step: ProtocolStep) -> None:
        """Try to reopen a camera until it delivers images or the protocol's `camera_return_s` has passed."""
        device, error = f"cameras.{lost.name}", lost.error
        wait_s = self._settings.camera_return_s
        since_s = self._clock.now_s()
        self._around.log("warning", f"{error}; it is opened again for at most {wait_s:g} s")
        while self._clock.now_s() - since_s < wait_s:
            if self._delivers(lost.name):
                passed_s = self._clock.now_s() - since_s
                self._around.log("warning", f"{device}: {step}: the camera is back after {passed_s:.1f} s")
                return
            self._around.read()
            self._around.pause(REOPEN_PERIOD_S)
        raise type(error)(
            error.device,
            error.step,
            error.expected,
            f"{error.got}, and no return of the camera within {wait_s:g} s",
            error.remedy,
        )

    def _delivers(self, name: str) -> bool:
        """Reopen a camera, and return whether it then delivers an image."""
        camera = self._cameras[name].reopened()
        if isinstance(camera, DeviceError):
            return False
        self._cameras[name] = camera
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
            self._around.log("warning", f"{device}: {step}: the image of attempt {attempts} is kept: {found}")
            return
        raise BadImage(
            f"{device}, {step}",
            f"a good image within {attempts} attempts",
            found,
            'mend the light or the lens, or raise the limit, or set images.on_bad_image = "keep"',
        )

    def _refuse(self, device: str, step: ProtocolStep, stale: tuple[str, str, str] | None) -> NoReturn:
        assert stale is not None  # no image can be kept, because the last one may be old or damaged
        expected, got, remedy = stale
        got = f"{got}, the last of {self._settings.attempts} attempts"
        raise DeviceFault(device, str(step), expected, got, remedy)


_FROZEN = (
    "a new picture",
    "exactly the pixels of the image before: the picture is frozen",
    "switch the camera off and on, and check its driver",
)


def _motion(step: ProtocolStep, settled: Reading, reading: Reading) -> list[str]:
    """Return a sentence if the specimen moved between the settled reading and the reading after an image."""
    if step.timed and not step.holds:
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
