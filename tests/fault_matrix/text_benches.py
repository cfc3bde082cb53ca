"""Benches of the channel drivers for lines of text and for MQTT.

A value changes before each reading. Each sample must have the value that the device had at the sample's time:
on the rig's clock between question and answer, or on the device's own clock.
"""

import bisect
import time
from abc import abstractmethod
from typing import Any

from drivers.channels.mqtt.driver import SPEC as MQTT_SPEC
from drivers.channels.text.driver import open_channels
from drivers.channels.text.settings import TextChannelSettings
from drivers.clock import SystemClock
from drivers.errors import DeviceError
from drivers.interfaces import OpenContext
from simulators.instrument.meter import COUNTER_WRAPS_AT, Meter, MeterServer, SendingMeterServer
from tests.fault_matrix.bench import Bench, ReportedFault, UnprovenError, WrongAnswerError
from tests.fault_matrix.machine_benches import REPLY_TIMEOUT_S
from tests.mqtt_broker import Broker, Publisher, clocked

READ_S = 2.0
RATE_HZ = 100.0
IDENTIFIED = {"identification": {"query": "*IDN?", "pattern": "SIMULATED,.*"}}
VALUE = {"unit": "N", "range": [-1e6, 1e6]}


class ChannelBench(Bench):
    """A device with one signal, whose value is the number of the reading."""

    def __init__(self) -> None:
        super().__init__()
        self._count = 0
        self._next: int | None = None
        self.uses = {"read": self._read}
        self.ways_back = {"": lambda: None, "open": self.open}

    def prepare(self) -> None:
        """Read the signal once."""
        self._next = None
        self._read()

    def works(self) -> None:
        """Read the signal with two values."""
        self._next = None
        self._read()
        self._read()

    @abstractmethod
    def _read(self) -> None: ...

    def _require_all(self, samples: Any) -> str:
        """Return a sentence if samples are missing before these."""
        expected, self._next = self._next, samples.first + len(samples.values)
        lost = 0 if expected is None else samples.first - expected
        return f"{lost} samples lost" if lost else ""


class AskedBench(ChannelBench):
    """A meter that is asked. `tells_time` is True if its answers have a time of the meter's own clock."""

    def __init__(
        self, prefix: str, host: str | None, table: dict[str, Any], *, tells_time: bool = False
    ) -> None:
        super().__init__()
        self._tells_time = tells_time
        # Without a time, an answer of before looks like the answer to the present question.
        self._is_provable = "identification" in table or tells_time
        self.unproven = frozenset({"stale"} if self._is_provable and not tells_time else {"stale", "late"})
        self.clock = SystemClock() if tells_time else self.clock
        self._meter = Meter(self.clock, {"force": 0.0})
        self._server = MeterServer(self._meter, host=host)
        self.faults = self._server.faults
        place = self._server.address
        if prefix.startswith("visa"):
            place = place.replace(":", "::") + "::SOCKET"
        self._table = {"address": prefix + place, **table}
        self._shown_s: list[float] = []

    def opened(self, context: OpenContext) -> Any:
        """Return the driver, opened."""
        column = 2 if self._tells_time else 1
        timed = (
            {"query": "TIME?", "time": {"column": 1, "unit": "ms"}}
            if self._tells_time
            else {"query": "READ?"}
        )
        table = {"rate_hz": 1000.0, "reply_timeout_s": REPLY_TIMEOUT_S, **timed, **self._table}
        signals = {"force": {**VALUE, "column": column}}
        return open_channels(TextChannelSettings.model_validate({**table, "signals": signals}), context)

    def close(self) -> None:
        """Close the driver and the line."""
        self.shut()
        self._server.close()

    def _read(self) -> None:
        self._count += 1
        self._meter.show("force", float(self._count))
        self._shown_s.append(float(self._meter.answer("TIME?").split(",")[0]) / 1000.0)
        samples = self.driver.read(READ_S)
        value, true = samples.values[0, 0], float(self._count)
        if samples.device_s is not None:
            true = float(bisect.bisect_right(self._shown_s, samples.device_s[0] + 1e-6))
        if value != true:
            wrong = f"read {value:g}, was {true:g}"
            raise WrongAnswerError(wrong) if self._tells_time else UnprovenError(wrong)


