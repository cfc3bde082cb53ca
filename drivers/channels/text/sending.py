"""A text instrument that sends lines by itself: one sample is one line."""

import math

from drivers.channels.sample_queue import RestartedError, SampleQueue
from drivers.channels.text.device import TextDevice, described, fits
from drivers.channels.text.fields import LineFields
from drivers.channels.text.listener import BACKLOG, ArrivedLine, Listener
from drivers.channels.text.opening import identity, open_line
from drivers.channels.text.settings import ENDS, TextChannelSettings, TextCheck
from drivers.clock import SystemClock
from drivers.errors import DeviceTimeout, LinkLost
from drivers.interfaces import OpenContext
from drivers.lines.call_time import CallTime
from drivers.lines.channel import CHANNEL_ERRORS
from drivers.signals import Samples

_REMEDY = "check power, cable, baud rate, and rate_hz, columns and patterns in the rig file"


class SendingText(TextDevice):
    """A text instrument that sends lines by itself.

    A line that does not fit, and a jump of the instrument's counter, count as lost samples. Without a time of
    the instrument, the sample of a line was taken after the line before had arrived, at the earliest.
    """

    def __init__(self, settings: TextChannelSettings, context: OpenContext) -> None:
        super().__init__(settings, context)
        self._listener: Listener | None = None
        heads = [each for each in (settings.time, settings.counter) if each is not None]
        self._fields = LineFields(settings, [*heads, *settings.signals.values()])
        self._queue = SampleQueue(settings, has_time=settings.time is not None)
        self._counter: int | None = None
        self._bad = ""
        self._waited_s = 0.0
        self._before_s = self._arrived_s = self._clock.now_s()
        self._open()

    def _read(self, call_time: CallTime) -> Samples:
        self._waited_s, real = call_time.last_wait_s(self._settings.longest_wait_s), SystemClock()
        end_s = real.now_s() + self._waited_s
        while not self._queue:
            self._require_ready(call_time)
            for line in self._take(end_s - real.now_s()):
                self._add(line)
        try:
            return self._queue.take()
        except RestartedError as restart:
            raise self._restarted(str(restart)) from restart

    def _add(self, line: ArrivedLine) -> None:
        """Append the sample of a line, unless the line came twice or has no valid form."""
        if line.arrived_s > self._arrived_s:
            self._before_s, self._arrived_s = self._arrived_s, line.arrived_s
        counted = self._settings.counter is not None
        self._lose(line.lost)
        if line.may_be_cut or self._is_ignored(line.text):
            return
        try:
            values = self._fields.read(line.text)
            time = values.pop(0) if self._time is not None else 0.0
            counter = values.pop(0) if counted else 0.0
            if not (math.isfinite(time) and counter == math.floor(counter)):
                raise ValueError(f"{line.text!r} without a time or a whole number as counter")
        except (ValueError, OverflowError) as error:
            self._bad = str(error)
            self._lose(1)
            return
        if self._time is not None and self._time.is_repeated(time):
            return
        device_s = math.nan if self._time is None else self._time.seconds(time, line.arrived_s)
        restart = "" if self._time is None else self._time.restart
        if counted:
            if int(counter) == self._counter:
                return
            restart = self._count(int(counter)) or restart
        self._queue.add(values, self._before_s, line.arrived_s, device_s, restart)

    def _lose(self, count: int) -> None:
        """Count lost lines, unless the instrument's own counter tells them."""
        if self._settings.counter is None:
            self._queue.lose(count)

    def _count(self, counter: int) -> str:
        """Add the lines that are missing before a counter. Return a sentence if the counter went back."""
        last, self._counter = self._counter, counter
        if last is None:
            return ""
        settings = self._settings.counter
        wraps_at = None if settings is None else settings.wraps_at
        if counter < last and (wraps_at is None or last - counter < wraps_at / 2):
            # nobody knows how many are missing
            self._queue.lose()
            return f"a counter that went back from {last} to {counter}"
        passed = counter - last if wraps_at is None else (counter - last) % wraps_at
        self._queue.lose(passed - 1)
        return ""

    def _take(self, wait_s: float) -> list[ArrivedLine]:
        """Return all lines. Raise `DeviceTimeout` if none comes in time, or `LinkLost` without a line."""
        listener = self._listener
        assert listener is not None  # `_require_ready` has opened it
        lines = listener.take(BACKLOG, wait_s)
        if not lines and listener.error:
            raise LinkLost(self._name, "read", "an open port", listener.error, "check power and cable")
        if not lines:
            got, self._bad = self._bad or "silence", ""
            expected = f"a line that fits within {self._waited_s:.3g} s"
            raise DeviceTimeout(self._name, "read", expected, got, _REMEDY)
        return lines

    def _connect(self, call_time: CallTime) -> None:
        if self._listener is None:
            settings = self._settings
            self._is_ready, self._ready_s = False, self._clock.now_s() + settings.start_s
            channel = open_line(self._name, self._address, settings)
            self._listener = Listener(self._name, channel, settings.encoding, self._clock, self._ready_s)

    def _make_ready(self, call_time: CallTime) -> None:
        settings, answer = self._settings, ""
        if settings.identification is not None:
            answer = self._told(settings.identification, call_time)
        for command in settings.opening:
            self._send(command)
        if settings.errors is not None:
            self._told(settings.errors, call_time)
        self.info = identity(settings, answer)
        # lines may have been lost while the line was not open
        self._queue.lose()

    def _told(self, check: TextCheck, call_time: CallTime) -> str:
        """Ask a question, and return the answer, which comes between lines that were not asked for."""
        self._send(check.query)
        end_s = self._clock.now_s() + self._settings.reply_timeout_s
        step, other = f"send {check.query!r}", "silence"
        while True:
            wait_s = call_time.first_wait_s(self._settings.reply_timeout_s)
            lines = self._listener.take(1, wait_s) if self._listener is not None else []
            if lines and fits(check, lines[0].text):
                return lines[0].text
            other = repr(lines[0].text) if lines and other == "silence" else other
            if not lines or self._clock.now_s() > end_s:
                raise DeviceTimeout(self._name, step, described(check), other, _REMEDY)

    def _send(self, text: str) -> None:
        assert self._listener is not None  # `_require_ready` has opened it
        try:
            self._listener.send(text.encode(self._settings.encoding) + ENDS[self._settings.line_end])
        except CHANNEL_ERRORS as error:
            lost = str(error) or type(error).__name__
            raise LinkLost(self._name, f"send {text!r}", "an open port", lost, "check the cable") from error

    def _drop(self) -> None:
        listener, self._listener, self._is_ready = self._listener, None, False
        if listener is not None:
            listener.close()
