"""Set the picture format and the frame rate, read both back, and refuse a difference."""

import ctypes
import errno
from dataclasses import dataclass
from fractions import Fraction

from drivers.cameras.v4l2.abi import (
    CAPTURE,
    CaptureParameters,
    Format,
    PixelFormat,
    RequestCode,
    code_of,
    fourcc,
)
from drivers.cameras.v4l2.node import Node, translate, translating
from drivers.cameras.v4l2.pixels import FORMATS, Grey, bytes_needed
from drivers.cameras.v4l2.settings import V4l2Settings
from drivers.errors import DeviceFault
from drivers.interfaces import Setting

RATE_TOLERANCE = 1e-3
PROGRESSIVE = 1
_LARGEST_DENOMINATOR = 1001  # a frame rate of 30000/1001 Hz needs this denominator


@dataclass(frozen=True)
class PictureFormat:
    """Format of the pictures in the buffers. `interval_s` is the time between two pictures in seconds."""

    grey: Grey
    width: int
    height: int
    stride: int
    interval_s: float

    @property
    def whole_bytes(self) -> int:
        """Number of bytes of a complete picture in a buffer."""
        return bytes_needed(self.grey, self.width, self.height, self.stride)


def set_picture(node: Node, settings: V4l2Settings, device: str) -> PictureFormat:
    """Set the input, the pixel format, the picture size and the frame rate of a camera.

    Raise `DeviceFault` if the camera is in use, or returns another format, size, stride or rate.
    """
    code, width, height = settings.format, settings.width_px, settings.height_px
    try:
        node.ioctl(RequestCode.S_INPUT, ctypes.c_int(settings.input))
    except OSError as error:
        # ignore the error for input 0, because a camera with one input may not support this request
        if settings.input or error.errno not in (errno.EINVAL, errno.ENOTTY):
            raise translate(error, device, "choose input", f"input {settings.input}") from error
    wanted = f"{width} x {height} px {code}"
    format = Format(type=CAPTURE)
    pix = format.fmt.pix
    pix.width, pix.height, pix.pixelformat = width, height, fourcc(code)
    pix.field, pix.bytesperline = PROGRESSIVE, settings.stride_bytes
    with translating(device, "set format", wanted):
        node.ioctl(RequestCode.S_FMT, format)
        _require(device, wanted, pix, settings.stride_bytes)
        rate = _set_rate(node, device, settings.rate_hz)
        # read the picture format again, because setting the frame rate may have changed it
        node.ioctl(RequestCode.G_FMT, format)
        _require(device, wanted, pix, settings.stride_bytes)
    grey = FORMATS[code]
    picture = PictureFormat(grey, width, height, pix.bytesperline or width * grey.pixel_bytes, 1 / rate)
    if picture.stride < width * grey.pixel_bytes or pix.sizeimage < picture.whole_bytes:
        raise DeviceFault(
            device,
            "set format",
            f"rows of at least {width * grey.pixel_bytes} bytes, {height} of them",
            f"rows of {picture.stride} bytes in buffers of {pix.sizeimage}",
            "report it to the maker of the camera's kernel driver",
        )
    return picture


def read_picture(node: Node, device: str) -> dict[str, Setting]:
    """Return picture format and frame rate, as the kernel reports them. Raise `DeviceError` if this fails."""
    format, parameters = Format(type=CAPTURE), CaptureParameters(type=CAPTURE)
    with translating(device, "read settings", "format and frame rate"):
        node.ioctl(RequestCode.G_FMT, format)
        node.ioctl(RequestCode.G_PARM, parameters)
    pix = format.fmt.pix
    return {
        "format": code_of(pix.pixelformat),
        "width_px": int(pix.width),
        "height_px": int(pix.height),
        "stride_bytes": int(pix.bytesperline),
        "rate_hz": parameters.denominator / parameters.numerator if parameters.numerator else 0.0,
    }


def _require(device: str, wanted: str, pix: PixelFormat, stride: int) -> None:
    got = f"{pix.width} x {pix.height} px {code_of(pix.pixelformat)}"
    if got != wanted or pix.field != PROGRESSIVE:
        got += "" if pix.field == PROGRESSIVE else f", interlaced (field {pix.field})"
        raise DeviceFault(device, "set format", wanted, got, "see v4l2-ctl --list-formats-ext")
    if stride not in (0, pix.bytesperline):
        raise DeviceFault(
            device,
            "set stride",
            f"rows of {stride} bytes",
            f"rows of {pix.bytesperline}",
            "leave out `stride_bytes`",
        )


def _set_rate(node: Node, device: str, rate_hz: float) -> float:
    rate = Fraction(rate_hz).limit_denominator(_LARGEST_DENOMINATOR)
    parameters = CaptureParameters(type=CAPTURE, numerator=rate.denominator, denominator=rate.numerator)
    with translating(device, "set frame rate", f"{rate_hz:g} Hz"):
        node.ioctl(RequestCode.S_PARM, parameters)
    got = parameters.denominator / parameters.numerator if parameters.numerator else 0.0
    if abs(got - rate_hz) > RATE_TOLERANCE * rate_hz:
        raise DeviceFault(
            device,
            "set frame rate",
            f"{rate_hz:g} Hz",
            f"{got:g} Hz",
            "choose a rate that the camera has at this size: v4l2-ctl --list-formats-ext",
        )
    return got
