"""What a text instrument needs whether it is asked or sends lines by itself."""

import re
from abc import ABC, abstractmethod

from drivers.channels.device_time import SECONDS, DeviceTime
from drivers.channels.text.settings import TextChannelSettings, TextCheck
from drivers.clock import Event
from drivers.errors import DeviceFault, DeviceTimeout, LinkLost
from drivers.interfaces import DeviceInfo, OpenContext
from drivers.lines.addresses import resolve_address
from drivers.lines.call_time import CallTime
from drivers.signals import Samples


class TextDevice(ABC):
    """A `ChannelDevice` that talks in lines of text.

    If the line is lost, the next `read` opens it again, identifies the instrument and sends the opening
    commands. A subclass calls `_open` at the end of its constructor.
    """

    info: DeviceInfo

    def __init__(self, settings: TextChannelSettings, context: OpenContext) -> None:
        self.signals = settings.declared
        self.rate_hz = settings.rate_hz
        self._settings = settings
        self._address = resolve_address(settings.address, context)
        self._name = f"{context.name} ({self._address})"
        self._clock, self._patience_s = context.clock, context.patience_s
        time = settings.time
        self._time = None if time is None else DeviceTime(SECONDS[time.unit], time.wraps_at)
        self._ignored = [re.compile(text) for text in settings.ignore]
        self._closed = Event()
        self._is_ready = False
        self._ready_s = 0.0

    def read(self, timeout_s: float) -> Samples:
        """Return the next samples.

        Raise `DeviceTimeout` if no valid line comes within `timeout_s`, `LinkLost` if the line is lost, and
        `DeviceFault` if the instrument was restarted or is not the right one.
        """
        self._require_open()
        call_time = CallTime(timeout_s, patience_s=self._patience_s)
        try:
            with call_time.call():
                return self._read(call_time)
        except LinkLost:
            self._drop()
            raise

    def close(self) -> None:
        """Release the line. A repeated call has no effect."""
        self._closed.set()
        self._drop()

    @abstractmethod
    def _connect(self, call_time: CallTime) -> None:
        """Open the line if it is not open. Raise `LinkLost` if this fails."""

    @abstractmethod
    def _make_ready(self, call_time: CallTime) -> None:
        """Identify the instrument, send the opening commands, and check that it reports no error."""

    @abstractmethod
    def _read(self, call_time: CallTime) -> Samples:
        """Return the next samples. The errors are those of `read`."""

    @abstractmethod
    def _drop(self) -> None:
        """Close the line if it is open."""

    def _open(self) -> None:
        """Open the instrument, and read it once. Raise `DeviceError` if this fails."""
        call_time = CallTime(patience_s=self._patience_s)
        try:
            self._connect(call_time)
            self._clock.sleep(self._settings.start_s)
            with call_time.opening(self._settings.longest_wait_s):
                self._make_ready(call_time)
                self._is_ready = True
                self._read(call_time)
        except BaseException:
            self.close()
            raise

    def _require_open(self) -> None:
        # Samples that wait from the time before are not those of a closed device.
        if self._closed.is_set():
            raise LinkLost(self._name, "read", "an open port", "the port was closed", "open the device again")

    def _require_ready(self, call_time: CallTime) -> None:
        """Open the line and make the instrument ready, if this is not done yet."""
        self._require_open()
        self._connect(call_time)
        if not self._is_ready:
            self._wait_until(self._ready_s, call_time, "an instrument that is still starting")
            self._make_ready(call_time)
            self._is_ready = True

    def _wait_until(self, due_s: float, call_time: CallTime, what: str) -> None:
        """Wait until a time. Raise `DeviceTimeout` if the call ends before."""
        wait_s, left_s = due_s - self._clock.now_s(), call_time.left_s
        if wait_s > 0.0:
            self._clock.wait(self._closed, min(wait_s, left_s))
        if wait_s > left_s:
            expected = f"a sample within {left_s:.3g} s"
            raise DeviceTimeout(self._name, "read", expected, what, "allow more time for a sample")

    def _require(self, check: TextCheck, answer: str, step: str, remedy: str) -> None:
        if not fits(check, answer):
            got = f"{answer!r} to {check.query!r}"
            raise DeviceFault(self._name, step, described(check), got, f"{remedy}, or correct the pattern")

    def _restarted(self, what: str) -> DeviceFault:
        remedy = "find out why the instrument restarted, then start again"
        return DeviceFault(self._name, "read", "a time and a counter that increase", what, remedy)

    def _is_ignored(self, line: str) -> bool:
        return any(pattern.fullmatch(line) for pattern in self._ignored)


def fits(check: TextCheck, line: str) -> bool:
    """Return whether a line is the answer that a check expects."""
    return re.fullmatch(check.pattern, line) is not None


def described(check: TextCheck) -> str:
    """Return the expected answer in words."""
    return f"an answer that fits the pattern {check.pattern!r}"
