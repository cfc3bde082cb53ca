"""A simulated kernel with a camera, for the interface `drivers.cameras.v4l2.node`, with all possible faults.

The camera films on the virtual clock. Each picture shows its number, so that a test can identify the frames.
"""

import errno
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from drivers.cameras.v4l2.abi import (
    NEXT_CONTROL,
    Buffer,
    BufferFlag,
    Capability,
    ControlFlag,
    ControlId,
    ControlType,
    RequestCode,
    fourcc,
)
from drivers.clock import VirtualClock


@dataclass
class FakeControl:
    """One camera control. If `keeps` is given, the camera keeps this value when another value is written."""

    name: str
    value: int
    minimum: int = 0
    maximum: int = 1
    step: int = 1
    flags: int = 0
    keeps: int | None = None
    type: int = ControlType.INTEGER


def uvc_controls() -> dict[int, FakeControl]:
    """Return the controls of a usual USB camera after plugging in, with all automatic controls on."""
    return {
        ControlId.AUTO_WHITE_BALANCE: FakeControl("White Balance, Automatic", 1),
        ControlId.GAIN: FakeControl("Gain", 20, 0, 100),
        ControlId.POWER_LINE_FREQUENCY: FakeControl("Power Line Frequency", 1, 0, 2),
        ControlId.EXPOSURE_AUTO: FakeControl("Auto Exposure", 3, 0, 3),
        ControlId.EXPOSURE_ABSOLUTE: FakeControl(
            "Exposure Time, Absolute", 156, 1, 10_000, flags=ControlFlag.INACTIVE
        ),
        ControlId.EXPOSURE_AUTO_PRIORITY: FakeControl("Exposure, Dynamic Framerate", 1),
    }


@dataclass
class FakeCamera:
    """A plugged-in camera and its kernel driver. The attributes set its faults.

    `frame_faults` maps the number of a picture to its fault. The faults are ``lost``, ``damaged``, ``short``,
    and ``unpadded`` (without the padding of the last row). With ``uncounted``, the time of three more frames
    passes without frames. With ``repeat``, the counter does not increase. With ``broken``, the stream reports
    an input/output error. With ``late``, the timestamp is late by almost one frame time. `errors` maps a
    request to the errors that the next calls of this request raise.
    """

    clock: VirtualClock
    path: str = "/dev/video0"
    driver: bytes = b"uvcvideo"
    card: bytes = b"Mono 12"
    bus: bytes = b"usb-0000:00:14.0-2"
    serial: str = "A17"
    code: str = "Y12"
    width: int = 32
    height: int = 20
    padding: int = 0
    interval_s: float = 1 / 32
    caps: int = Capability.VIDEO_CAPTURE | Capability.STREAMING
    stamp: int = BufferFlag.MONOTONIC | BufferFlag.STAMP_AT_START
    stamp_offset_s: float = 0.0
    controls: dict[int, FakeControl] = field(default_factory=uvc_controls)
    frame_faults: dict[int, str] = field(default_factory=dict)
    errors: dict[int, list[int]] = field(default_factory=dict)
    first_counter: int = 0
    offered: tuple[str, ...] = ("GREY", "Y10", "Y12", "Y16", "YUYV")
    offers_rate: bool = True
    level_mask: int = 0xFFF
    present: bool = True
    stalled: bool = False
    most_buffers: int = 32

    def __post_init__(self) -> None:
        self.stride = 0
        self.rate = (1, 32)
        self.streaming = False
        self.queued: deque[int] = deque()
        self.filled: deque[Buffer] = deque()
        self.memory: list[bytearray] = []
        self.mapped = 0
        self.open_nodes = 0
        self.begun_s = 0.0
        self.shown = 0
        self.counter = 0

    @property
    def pixel_bytes(self) -> int:
        return 1 if self.code == "GREY" else 2

    def picture(self, number: int) -> bytes:
        """Return the bytes of a picture, with one grey level in all rows and other bytes in the padding."""
        level = (number * 37 + 11) & self.level_mask
        if self.code == "YUYV":
            row = bytes([level & 0xFF, 128] * self.width)
        else:
            row = level.to_bytes(2, "little")[: self.pixel_bytes] * self.width
        return (row + b"\xee" * (self.stride - len(row))) * self.height

    def pass_time(self) -> None:
        """Expose all frames that are due by now."""
        while self.streaming and not self.stalled and self.present:
            begin_s = self.begun_s + self.counter * self.interval_s
            if begin_s + self.interval_s > self.clock.now_s():
                return
            number, counter = self.shown, (self.counter + self.first_counter) % 2**32
            self.shown += 1
            self.counter += 1
            fault = self.frame_faults.get(number, "")
            if fault == "uncounted":
                self.begun_s += 3 * self.interval_s
            if fault == "repeat":
                self.first_counter -= 1
            if fault == "broken":
                self.errors[RequestCode.DQBUF] = [errno.EIO]
            if fault in ("lost", "uncounted", "broken") or not self.queued:
                continue
            index = self.queued.popleft()
            data = self.picture(number)
            used = len(data) // 2 if fault == "short" else len(data) - self.padding * (fault == "unpadded")
            self.memory[index][:used] = data[:used]
            late_s = 0.9 * self.interval_s if fault == "late" else 0.0
            stamp_s = begin_s + self.stamp_offset_s + late_s
            flags = self.stamp | (BufferFlag.ERROR if fault == "damaged" else 0)
            seconds = int(stamp_s)
            self.filled.append(
                Buffer(
                    index=index,
                    bytesused=used,
                    flags=flags,
                    sequence=counter,
                    seconds=seconds,
                    microseconds=round((stamp_s - seconds) * 1e6),
                )
            )


