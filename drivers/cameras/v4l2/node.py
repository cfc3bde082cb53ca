"""Interface between the camera driver and the kernel: finding, opening and using device nodes.

The other modules of the V4L2 driver reach the kernel only through the classes `Node` and `System` of this
module. The tests replace both by a simulated kernel.
"""

import ctypes
import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from drivers.errors import DeviceError, DeviceFault, DeviceTimeout, LinkLost

LONGEST_WAIT_S = 3600.0
"""Longest single wait in seconds, because the kernel counts the milliseconds of a wait in 32 bits."""


class Node:
    """An opened device node of a camera."""

    def __init__(self, path: str) -> None:
        self._file = os.open(path, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)

    def ioctl(self, request: int, argument: ctypes.Structure | ctypes.c_int | ctypes.c_uint32) -> None:
        """Send one request, and send it again if a signal interrupts it.

        The kernel writes its answer into `argument`. Raise `OSError` if it refuses.
        """
        import fcntl

        while True:
            try:
                fcntl.ioctl(self._file, request, argument)
                return
            except InterruptedError:
                continue

    def map(self, length: int, offset: int) -> Any:
        """Return a buffer of the kernel driver as writable memory, which has a method ``close``."""
        import mmap

        return mmap.mmap(self._file, length, mmap.MAP_SHARED, offset=offset)

    def wait(self, timeout_s: float) -> bool:
        """Wait for a filled buffer or an error. Return False if neither came, perhaps before the timeout."""
        import select

        poll = select.poll()
        poll.register(self._file, select.POLLIN)
        return bool(poll.poll(min(max(0.0, timeout_s), LONGEST_WAIT_S) * 1000))

    def close(self) -> None:
        """Release the node. A repeated call has no effect."""
        file, self._file = self._file, -1
        if file >= 0:
            os.close(file)


class System:
    """The device nodes of this computer."""

    def paths(self) -> list[str]:
        """Return the existing paths ``/dev/video0``, ``/dev/video1`` and so on, sorted by number."""
        found = [path for path in Path("/dev").glob("video*") if path.name[5:].isdigit()]
        return [str(path) for path in sorted(found, key=lambda path: int(path.name[5:]))]

    def open(self, path: str) -> Node:
        """Open a node in non-blocking mode. Raise `OSError` if the node cannot be opened."""
        return Node(path)

    def usb_facts(self, path: str) -> dict[str, str]:
        """Return the known attributes of a node's USB device: ``serial``, ``manufacturer``, ``bcdDevice``."""
        # take the parent folder, because the folder ``device`` belongs to the USB interface and not to the
        # device
        folder = Path("/sys/class/video4linux") / Path(path).resolve().name / "device" / ".."
        facts = {}
        for name in ("serial", "manufacturer", "bcdDevice"):
            with suppress(OSError):
                facts[name] = (folder / name).read_text("utf-8", "replace").strip()
        return facts


_MEANINGS: dict[int, tuple[type[DeviceError], str, str]] = {
    errno.ENOENT: (LinkLost, "no such device", "plug the camera in, or name it by its bus or serial number"),
    errno.ENODEV: (LinkLost, "an unplugged camera", "plug the camera in again"),
    errno.ENXIO: (LinkLost, "an unplugged camera", "plug the camera in again"),
    errno.EBUSY: (DeviceFault, "a camera in use", "end the other program that films with it"),
    errno.ENOTTY: (DeviceFault, "a device that does not know the request", "name another device"),
    errno.ENOSPC: (DeviceFault, "too little USB bandwidth", "give the camera a USB controller of its own"),
    errno.EPIPE: (DeviceFault, "a refusal by the camera", "choose a value that the camera takes"),
    errno.ERANGE: (DeviceFault, "a value out of range", "choose a value that the camera takes"),
    errno.EIO: (DeviceFault, "an input/output error", "check cable and power, then plug the camera in again"),
    errno.EPROTO: (DeviceFault, "a USB protocol error", "check cable and hub"),
    errno.ETIMEDOUT: (DeviceTimeout, "no answer", "check cable and power, then plug the camera in again"),
}


def translate(error: OSError, device: str, step: str, expected: str) -> DeviceError:
    """Return a `DeviceError` with cause and remedy for an `OSError` of the kernel."""
    number = error.errno or 0
    kind: type[DeviceError]
    if number in (errno.EACCES, errno.EPERM):
        kind, got, remedy = DeviceFault, "a refusal of access", "join the group 'video' and log in again"
    else:
        kind, got, remedy = _MEANINGS.get(
            number, (DeviceFault, "an error", "see the kernel's log (dmesg) for its cause")
        )
    name = errno.errorcode.get(number, str(number))
    return kind(device, step, expected, f"{got} ({name})", remedy)


@contextmanager
def translating(device: str, step: str, expected: str) -> Iterator[None]:
    """Within a `with` block, raise the `DeviceError` of `translate` for an `OSError` of the kernel."""
    try:
        yield
    except OSError as error:
        raise translate(error, device, step, expected) from error
