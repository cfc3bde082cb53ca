"""A box of channels on the clock of a test, whose faults the test sets."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from drivers.clock import Clock
from drivers.errors import DeviceTimeout
from drivers.interfaces import DeviceInfo
from drivers.signals import Samples, Signal

BOX = DeviceInfo("fakes", "box", "4", simulated=True)
LINE = DeviceInfo("fakes", "line", "5", simulated=True)
FORCE = Signal("force", "N", -1000.0, 20000.0, delay_s=0.1)


@dataclass
class FakeBox:
    """Measures when it is asked, at `rate_hz`; `force_n(t)` is the force at the time t of the clock."""

    clock: Clock
    force_n: Callable[[float], float]
    signals: tuple[Signal, ...] = (FORCE,)
    rate_hz: float = 50.0
    on_read: Callable[[int, Samples], Samples] = lambda count, samples: samples
    reads: int = 0
    due_s: float = 0.0
    pulses_s: list[float] = field(default_factory=list)
    info: DeviceInfo = BOX

    def read(self, timeout_s: float) -> Samples:
        due_s = max(self.due_s + 1.0 / self.rate_hz, self.clock.now_s())
        if due_s > self.clock.now_s() + timeout_s:
            self.clock.sleep(timeout_s)
            raise DeviceTimeout("channels.box", "read", f"a sample within {timeout_s:g} s", "none", "wait")
        self.due_s = due_s
        self.clock.sleep(self.due_s - self.clock.now_s())
        now_s = self.clock.now_s()
        # what was true a delay before
        value = self.force_n(now_s - self.signals[0].delay_s)
        self.reads += 1
        samples = Samples(np.array([[value]]), self.reads - 1, now_s, asked_s=now_s)
        return self.on_read(self.reads, samples)

    def close(self) -> None:
        pass


@dataclass
class FakeLine:
    """An output line that notes its pulses."""

    clock: Clock
    pulses_s: list[float] = field(default_factory=list)
    info: DeviceInfo = LINE

    def pulse(self) -> None:
        self.pulses_s.append(self.clock.now_s())

    def close(self) -> None:
        pass