class SendingBench(ChannelBench):
    """A device that sends samples by itself, each with the device's own time.

    An old sample is true at its time, so it is no wrong answer if it comes late.
    """

    unproven = frozenset({"late", "stale"})

    def __init__(self) -> None:
        super().__init__()
        self.clock = SystemClock()
        self._shown: list[tuple[float, float]] = [(-1.0, 0.0)]

    def works(self) -> None:
        """Wait until the device sends again, then read the signal with two values."""
        end_s = time.monotonic() + 2 * READ_S
        while True:
            try:
                super().works()
                return
            except (DeviceError, ReportedFault):
                if time.monotonic() > end_s:
                    raise

    @abstractmethod
    def show(self, value: float) -> float:
        """Set the value, and return the device's time in s at which it was set."""

    def _read(self) -> None:
        self._count += 1
        shown_s = self.show(float(self._count))
        self._shown.append((shown_s, float(self._count)))
        lost = ""
        while True:
            samples = self.driver.read(READ_S)
            lost = self._require_all(samples) or lost
            for value, device_s in zip(samples.values[:, 0], samples.device_s, strict=True):
                place = bisect.bisect_right(self._shown, (device_s + 2e-6, 1e9)) - 1
                # a sample of the same moment may have either value
                if value not in {self._shown[place][1], self._shown[max(0, place - 1)][1]}:
                    raise WrongAnswerError(f"read {value:g} at {device_s:g} s, was {self._shown[place]}")
            if samples.device_s[-1] > shown_s:
                break
        if lost:
            raise ReportedFault((lost,))


class SendingMeterBench(SendingBench):
    """A meter that sends lines with a time and a counter."""

    def __init__(self) -> None:
        super().__init__()
        self._meter = Meter(self.clock, {"force": 0.0})
        self._server = SendingMeterServer(self._meter, RATE_HZ)
        self.faults = self._server.faults

    def opened(self, context: OpenContext) -> Any:
        """Return the driver, opened."""
        settings = TextChannelSettings(
            address=self._server.address,
            stream=True,
            rate_hz=RATE_HZ,
            reply_timeout_s=REPLY_TIMEOUT_S,
            time={"column": 1, "unit": "ms"},
            counter={"column": 2, "wraps_at": COUNTER_WRAPS_AT},
            signals={"force": {**VALUE, "column": 3}},
        )
        return open_channels(settings, context)

    def show(self, value: float) -> float:
        """Set the value, and return the meter's time."""
        self._meter.show("force", value)
        return float(self._meter.answer("TIME?").split(",")[0]) / 1000.0

    def close(self) -> None:
        """Close the driver and the line."""
        self.shut()
        self._server.close()


class MqttBench(SendingBench):
    """A publisher of messages with a time, and a broker of another project. Unplugging ends the broker."""

    talks_on_opening = False

    def __init__(self) -> None:
        super().__init__()
        self._broker = Broker()
        self._begun_s, self._value = time.monotonic(), 0.0
        self._publisher = Publisher(self._broker, self._texts)
        self.faults = self._publisher.faults
        self._publisher.go_on(RATE_HZ)

    def _texts(self) -> dict[str, str]:
        return clocked("force", {"force": self._value}, self._begun_s)

    def opened(self, context: OpenContext) -> Any:
        """Return the driver, opened."""
        table = {
            "address": self._broker.address,
            "topic": "force",
            "stale_after_s": 1.0,
            "time": {"json": "ms", "unit": "ms"},
            "signals": {"force": {**VALUE, "json": "values.force"}},
        }
        return MQTT_SPEC.open(MQTT_SPEC.settings.model_validate(table), context)

    def show(self, value: float) -> float:
        """Set the value, and return the publisher's time."""
        self._value = value
        return time.monotonic() - self._begun_s

    def close(self) -> None:
        """Close the driver, the publisher and the broker."""
        self.shut()
        self._publisher.close()
        self._broker.close()
