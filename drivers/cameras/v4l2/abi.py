"""Memory layout of the Linux kernel's camera interface: structures, request codes and constants.

Source: the kernel's headers ``linux/videodev2.h`` and ``linux/v4l2-controls.h``, for 64-bit little-endian
machines. A test compares every size and offset with the values of a C compiler.
"""

import ctypes
from enum import IntEnum, IntFlag

CAPTURE = 1
"""The kernel's constant ``V4L2_BUF_TYPE_VIDEO_CAPTURE``."""
MMAP = 1
"""The kernel's constant ``V4L2_MEMORY_MMAP``."""
PRIORITY_RECORD = 3
NEXT_CONTROL = 0x8000_0000
CONTROL_NAMES = 32


class Capability(IntFlag):
    """Bits for the functions that a device node supports (``V4L2_CAP_…``)."""

    VIDEO_CAPTURE = 0x1
    VIDEO_CAPTURE_MPLANE = 0x1000
    STREAMING = 0x0400_0000
    DEVICE_CAPS = 0x8000_0000


class BufferFlag(IntFlag):
    """Flags of a filled buffer. `CLOCK` and `STAMP_PLACE` are masks for clock type and timestamp source."""

    ERROR = 0x40
    CLOCK = 0xE000
    MONOTONIC = 0x2000
    STAMP_PLACE = 0x70000
    STAMP_AT_START = 0x10000


class ControlFlag(IntFlag):
    """Flags that describe a camera control (``V4L2_CTRL_FLAG_…``)."""

    DISABLED = 0x1
    READ_ONLY = 0x4
    INACTIVE = 0x10


class ControlType(IntEnum):
    """Types of camera controls whose value is a single 32-bit number."""

    INTEGER = 1
    BOOLEAN = 2
    MENU = 3
    BITMASK = 8
    INTEGER_MENU = 9


class ControlId(IntEnum):
    """Identifiers of the camera controls that affect grey levels."""

    AUTO_WHITE_BALANCE = 0x98090C
    EXPOSURE = 0x980911
    AUTOGAIN = 0x980912
    GAIN = 0x980913
    POWER_LINE_FREQUENCY = 0x980918
    HUE_AUTO = 0x980919
    BACKLIGHT_COMPENSATION = 0x98091C
    CHROMA_AGC = 0x98091D
    AUTOBRIGHTNESS = 0x980920
    EXPOSURE_AUTO = 0x9A0901
    EXPOSURE_ABSOLUTE = 0x9A0902
    EXPOSURE_AUTO_PRIORITY = 0x9A0903
    FOCUS_AUTO = 0x9A090C
    AUTO_N_PRESET_WHITE_BALANCE = 0x9A0914
    WIDE_DYNAMIC_RANGE = 0x9A0915
    IMAGE_STABILIZATION = 0x9A0916
    ISO_SENSITIVITY_AUTO = 0x9A0918
    ANALOGUE_GAIN = 0x9E0903


def _words(*names: str) -> tuple[tuple[str, type[ctypes.c_uint32]], ...]:
    return tuple((name, ctypes.c_uint32) for name in names)


class CapabilityInfo(ctypes.Structure):
    """Memory layout of the kernel's ``struct v4l2_capability``."""

    _fields_ = (
        ("driver", ctypes.c_char * 16),
        ("card", ctypes.c_char * 32),
        ("bus_info", ctypes.c_char * 32),
        *_words("version", "capabilities", "device_caps"),
        ("reserved", ctypes.c_uint32 * 3),
    )


class PixelFormat(ctypes.Structure):
    """Memory layout of the kernel's ``struct v4l2_pix_format``."""

    _fields_ = (
        *_words("width", "height", "pixelformat", "field", "bytesperline", "sizeimage", "colorspace"),
        *_words("priv", "flags", "ycbcr_enc", "quantization", "xfer_func"),
    )


class _FormatUnion(ctypes.Union):
    _fields_ = (("pix", PixelFormat), ("raw", ctypes.c_uint8 * 200), ("_align", ctypes.c_uint64))


