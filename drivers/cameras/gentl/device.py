"""A connected camera of a GenTL producer: Python calls to ``harvesters`` and to ``genicam`` of EMVA.

The packages are imported when the program searches for cameras or opens a camera. The library ``genicam``
keeps Python's interpreter lock during each call. A call that waits would stop the whole program, so this
module only asks whether a frame is there, and never waits for one.

Harvesters throws incomplete buffers away. Therefore the frames are taken from the event of its data stream.
"""

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

AVAILABLE = (2, 3, 4)
"""Access modes of the GenICam standard: write only, read only, both."""
DTYPES: dict[int, Any] = {
    0x01080001: np.uint8,
    0x01100003: np.uint16,
    0x01100005: np.uint16,
    0x01100025: np.uint16,
    0x01100007: np.uint16,
}
"""Types of the pixels of Mono8, Mono10, Mono12, Mono14 and Mono16, by their numbers in the standard PFNC."""


_ADDENDA = re.compile(r" : \w+Exception thrown in node.*| \(Message from the source: \)| \(ID: -?\d+\)")
"""What the two packages add to a message and nobody at the rig can use."""


class GentlError(Exception):
    """An error reported by a GenTL producer or by the camera's features."""


@dataclass(frozen=True)
class Picture:
    """A filled buffer of a producer, copied.

    Attributes
    ----------
    number : int or None
        The camera's number of the frame; None if the producer tells none.
    stamp_s : float or None
        The camera's time stamp, in seconds on its own clock; None if there is none.
    pixels : ndarray of uint8 or uint16, shape (height, width), or None
        None if the buffer has no grey-level picture.
    complete : bool
    """

    number: int | None
    stamp_s: float | None
    pixels: NDArray[np.uint8] | NDArray[np.uint16] | None
    complete: bool


@contextmanager
def reporting() -> Iterator[None]:
    """Raise `GentlError` for each error of the two packages."""
    from genicam import genapi, gentl

    try:
        yield
    except (genapi.GenericException, gentl.GenericException) as error:
        raise GentlError(_ADDENDA.sub("", " ".join(str(error).split()))) from error


class Device:
    """A connected camera. All methods raise `GentlError` if the producer or the camera reports an error."""

    def __init__(self, acquirer: Any, closed: Callable[[], None]) -> None:
        self._acquirer = acquirer
        self._closed = closed
        self._nodes = acquirer.remote_device.node_map
        # Harvesters has no public way to see an incomplete buffer.
        arrivals = tuple(acquirer._new_buffer_event_monitor_dict.values())
        if not arrivals:
            self.close()
            raise GentlError("the camera offers no stream of images")
        self._arrivals = arrivals[0]

    def has(self, feature: str) -> bool:
        """Return whether the camera has a feature now."""
        with reporting():
            return bool(
                self._nodes.has_node(feature) and self._nodes.get_node(feature).get_access_mode() in AVAILABLE
            )

    def entries(self, feature: str) -> tuple[str, ...]:
        """Return the values that an enumeration may have."""
        with reporting():
            return tuple(self._nodes.get_node(feature).symbolics)

    def text(self, feature: str) -> str:
        """Return the value of a feature as text, read from the camera and not from the library's memory."""
        with reporting():
            return str(self._nodes.get_node(feature).to_string(False, True))

    def number(self, feature: str) -> float:
        """Return the value of a number, read from the camera."""
        with reporting():
            return float(self._nodes.get_node(feature).get_value(False, True))

    def set(self, feature: str, value: str | float | bool) -> None:
        """Set a feature, an enumeration by the name of its value, an integer to the nearest one."""
        from genicam.genapi import IInteger

        with reporting():
            node = self._nodes.get_node(feature)
            node.value = round(value) if isinstance(node, IInteger) and isinstance(value, float) else value

    def execute(self, feature: str) -> None:
        """Execute a command."""
        with reporting():
            self._nodes.get_node(feature).execute()

    def start(self, buffers: int) -> None:
        """Begin to film, with a number of buffers."""
        with reporting():
            self._acquirer.num_buffers = buffers
            self._acquirer.start()

    def pop(self) -> Picture | None:
        """Return the oldest frame that has arrived, or None. The method does not wait."""
        with reporting():
            buffer = self._arrived()
            if buffer is None:
                return None
            try:
                return self._picture(buffer)
            finally:
                buffer.parent.queue_buffer(buffer)

    def skip(self) -> bool:
        """Throw the oldest frame that has arrived away. Return False if there is none."""
        with reporting():
            buffer = self._arrived()
            if buffer is None:
                return False
            buffer.parent.queue_buffer(buffer)
            return True

    def _arrived(self) -> Any:
        from genicam.gentl import TimeoutException

        try:
            self._arrivals.update_event_data(0)
        except TimeoutException:
            return None
        return self._arrivals.buffer

    def close(self) -> None:
        """Stop filming and let the camera go. A repeated call has no effect."""
        acquirer, self._acquirer = self._acquirer, None
        if acquirer is not None:
            try:
                # the errors of a camera that is gone
                with suppress(GentlError), reporting():
                    acquirer.stop()
                with suppress(GentlError), reporting():
                    acquirer.destroy()
            finally:
                self._closed()

    def _picture(self, buffer: Any) -> Picture:
        complete = bool(told(buffer.is_complete, False))
        return Picture(
            number=told(lambda: int(buffer.frame_id)),
            stamp_s=self._stamp_s(buffer),
            pixels=_pixels(buffer),
            complete=complete,
        )

    def _stamp_s(self, buffer: Any) -> float | None:
        stamp_ns: int | None = told(lambda: int(buffer.timestamp_ns))
        if stamp_ns is not None:
            return stamp_ns * 1e-9
        ticks: int | None = told(lambda: int(buffer.timestamp))
        per_s: int | None = told(lambda: int(self._acquirer.device.timestamp_frequency))
        return ticks / per_s if ticks is not None and per_s else None


def told(ask: Callable[[], Any], otherwise: Any = None) -> Any:
    """Return what a producer tells, or `otherwise` if it does not tell this."""
    from genicam.gentl import GenericException

    try:
        return ask()
    except GenericException:
        return otherwise


def _pixels(buffer: Any) -> NDArray[np.uint8] | NDArray[np.uint16] | None:
    """Return a copy of the grey levels in a buffer, without the padding of its rows."""
    parts = tuple(buffer.parts)
    part = parts[0] if parts else buffer
    code = told(lambda: int(part.data_format if parts else part.pixel_format))
    width, height = told(lambda: int(part.width)), told(lambda: int(part.height))
    dtype = DTYPES.get(code)
    if dtype is None or not width or not height:
        return None
    padding = told(lambda: int(part.x_padding if parts else part.padding_x), 0)
    offset = told(lambda: int(part.data_offset if parts else part.image_offset), 0)
    memory = np.frombuffer(buffer.raw_buffer, np.uint8)
    row_bytes = width * np.dtype(dtype).itemsize
    stride = row_bytes + padding
    if offset + stride * (height - 1) + row_bytes > len(memory):
        return None
    rows = np.lib.stride_tricks.as_strided(memory[offset:], (height, row_bytes), (stride, 1), writeable=False)
    pixels: NDArray[np.uint8] | NDArray[np.uint16] = np.ascontiguousarray(rows).view(dtype).copy()
    return pixels
