"""A meter with several inputs, and its servers on a pseudo-terminal or TCP, asked or sending by itself.

Sources: SCPI 1999.0 (Volume 1, 6 and 7.2.1; Volume 2, 21.8) and IEEE 488.2 for the commands of a meter. The
lines of the sending meter are those of a typical sketch for a load cell on an Arduino. No code is shared with
drivers.
"""

import threading
from collections.abc import Mapping, Sequence

from drivers.clock import Clock, SystemClock
from simulators.wire.faults import INSTRUMENT, FaultPanel
from simulators.wire.ports import LineServer, port_of

IDENTITY = "SIMULATED,Two-channel meter,S-0007,1.0"
NO_ERROR = '0,"No error"'
UNDEFINED = '-113,"Undefined header"'
NO_VALUE = "9.91E37"
"""The number of SCPI that means "not a number"."""
ERRORS_MAX = 20
COUNTER_WRAPS_AT = 2**16


class Meter:
    """The state of a meter. Any thread may use it.

    Parameters
    ----------
    clock : Clock
        The clock that the meter's own time comes from.
    values : mapping of str to float
        The value of each input, in the order of the meter's lines.

    Attributes
    ----------
    commands : list of str
        All commands that the meter has received, without the questions.
    skipped : int
        The number of samples that a sending meter still leaves out.
    """

    def __init__(self, clock: Clock, values: Mapping[str, float]) -> None:
        self._clock = clock
        self._start_s = clock.now_s()
        self._values = dict(values)
        self._lock = threading.Lock()
        self._errors: list[str] = []
        self._is_broken = False
        self._counter = 0
        self.commands: list[str] = []
        self.skipped = 0

    def show(self, name: str, value: float) -> None:
        """Set the value of an input."""
        with self._lock:
            self._values[name] = value

    def break_sensor(self, broken: bool = True) -> None:
        """Let all inputs have no value, or a value again."""
        with self._lock:
            self._is_broken = broken

    def restart(self) -> None:
        """Switch the meter off and on: its time and its counter begin at 0."""
        with self._lock:
            self._start_s, self._counter = self._clock.now_s(), 0

    def answer(self, message: str) -> str:
        """Execute one message and return the answer, which is empty for a command."""
        with self._lock:
            if not message.endswith("?"):
                self.commands.append(message)
                self._execute(message)
                return ""
            if message == "*IDN?":
                return IDENTITY
            if message == "SYST:ERR?":
                return self._errors.pop(0) if self._errors else NO_ERROR
            if message == "READ?":
                return ",".join(self._texts())
            if message == "TIME?":
                return ",".join([self._millis(), *self._texts()])
            name = message.removesuffix("?").lower()
            if name in self._values:
                # as an indicator shows it
                return f"{name}= {self._text(self._values[name])} unit"
            self._note(UNDEFINED)
            return ""

    def line(self) -> str:
        """Return the next line of a sending meter: milliseconds, counter, values; or no line if skipped."""
        with self._lock:
            self._counter = (self._counter + 1) % COUNTER_WRAPS_AT
            if self.skipped:
                self.skipped -= 1
                return ""
            return ",".join([self._millis(), str(self._counter), *self._texts()])

    def _execute(self, message: str) -> None:
        if message == "*CLS":
            self._errors.clear()
        elif not message.startswith(("CONF:", "*RST", "SYST:")):
            self._note(UNDEFINED)

    def _note(self, error: str) -> None:
        if len(self._errors) < ERRORS_MAX:
            self._errors.append(error)

    def _millis(self) -> str:
        return f"{1000 * (self._clock.now_s() - self._start_s):.3f}"

    def _texts(self) -> Sequence[str]:
        return [self._text(value) for value in self._values.values()]

    def _text(self, value: float) -> str:
        return NO_VALUE if self._is_broken else f"{value:+.6E}"


class _MeterLine(LineServer):
    line_max = 256

    def __init__(
        self, meter: Meter, *, host: str | None = None, port: int = 0, faults: FaultPanel | None = None
    ) -> None:
        super().__init__()
        self.meter = meter
        self.faults = faults or FaultPanel(INSTRUMENT)
        self._port = port_of(self, host, port)

    def damaged(self, reply: bytes) -> bytes:
        """Return the answer with a damaged first character, which is then no ASCII character."""
        return bytes([reply[0] | 0x80]) + reply[1:]

    def readdressed(self, reply: bytes) -> bytes:
        """Return the answer unchanged, because lines of text have no address."""
        return reply


class MeterServer(_MeterLine):
    """A meter that answers questions, on a pseudo-terminal or, with `host`, on a TCP port."""

    def answer(self, line: bytes) -> bytes:
        """Execute one message and return the answer."""
        answer = self.meter.answer(line.decode("ascii", "replace"))
        return f"{answer}\r\n".encode("ascii") if answer else b""


class SendingMeterServer(_MeterLine):
    """A meter that sends `rate_hz` lines per second of real time by itself, and also answers questions."""

    def __init__(
        self,
        meter: Meter,
        rate_hz: float,
        *,
        host: str | None = None,
        port: int = 0,
        faults: FaultPanel | None = None,
    ) -> None:
        super().__init__(meter, host=host, port=port, faults=faults)
        self._closing = threading.Event()
        self._sending = threading.Thread(target=self._send, args=(1.0 / rate_hz,), daemon=True)
        self._sending.start()

    def answer(self, line: bytes) -> bytes:
        """Execute one message, or return the next line for the message of the meter's own clock."""
        text = self.meter.line() if line == _NEXT.strip() else self.meter.answer(line.decode("ascii"))
        return f"{text}\r\n".encode("ascii") if text else b""

    def close(self) -> None:
        """Close the port and end its threads; a repeated call does nothing."""
        self._closing.set()
        self._sending.join()
        super().close()

    def _send(self, period_s: float) -> None:
        clock = SystemClock()
        due_s = clock.now_s() + period_s
        while not self._closing.wait(max(0.0, due_s - clock.now_s())):
            due_s += period_s
            self._port.tick(_NEXT)


_NEXT = b"\x05\n"
"""The message with which the meter's own clock asks for the next line (ASCII: enquiry)."""
