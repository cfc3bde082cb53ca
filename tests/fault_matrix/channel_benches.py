"""Benches of channel devices and of outputs that give pulses.

The inputs change before each reading, so that an old value is noticed. A reading that tells a lost sample, a
value beyond its range or no value is a good reading that reports a fault.
"""

import math
from abc import abstractmethod
from collections.abc import Callable
from typing import Any

import numpy as np

from drivers.channels.modbus import ModbusChannelsSettings, open_channels
from drivers.channels.nidaqmx.channels import open_channels as open_daq
from drivers.channels.nidaqmx.settings import NidaqmxSettings
from drivers.errors import DeviceError
from drivers.interfaces import OpenContext
from drivers.triggers.modbus import ModbusPulseSettings, open_pulse
from simulators.closed_machine.modbus import AnalogueBoxRtuServer
from simulators.wire.faults import DAQ, FaultPanel
from tests.drivers.box import WatchedBox
from tests.drivers.channels.nidaqmx.fake_nidaqmx import FakeDaq
from tests.fault_matrix.bench import Bench, ReportedFault, UnprovenError, WrongAnswerError
from tests.fault_matrix.machine_benches import REPLY_TIMEOUT_S

RATE_HZ = 100.0
READ_S = 1.0
WIDTH_S = 0.05
VOLTS = {"unit": "V", "range": [-10.0, 10.0]}


class _ChannelBench(Bench):
    """A device with one input, whose voltage changes before each reading."""

    def __init__(self) -> None:
        super().__init__()
        self._count = 0
        self._due: int | None = None
        self.uses = {"sample": self._read}
        self.ways_back = {"": lambda: None, "open": self.open}

    def open(self) -> None:
        """Open the driver again, whose samples then begin at 0."""
        self._due = None
        super().open()

    def prepare(self) -> None:
        """Read once."""
        self._read()

    def works(self) -> None:
        """Read twice."""
        self._read()
        self._read()

    def _read(self) -> None:
        self._count += 1
        true = self._count % 64 / 8.0
        self.show(true)
        due, self._due = self._due, None
        samples = self.driver.read(READ_S)
        self._due = samples.first + len(samples.values)
        value = float(samples.values[-1, 0])
        signal = self.driver.signals[0]
        if math.isnan(value):
            raise ReportedFault(("no value",))
        if not signal.low <= value <= signal.high:
            raise ReportedFault((f"{value:g} V, beyond the range",))
        if value != true:
            wrong = f"read {value:g}, is {true:g}"
            raise UnprovenError(wrong) if self.unproven else WrongAnswerError(wrong)
        if due is not None and samples.first != due:
            raise ReportedFault((f"{samples.first - due} samples lost",))

    @abstractmethod
    def show(self, volts: float) -> None:
        """Set the voltage at the input."""


class ModbusChannelsBench(_ChannelBench):
    """The driver `modbus-channels` at a box, on the line that `serve` makes."""

    def __init__(self, serve: Callable[..., Any], *, numbered: bool = True) -> None:
        super().__init__()
        if not numbered:
            self.unproven = frozenset({"late", "stale"})
        self._box = WatchedBox(self.clock)
        self._server = serve(self._box)
        self.faults = self._server.faults

    def opened(self, context: OpenContext) -> Any:
        """Return the driver, opened."""
        force = VOLTS | {"input": 0, "type": "f32", "invalid": [-9999]}
        table = {"address": self._server.address, "rate_hz": RATE_HZ, "signals": {"force": force}}
        return open_channels(_on_line(ModbusChannelsSettings, table), context)

    def show(self, volts: float) -> None:
        """Set the voltage at the input."""
        self._box.hand.inputs["force"] = volts

    def close(self) -> None:
        """Close the driver and the line."""
        self.shut()
        self._server.close()


