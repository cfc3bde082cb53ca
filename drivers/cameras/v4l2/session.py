"""Connection to one V4L2 camera. Settings are written and read back, then the camera films until `close`."""

import errno
from contextlib import AbstractContextManager
from datetime import datetime, timedelta
from functools import partial

from drivers.cameras.v4l2.abi import PRIORITY_RECORD, BufferFlag, RequestCode
from drivers.cameras.v4l2.buffers import Buffers, Filled
from drivers.cameras.v4l2.controls import Controls
from drivers.cameras.v4l2.exposure import read_exposure, set_exposure
from drivers.cameras.v4l2.find import Identity
from drivers.cameras.v4l2.format import read_picture, set_picture
from drivers.cameras.v4l2.node import Node, translate, translating
from drivers.cameras.v4l2.pixels import Image, grey_levels
from drivers.cameras.v4l2.settings import V4l2Settings
from drivers.cameras.v4l2.stamps import FrameNumbers, StampRule, require_monotonic
from drivers.clock import Clock
from drivers.errors import DeviceFault
from drivers.interfaces import Frame, Setting

UNSETTLED_FRAMES = 2
"""Number of frames that may still be exposed with the old settings after a control was changed."""
SHORT = 1 << 32
"""Flag of an incomplete frame. This bit lies above the 32 flag bits of the kernel."""


class V4l2Session:
    """An opened camera that films; its settings were written and read back.

    `node` is the node of the opened camera. `close` closes the node, and so does a failed configuration.
    Raise `DeviceError` if the camera does not accept a setting.
    """

    def __init__(
        self, node: Node, identity: Identity, settings: V4l2Settings, device: str, clock: Clock
    ) -> None:
        self.identity = identity
        self._node = node
        self._settings = settings
        self._device = device
        self._fault = partial(DeviceFault, self._device, "get frame")
        self._clock = clock
        self._buffers: Buffers | None = None
        self._unsettled = UNSETTLED_FRAMES
        self._healing = False
        self.seen = 0
        try:
            self._claim()
            self._picture = set_picture(node, settings, device)
            self._controls = Controls(node, device)
            self.exposure = set_exposure(self._controls, settings, device)
            self._controls.verify()
            self._rule = StampRule.of(
                identity.driver, self.exposure.time_us, settings.transfer_us, self.interval_s
            )
            self._numbers = FrameNumbers(self.interval_s)
            self._buffers = Buffers(node, device, settings.buffers)
            with translating(device, "start", "a filming camera"):
                self._buffers.start()
        except BaseException:
            self.close()
            raise

    @property
    def interval_s(self) -> float:
        """Time between two frames, in seconds."""
        return self._picture.interval_s

    @property
    def shortest_s(self) -> float:
        """The same: no trigger begins the frames."""
        return self.interval_s

    def verify(self) -> None:
        """Read all control values back. Raise `DeviceFault` if a value has changed."""
        self._controls.verify()

    def read_settings(self) -> dict[str, Setting]:
        """Read format, frame rate, exposure time, gain and all set controls back from the camera."""
        controls = {f"control_{name}": value for name, value in self._controls.read().items()}
        return (
            read_picture(self._node, self._device) | read_exposure(self._controls, self._settings) | controls
        )

    def next_frame(self, timeout_s: float, after_s: float) -> Frame | None:
        """Return the next frame whose exposure began after `after_s`. Return None after `timeout_s`.

        Incomplete frames, and frames that the kernel flags as damaged, are also returned, with `flags` set.

        Raise `LinkLost` if the camera was unplugged, and `DeviceFault` if the camera reports errors
        repeatedly, or delivers impossible timestamps or grey levels.
        """
        deadline_s = self._clock.now_s() + timeout_s
        while True:
            filled = self._take()
            if filled is None:
                left_s = deadline_s - self._clock.now_s()
                if not left_s > 0:
                    return None
                with self._translating():
                    self._node.wait(left_s)
                continue
            try:
                frame = self._frame(filled, after_s)
            finally:
                with self._translating():
                    self._ring.give_back(filled)
            if frame is not None:
                return frame
            if not self._clock.now_s() <= deadline_s:
                return None

    def close(self) -> None:
        """Stop filming and release all resources. A repeated call has no effect."""
        if self._buffers is not None:
            self._buffers.close()
            self._buffers = None
        self._node.close()

    def _claim(self) -> None:
        """Prevent other programs from changing the camera, if the kernel's driver supports priorities."""
        import ctypes

        try:
            self._node.ioctl(RequestCode.S_PRIORITY, ctypes.c_uint32(PRIORITY_RECORD))
        except OSError as error:
            if error.errno not in (errno.EINVAL, errno.ENOTTY):
                raise translate(error, self._device, "claim camera", "a free camera") from error

    def _take(self) -> Filled | None:
        """Dequeue a buffer. After an error, restart filming once; raise a second error in a row."""
        with self._translating():
            try:
                try:
                    return self._ring.take()
                except OSError as error:
                    if self._healing or error.errno not in (errno.EIO, errno.EPIPE, errno.EINVAL):
                        raise
                self._healing = True
                self._ring.stop()
                self._ring.start()
                self._numbers.restarted()
                return self._ring.take()
            except OSError:
                self._healing = False  # the next call may restart filming again
                raise

    def _translating(self) -> AbstractContextManager[None]:
        return translating(self._device, "get frame", "a frame")

    @property
    def _ring(self) -> Buffers:
        assert self._buffers is not None
        return self._buffers

    def _frame(self, filled: Filled, after_s: float) -> Frame | None:
        self._healing = False
        self.seen += 1
        require_monotonic(filled.flags, self._device)
        received_s = self._clock.now_s()
        sequence = self._numbers.number(filled.sequence, filled.stamp_s)
        exposed_s = self._rule.exposed_s(filled)
        if self._unsettled:
            self._unsettled -= 1
            return None
        if exposed_s < after_s:
            return None
        if exposed_s > received_s:
            raise self._fault(
                "a frame from the past",
                f"one exposed {exposed_s - received_s:.3f} s from now",
                "report it to the maker of the camera's kernel driver",
            )
        # An uncompressed picture has a fixed size. Extra bytes are padding. Missing bytes mean an incomplete
        # transfer.
        short = SHORT if filled.bytes_used < self._picture.whole_bytes else 0
        flags = filled.flags & BufferFlag.ERROR | short
        middle_s, middle_std_s = self._rule.middle(filled)
        return Frame(
            image=self._image(filled, damaged=flags != 0),
            exposed_s=exposed_s,
            received_s=received_s,
            utc=self._utc_of(exposed_s),
            sequence=sequence,
            flags=flags,
            exposure_us=self.exposure.time_us,
            gain=self.exposure.gain,
            middle_s=middle_s,
            middle_std_s=middle_std_s,
        )

    def _image(self, filled: Filled, *, damaged: bool) -> Image:
        picture = self._picture
        with self._ring.memory(filled) as memory:
            image = grey_levels(memory, picture.grey, picture.width, picture.height, picture.stride)
        highest = int(image.max())
        if highest >> picture.grey.bits and not damaged:
            raise self._fault(
                f"grey levels of {picture.grey.bits} bits",
                str(highest),
                "choose format Y16: the camera uses more bits than the format says",
            )
        return image

    def _utc_of(self, time_s: float) -> datetime:
        return self._clock.utc() - timedelta(seconds=self._clock.now_s() - time_s)