class FakeNode:
    def __init__(self, camera: FakeCamera) -> None:
        self.camera = camera
        self.closed = False
        camera.open_nodes += 1

    def ioctl(self, request: int, argument: object) -> None:
        camera = self.camera
        if not camera.present:
            raise OSError(errno.ENODEV, "gone")
        if camera.errors.get(request):
            raise OSError(camera.errors[request].pop(0), "injected")
        camera.pass_time()
        getattr(self, RequestCode(request).name.lower())(argument)

    def map(self, length: int, offset: int) -> object:
        return _mapped(self.camera, offset // 4096)

    def wait(self, timeout_s: float) -> bool:
        camera, step_s = self.camera, self.camera.interval_s / 8
        end_s = camera.clock.now_s() + timeout_s
        while camera.clock.now_s() < end_s:
            if not camera.present or camera.errors.get(RequestCode.DQBUF):
                return True
            camera.pass_time()
            if camera.filled:
                return True
            camera.clock.sleep(min(step_s, timeout_s))
        return False

    def close(self) -> None:
        if not self.closed:
            self.closed = True
            self.camera.open_nodes -= 1

    def querycap(self, info) -> None:
        camera = self.camera
        info.driver, info.card, info.bus_info = camera.driver, camera.card, camera.bus
        info.version = 6 << 16 | 1 << 8
        info.capabilities = camera.caps | Capability.DEVICE_CAPS | Capability.VIDEO_CAPTURE
        info.device_caps = camera.caps

    def s_priority(self, argument) -> None:
        pass

    def s_input(self, argument) -> None:
        if argument.value:
            raise OSError(errno.EINVAL, "no such input")

    def s_fmt(self, format) -> None:
        pix, camera = format.fmt.pix, self.camera
        codes = {fourcc(code): code for code in camera.offered}
        camera.code = codes.get(pix.pixelformat, camera.offered[0])
        pix.width, pix.height = min(pix.width, 64), min(pix.height, 64)
        camera.width, camera.height = pix.width, pix.height
        camera.stride = pix.width * camera.pixel_bytes + camera.padding
        self.g_fmt(format)

    def g_fmt(self, format) -> None:
        pix, camera = format.fmt.pix, self.camera
        pix.width, pix.height = camera.width, camera.height
        pix.pixelformat = fourcc(camera.code)
        pix.bytesperline, pix.sizeimage, pix.field = camera.stride, camera.stride * camera.height, 1

    def g_parm(self, parameters) -> None:
        parameters.numerator, parameters.denominator = self.camera.rate

    def s_parm(self, parameters) -> None:
        self.camera.rate = parameters.numerator, parameters.denominator
        if not self.camera.offers_rate:
            parameters.numerator, parameters.denominator = 1, 25

    def reqbufs(self, request) -> None:
        self.streamoff(None)
        request.count = min(request.count, self.camera.most_buffers)
        self.camera.memory = [
            bytearray(self.camera.stride * self.camera.height) for _ in range(request.count)
        ]

    def querybuf(self, buffer) -> None:
        buffer.length, buffer.offset = len(self.camera.memory[0]), buffer.index * 4096

    def qbuf(self, buffer) -> None:
        assert buffer.index not in self.camera.queued
        self.camera.queued.append(buffer.index)

    def dqbuf(self, buffer) -> None:
        if not self.camera.streaming:
            raise OSError(errno.EINVAL, "not streaming")
        if not self.camera.filled:
            raise BlockingIOError(errno.EAGAIN, "nothing yet")
        done = self.camera.filled.popleft()
        for name in ("index", "bytesused", "flags", "sequence", "seconds", "microseconds"):
            setattr(buffer, name, getattr(done, name))

    def streamon(self, argument) -> None:
        camera = self.camera
        camera.streaming, camera.begun_s, camera.counter = True, camera.clock.now_s(), 0

    def streamoff(self, argument) -> None:
        self.camera.streaming = False
        self.camera.queued.clear()
        self.camera.filled.clear()

    def queryctrl(self, query) -> None:
        after = query.id & ~NEXT_CONTROL
        one = after == query.id
        later = [id for id in sorted(self.camera.controls) if id > after or (one and id == after)]
        if not later:
            raise OSError(errno.EINVAL, "no more")
        control = self.camera.controls[later[0]]
        query.id, query.type, query.name = later[0], control.type, control.name.encode()
        query.minimum, query.maximum = control.minimum, control.maximum
        query.step, query.flags = control.step, control.flags

    def g_ctrl(self, request) -> None:
        request.value = self.camera.controls[request.id].value

    def s_ctrl(self, request) -> None:
        controls = self.camera.controls
        control = controls[request.id]
        automatic = controls.get(ControlId.EXPOSURE_AUTO)
        held = automatic is not None and automatic.value not in (1, 2)  # manual, and shutter priority
        if request.id == ControlId.EXPOSURE_ABSOLUTE and held:
            raise PermissionError(errno.EACCES, "automatic")
        if control.flags & ControlFlag.READ_ONLY:
            raise PermissionError(errno.EACCES, "read-only")
        control.value = request.value if control.keeps is None else control.keeps
        exposure = controls.get(ControlId.EXPOSURE_ABSOLUTE)
        if request.id == ControlId.EXPOSURE_AUTO and exposure is not None:
            manual = control.value == 1
            exposure.flags = exposure.flags & ~ControlFlag.INACTIVE if manual else ControlFlag.INACTIVE


def _mapped(camera: FakeCamera, index: int) -> object:
    class Mapped(np.ndarray):
        def close(self) -> None:
            camera.mapped -= 1

    camera.mapped += 1
    return np.frombuffer(camera.memory[index], np.uint8).view(Mapped)


@dataclass
class FakeSystem:
    """A computer to which the given cameras are connected."""

    cameras: list[FakeCamera]

    def paths(self) -> list[str]:
        return [camera.path for camera in self.cameras if camera.present]

    def open(self, path: str) -> FakeNode:
        for camera in self.cameras:
            if camera.path == path and camera.present:
                return FakeNode(camera)
        raise FileNotFoundError(errno.ENOENT, "no such device")

    def usb_facts(self, path: str) -> dict[str, str]:
        camera = next(camera for camera in self.cameras if camera.path == path)
        return {"serial": camera.serial, "manufacturer": "Maker"} if camera.serial else {}
