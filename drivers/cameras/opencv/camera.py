"""Driver for any camera that OpenCV can open, for set-up and teaching: lost frames are not detected.

OpenCV gives no frame counter, no timestamp and no error flag, and delivers damaged frames as good frames.
This driver therefore discards all frames that may have waited in a buffer. The driver also reads every camera
property back and compares the values. The middle of an exposure is not stated, because nothing but the call
and the arrival of the frame limits it. Use this driver only for cameras that no other driver
supports.
"""

import math
import threading
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.cameras.filming import READING_S, refuse_simulated_time, to_itself
from drivers.cameras.opencv.settings import OpencvCameraSettings
from drivers.clock import Clock
from drivers.errors import DeviceFault, DeviceTimeout, LinkLost
from drivers.interfaces import CameraInfo, Frame, OpenContext, Setting
from drivers.registry import DriverSpec

UNPROVEN = "frame loss unproven"
"""Warning that lost frames are not detected. The warning is part of the camera's model name, so every run
file contains the warning."""
GREEN, DIMENSIONS = 1, 2
TOLERANCE = 1e-3
_NAMES = {"FRAME_WIDTH": "width_px", "FRAME_HEIGHT": "height_px", "FPS": "rate_hz"}


class OpencvCamera:
    """A `Camera` through OpenCV. To construct this class, call `open_camera`.

    `capture` is an opened ``VideoCapture``, or a test's object with the same methods.
    """

    info: CameraInfo

    def __init__(self, settings: OpencvCameraSettings, context: OpenContext, capture: Any) -> None:
        self._settings = settings
        self._clock: Clock = context.clock
        self._name = f"{context.name} ({settings.source})"
        self._fault = partial(DeviceFault, self._name)
        self._capture = capture
        self._lock = threading.Lock()
        self._sequence = 0
        self._configure()
        self.info = CameraInfo(
            vendor="OpenCV",
            model=f"{capture.getBackendName()} camera, {UNPROVEN}",
            serial=str(settings.source),
            width_px=settings.width_px,
            height_px=settings.height_px,
            bits=settings.bits,
        )

    def grab(self, timeout_s: float) -> Frame:
        """Discard the frames that were buffered or in transfer at the call, and return the next frame.

        `exposed_s` is the time of the call, because the exposure did not begin earlier. The exact start of
        exposure is unknown. The sequence number counts the frames that the program read.

        Raise `DeviceTimeout` if reading takes longer than `timeout_s`. OpenCV itself may wait up to 10 s for
        one frame. Raise `LinkLost` if OpenCV returns no frame.
        """
        asked_s, utc = self._clock.now_s(), self._clock.utc()
        with to_itself(self._lock, self._name, "grab", timeout_s):
            self._require_open("grab")
            for _ in range(self._settings.buffered_frames + 1):
                self._next(asked_s, timeout_s)
            image = self._grey(self._next(asked_s, timeout_s))
            return Frame(
                image=image,
                exposed_s=asked_s,
                received_s=self._clock.now_s(),
                utc=utc,
                sequence=self._sequence,
                flags=0,
                exposure_us=math.nan,  # not known, because its unit depends on the backend
                gain=math.nan if self._settings.gain is None else self._settings.gain,
            )

    def read_settings(self) -> dict[str, Setting]:
        """Read all properties that the driver has written back from OpenCV, by their names in OpenCV.

        Raise `DeviceFault` if the camera is closed.
        """
        with to_itself(self._lock, self._name, "read settings", READING_S):
            self._require_open("read settings")
            return {
                _NAMES.get(name, f"property_{name.lower()}_raw"): self._get(name) for name in self._wanted()
            }

    def close(self) -> None:
        """Release the camera. A repeated call has no effect."""
        with self._lock:
            capture, self._capture = self._capture, None
            if capture is not None:
                capture.release()

    def _configure(self) -> None:
        import cv2

        wanted = self._wanted()
        for name, value in wanted.items():
            number = getattr(cv2, f"CAP_PROP_{name}", None)
            if number is None:
                raise self._fault(f"set {name}", "a property of OpenCV", repr(name), "correct `properties`")
            # ignore the return value, because some backends report a failure for a value that is already set
            self._capture.set(number, value)
        for name, value in wanted.items():
            got = self._get(name)
            if not abs(got - value) <= TOLERANCE * max(1.0, abs(value)):
                raise self._fault(
                    f"set {name}", f"{value:g}", f"{got:g} on reading back", "choose another value"
                )

    def _get(self, name: str) -> float:
        import cv2

        return float(self._capture.get(getattr(cv2, f"CAP_PROP_{name}")))

    def _wanted(self) -> dict[str, float]:
        """Return the values of all properties that the driver writes, by their names in OpenCV."""
        wanted = {
            "FRAME_WIDTH": float(self._settings.width_px),
            "FRAME_HEIGHT": float(self._settings.height_px),
            "FPS": self._settings.rate_hz,
            **self._settings.properties,
        }
        for name in ("exposure", "gain"):
            value = getattr(self._settings, name)
            if value is not None:
                wanted[name.upper()] = value
        return wanted

    def _next(self, asked_s: float, timeout_s: float) -> NDArray[np.uint8]:
        if not self._clock.now_s() - asked_s <= timeout_s:  # `not <=` treats a timeout of NaN as 0
            raise DeviceTimeout(
                self._name,
                "grab",
                f"a frame exposed after the call, within {timeout_s:g} s",
                "none",
                "allow more time, or lower `buffered_frames` if so many never wait",
            )
        good, image = self._capture.read()
        if not good or image is None:
            raise LinkLost(
                self._name,
                "grab",
                "a frame",
                "nothing from OpenCV, which does not say why",
                "check cable and power, then open the camera again",
            )
        self._sequence += 1
        return np.asarray(image)

    def _grey(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        shape = (self._settings.height_px, self._settings.width_px)
        if image.shape[:DIMENSIONS] != shape or image.dtype != np.uint8:
            raise self._fault(
                "grab",
                f"{shape[1]} x {shape[0]} px as uint8",
                f"shape {image.shape} as {image.dtype}",
                "choose another size",
            )
        if image.ndim == DIMENSIONS:
            return image.copy()
        if self._settings.channel == "green":
            return np.ascontiguousarray(image[:, :, GREEN])
        import cv2

        return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)

    def _require_open(self, step: str) -> None:
        if self._capture is None:
            raise self._fault(step, "an open camera", "a closed one", "open it again")


def open_camera(settings: OpencvCameraSettings, context: OpenContext) -> OpencvCamera:
    """Open a camera through OpenCV, write its settings and compare the values read back.

    Raise `DeviceError` if OpenCV cannot open the camera, or the camera does not accept a property.
    """
    import cv2

    name = f"{context.name} ({settings.source})"
    refuse_simulated_time(name, context)
    capture = cv2.VideoCapture(settings.source)
    try:
        if not capture.isOpened():
            raise LinkLost(
                name,
                "open camera",
                "a free camera",
                "none that OpenCV can open",
                "check number and cable, and that no other program uses it",
            )
        return OpencvCamera(settings, context, capture)
    except BaseException:
        capture.release()
        raise


SPEC = DriverSpec(kind="camera", settings=OpencvCameraSettings, open=open_camera)
