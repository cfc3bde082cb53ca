"""Check a measured channel: read it for a second, and compare its values with their ranges."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from drivers.clock import Clock, SystemClock
from drivers.errors import DeviceTimeout
from drivers.signals import ChannelDevice, Samples

READ_S = 0.25
CHECK_S = 1.0
FIRST_S = 5.0
"""Longest wait in s for a first sample, unless a device may be silent for longer."""


def sampled(
    device: ChannelDevice, clock: Clock, read: Callable[[Callable[[], Samples]], Samples]
) -> tuple[list[Samples], float]:
    """Return the samples of a second, at least one, and the time in s in which they came.

    ``read(function)`` calls a function of the driver with a deadline. Raise `DeviceTimeout` if no sample
    comes.
    """
    found: list[Samples] = []
    begun_s, patience_s = clock.now_s(), max(FIRST_S, getattr(device, "silence_s", FIRST_S))
    # Simulated time may stand still while a device does not answer.
    ends = [(each, each.now_s() + patience_s) for each in (clock, SystemClock())]
    while not found or clock.now_s() < begun_s + CHECK_S:
        try:
            found.append(read(lambda: device.read(READ_S)))
        except DeviceTimeout:
            if any(each.now_s() > end_s for each, end_s in ends):
                if not found:
                    raise
                break
    return found, clock.now_s() - begun_s


def report(
    name: str, device: ChannelDevice, found: list[Samples], time_s: float
) -> tuple[Any, str, list[str]]:
    """Return the state of a device for JSON, a line to print, and one sentence for each problem."""
    values = np.concatenate([samples.values for samples in found])
    state, texts, problems = {}, [], []
    for signal, column in zip(device.signals, values.T, strict=True):
        newest = float(column[-1])
        # JSON cannot express NaN, so write None
        state[signal.name] = newest if math.isfinite(newest) else None
        texts.append(f"{signal.name} {newest:.6g} {signal.unit}")
        if not signal.low <= newest <= signal.high:
            got = "no valid value" if math.isnan(newest) else f"{newest:.6g} {signal.unit}"
            problems.append(
                f"{name}: {signal.name} is {got}, expected {signal.low:g} to {signal.high:g} {signal.unit}; "
                "check the sensor and its cable, or widen its range"
            )
    lost = found[-1].first + len(found[-1].values) - found[0].first - len(values)
    line = f"  {', '.join(texts)}; {len(values)} samples in {time_s:.1f} s, {lost} lost"
    return {"values": state, "samples": len(values), "time_s": time_s, "lost": lost}, line, problems