class Format(ctypes.Structure):
    """Memory layout of the kernel's ``struct v4l2_format``."""

    _fields_ = (("type", ctypes.c_uint32), ("fmt", _FormatUnion))


class CaptureParameters(ctypes.Structure):
    """Memory layout of ``struct v4l2_streamparm``. The frame interval in s is numerator / denominator."""

    _fields_ = (
        *_words("type", "capability", "capturemode", "numerator", "denominator"),
        *_words("extendedmode", "readbuffers"),
        ("reserved", ctypes.c_uint8 * 176),
    )


class BufferRequest(ctypes.Structure):
    """Memory layout of the kernel's ``struct v4l2_requestbuffers``."""

    _fields_ = _words("count", "type", "memory", "capabilities", "reserved")


class Buffer(ctypes.Structure):
    """Memory layout of the kernel's ``struct v4l2_buffer``."""

    _fields_ = (
        *_words("index", "type", "bytesused", "flags", "field"),
        ("seconds", ctypes.c_int64),
        ("microseconds", ctypes.c_int64),
        ("timecode", ctypes.c_uint32 * 4),
        *_words("sequence", "memory"),
        ("offset", ctypes.c_uint64),
        *_words("length", "reserved2", "request_fd"),
    )


class ControlQuery(ctypes.Structure):
    """Memory layout of the kernel's ``struct v4l2_queryctrl``."""

    _fields_ = (
        *_words("id", "type"),
        ("name", ctypes.c_char * CONTROL_NAMES),
        ("minimum", ctypes.c_int32),
        ("maximum", ctypes.c_int32),
        ("step", ctypes.c_int32),
        ("default_value", ctypes.c_int32),
        ("flags", ctypes.c_uint32),
        ("reserved", ctypes.c_uint32 * 2),
    )


class ControlValue(ctypes.Structure):
    """Memory layout of the kernel's ``struct v4l2_control``."""

    _fields_ = (("id", ctypes.c_uint32), ("value", ctypes.c_int32))


_WRITE, _READ = 1, 2


def _request(direction: int, number: int, size: int) -> int:
    """Return the code that ``_IOC(direction, 'V', number, size)`` gives in C."""
    return direction << 30 | size << 16 | ord("V") << 8 | number


class RequestCode(IntEnum):
    """Codes of the kernel requests (``VIDIOC_…``) that the driver uses."""

    QUERYCAP = _request(_READ, 0, ctypes.sizeof(CapabilityInfo))
    G_FMT = _request(_READ | _WRITE, 4, ctypes.sizeof(Format))
    S_FMT = _request(_READ | _WRITE, 5, ctypes.sizeof(Format))
    REQBUFS = _request(_READ | _WRITE, 8, ctypes.sizeof(BufferRequest))
    QUERYBUF = _request(_READ | _WRITE, 9, ctypes.sizeof(Buffer))
    QBUF = _request(_READ | _WRITE, 15, ctypes.sizeof(Buffer))
    DQBUF = _request(_READ | _WRITE, 17, ctypes.sizeof(Buffer))
    STREAMON = _request(_WRITE, 18, 4)
    STREAMOFF = _request(_WRITE, 19, 4)
    G_PARM = _request(_READ | _WRITE, 21, ctypes.sizeof(CaptureParameters))
    S_PARM = _request(_READ | _WRITE, 22, ctypes.sizeof(CaptureParameters))
    G_CTRL = _request(_READ | _WRITE, 27, ctypes.sizeof(ControlValue))
    S_CTRL = _request(_READ | _WRITE, 28, ctypes.sizeof(ControlValue))
    QUERYCTRL = _request(_READ | _WRITE, 36, ctypes.sizeof(ControlQuery))
    S_INPUT = _request(_READ | _WRITE, 39, 4)
    S_PRIORITY = _request(_WRITE, 68, 4)


def fourcc(code: str) -> int:
    """Return the number of a pixel format with a four-character code such as ``GREY`` or ``Y10 ``."""
    return int.from_bytes(code.ljust(4).encode("ascii"), "little")


def code_of(number: int) -> str:
    """Return the four-character code of a pixel format's number, for error messages."""
    return number.to_bytes(4, "little").decode("ascii", "replace").strip()