class _FaultyDaq(FakeDaq):
    """An imitated device whose samples are lost or late while a fault is on."""

    def __init__(self, clock: Any, faults: FaultPanel) -> None:
        super().__init__(clock)
        self.faults = faults
        faults.when("unplug", lambda: setattr(self, "plugged", False), lambda: setattr(self, "plugged", True))
        faults.when("stall", lambda: setattr(self, "clocked", False), lambda: setattr(self, "clocked", True))

    def require_plugged(self) -> None:
        """Let a busy computer lose samples, or wait, before a request of the library."""
        super().require_plugged()
        if self.open_tasks and self.tasks[-1].channels:
            if self.faults.take("drop") is not None:
                self.clock.sleep(12.0)
            if (seconds := self.faults.take("delay")) is not None:
                self.clock.sleep(float(seconds))


class DaqBench(_ChannelBench):
    """The driver `nidaqmx-channels` on an imitated library."""

    talks_on_opening = False

    def __init__(self) -> None:
        super().__init__()
        self.faults = FaultPanel(DAQ)
        self._daq = _FaultyDaq(self.clock, self.faults)
        self._daq.volts["ai0"] = 0.0

    def opened(self, context: OpenContext) -> Any:
        """Return the driver, opened."""
        signals = {"force": VOLTS | {"input": "ai0"}}
        settings = NidaqmxSettings.model_validate({"device": "Dev1", "rate_hz": 1000.0, "signals": signals})
        return open_daq(settings, context, self._daq)

    def show(self, volts: float) -> None:
        """Set the voltage at the input."""
        self._daq.volts["ai0"] = float(np.float64(volts))

    def left_behind(self) -> dict[str, int]:
        """Return the number of tasks that the imitated library still holds."""
        return {"tasks": self._daq.open_tasks}


class ModbusPulseBench(Bench):
    """The driver `modbus-pulse` at a box, on the line that `serve` makes."""

    def __init__(self, serve: Callable[..., Any], **settings: Any) -> None:
        super().__init__()
        if serve is AnalogueBoxRtuServer:
            # its requests may be repeated, so an answer to the same request of the same call is as good
            self.unproven = frozenset({"late", "stale"})
        self._settings = {"output": 3} | settings
        self._box = WatchedBox(self.clock)
        self._server = serve(self._box)
        self.faults = self._server.faults
        self._asked = 0
        self.uses = {"pulse": self._pulse}
        self.ways_back = {"": lambda: None, "open": self.open}

    def opened(self, context: OpenContext) -> Any:
        """Return the driver, opened."""
        table = {"address": self._server.address, "width_s": WIDTH_S} | self._settings
        return open_pulse(_on_line(ModbusPulseSettings, table), context)

    def prepare(self) -> None:
        """Give one pulse."""
        self._pulse()

    def works(self) -> None:
        """Give two pulses, each of which must end."""
        for _ in range(2):
            self._pulse()
            if self._box.edges[-1][2]:
                raise WrongAnswerError("the pulse did not end")

    def executed_twice(self) -> list[str]:
        """Return a pulse if more have begun than were asked for."""
        return ["pulse"] if self._begun > self._asked else []

    def shut(self) -> None:
        """Close the driver. With a fault on the line, it may not be able to put its output at rest."""
        driver, self.driver = self.driver, None
        if driver is None:
            return
        try:
            driver.close()
        except DeviceError:
            assert self.faults.active, "closing failed without a fault"

    def close(self) -> None:
        """Close the driver and the line."""
        self.shut()
        self._server.close()

    @property
    def _begun(self) -> int:
        return sum(on for _, _, on in self._box.edges)

    def _pulse(self) -> None:
        begun = self._begun
        self._asked += 1
        try:
            self.driver.pulse()
        finally:
            # Simulated time stands still until the thread that ends the pulse has done so.
            self.clock.sleep(10 * WIDTH_S)
        if self._begun != begun + 1:
            raise WrongAnswerError(f"{self._begun - begun} pulses")


def _on_line(model: Any, table: dict[str, Any]) -> Any:
    # a pseudo-terminal carries no parity bits
    parity = {"parity": "N"} if table["address"].startswith("/") else {}
    return model.model_validate({"reply_timeout_s": REPLY_TIMEOUT_S} | table | parity)
