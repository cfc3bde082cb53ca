"""A text instrument that answers questions: one sample is the answers to all questions of its table."""

import math
from functools import partial

import numpy as np

from drivers.channels.text.device import TextDevice, described, fits
from drivers.channels.text.fields import LineFields
from drivers.channels.text.opening import identity, open_line
from drivers.channels.text.settings import ENDS, PlaceSettings, TextChannelSettings
from drivers.errors import DeviceTimeout
from drivers.interfaces import OpenContext
from drivers.lines.call_time import CallTime
from drivers.lines.errand import Errand
from drivers.lines.line_port import LinePort, LineSyntax, Proof
from drivers.signals import Samples

ATTEMPTS = 3


class TextPort(LinePort):
    """The port of a text instrument."""

    silence_remedy = "check power, cable, baud rate, and query and pattern in the rig file"
    lost_remedy = "check power and cable"


class AskedText(TextDevice):
    """A text instrument that is asked for each sample, `rate_hz` times per second.

    A sample has the number of its due time. If the instrument is too slow, due times pass without a sample,
    and their numbers are missing.
    """

    def __init__(self, settings: TextChannelSettings, context: OpenContext) -> None:
        super().__init__(settings, context)
        self._port: TextPort | None = None
        self._errand: Errand[Samples] = Errand(f"ask {self._name}")
        # the due times are a fixed grid, as for other devices that are asked
        self._begun_s = math.nan
        self._next = 0
        self._trouble = ""
        self._fields = {query: self._line_fields(names) for query, names in settings.queries.items()}
        names = [name for names in settings.queries.values() for name in names]
        self._order = [names.index(name) for name in settings.signals]
        self._open()

    def _read(self, call_time: CallTime) -> Samples:
        wait_s = call_time.left_s
        if math.isnan(self._begun_s):
            self._begun_s = self._clock.now_s()
        self._wait_until(
            self._begun_s + self._next / self.rate_hz, call_time, f"a rate of {self.rate_hz:g} Hz"
        )
        while True:
            if not self._errand.is_running:
                self._require_ready(call_time)
            try:
                samples = self._errand.result(self._ask, call_time.left_s)
                break
            except TimeoutError:
                expected, got = f"an answer within {wait_s:.3g} s", self._trouble or "silence"
                raise DeviceTimeout(self._name, "read", expected, got, TextPort.silence_remedy) from None
            except DeviceTimeout as silence:
                self._trouble = silence.got
                if call_time.left_s == 0.0 or not call_time.patient:
                    raise
        self._trouble = ""
        return samples

    def _ask(self) -> Samples:
        """Ask for one sample, on the thread of the errand, because an answer may take longer than a call."""
        asked_s = self._clock.now_s()
        number = max(self._next, math.floor((asked_s - self._begun_s) * self.rate_hz + 1e-6))
        numbers: list[float] = []
        for query, fields in self._fields.items():
            numbers += self._opened.ask(query, partial(self._numbers, fields), ATTEMPTS)
        # an answer with a time of its own may be older than the question, and still be true at this time
        earliest_s, device_s = asked_s, None
        if self._time is not None:
            earliest_s = -math.inf
            device_s = np.array([self._time.seconds(numbers.pop(0), self._clock.now_s())])
            if self._time.restart:
                raise self._restarted(self._time.restart)
        self._next = number + 1
        values = self._settings.in_units(np.array([[numbers[place] for place in self._order]]))
        return Samples(values, number, self._clock.now_s(), earliest_s, device_s)

    def _numbers(self, fields: LineFields, line: str) -> list[float]:
        """Return the numbers of an answer. Raise `ValueError` if it is the answer to an earlier question."""
        numbers = fields.read(line)
        if self._time is not None:
            if math.isnan(numbers[0]):
                raise ValueError(f"{line!r} without the device's time")
            if self._time.is_repeated(numbers[0]):
                raise ValueError(f"{line!r} with the device's time of the answer before")
        return numbers

    def _line_fields(self, names: list[str]) -> LineFields:
        places: list[PlaceSettings] = [] if self._settings.time is None else [self._settings.time]
        return LineFields(self._settings, [*places, *(self._settings.signals[name] for name in names)])

    @property
    def _opened(self) -> TextPort:
        assert self._port is not None  # `_require_ready` has opened it
        return self._port

    def _connect(self, call_time: CallTime) -> None:
        if self._port is None:
            settings = self._settings
            check, proof = settings.identification, None
            if check is not None:
                proof = Proof(check.query, partial(fits, check), described(check))
            syntax = LineSyntax(ENDS[settings.line_end], proof, settings.encoding, self._is_ignored)
            channel = open_line(self._name, self._address, settings)
            self._port = TextPort(self._name, channel, settings.reply_timeout_s, syntax)
            self._is_ready, self._ready_s = False, self._clock.now_s() + settings.start_s

    def _make_ready(self, call_time: CallTime) -> None:
        settings, port, answer = self._settings, self._opened, ""
        port.call_time = call_time
        if settings.identification is not None:
            answer = port.ask(settings.identification.query, str, ATTEMPTS)
            self._require(settings.identification, answer, "identify", "check which instrument this is")
        for command in settings.opening:
            port.send(command)
        port.settle()
        if settings.errors is not None:
            told = port.ask(settings.errors.query, str, ATTEMPTS)
            self._require(settings.errors, told, "check the opening commands", "correct `opening`")
        self.info = identity(settings, answer)
        # an answer to a question for a sample may take longer than the call that waits for it
        port.call_time = CallTime(patience_s=self._patience_s)

    def close(self) -> None:
        """Release the line. A repeated call has no effect."""
        super().close()
        self._errand.close(2.0 * self._settings.reply_timeout_s)

    def _drop(self) -> None:
        port, self._port, self._is_ready = self._port, None, False
        if port is not None:
            port.close()
