"""Check the measured channels and the output lines of a rig, as a part of `rig check`."""

import math
from dataclasses import asdict
from typing import Any

import numpy as np

from drivers.signals import ChannelDevice, Signal
from rig.channels.run_channels import RunChannels
from rig.commands.rig_check import RigCheck
from rig.devices import OpenedTrigger, Rig
from rig.samples import Floats, TimedSamples

CHECK_S = 2.0
"""Time in s for which a device is read."""
_LEAST_SAMPLES = 20
_LONGEST_S = 20.0
_POLL_S = 0.05
_RATE_SHARE = 0.1
"""A rate may differ by this part from the one that the device tells."""
_NOISE_TIMES = 3.0


def check_channels(found: RigCheck, rig: Rig, name: str) -> None:
    """Read a channel device for some time, and tell values, noise, rate and losses of its signals.

    Raise `DeviceError` if the device fails.
    """
    device, samples = rig.channels[name], _read(rig, name)
    where = f"channels.{name}"
    values = np.concatenate([each.values for each in samples])
    times_s = np.concatenate([each.time_s for each in samples])
    numbers = np.concatenate([each.first + np.arange(len(each.values)) for each in samples])
    lost = int((np.diff(numbers) - 1).sum())
    identity = asdict(device.info)
    found.lines.append(f"{where}: " + ", ".join(f"{key} {value}" for key, value in identity.items() if value))
    signals = {
        signal.name: _signal(found, rig, signal, values[:, k], times_s)
        for k, signal in enumerate(device.signals)
    }
    rate_hz = rate_of(times_s)
    asked = f" of {device.rate_hz:g}" if device.rate_hz else ""
    found.lines.append(f"  {rate_hz:.4g}{asked} samples per second, {lost} lost of {len(values) + lost}")
    _judge_rate(found, where, device, rate_hz, lost)
    found.devices[where] = {
        "identity": identity,
        "state": {"samples": len(values), "lost": lost, "rate_hz": device.rate_hz, "reached_hz": rate_hz},
        "signals": signals,
    }


def check_trigger(found: RigCheck, name: str, trigger: OpenedTrigger) -> None:
    """Tell what an output line is. No pulse is given, because another machine could act on it."""
    identity = asdict(trigger.device.info)
    where = f"triggers.{name}"
    shown = ", ".join(f"{key} {value}" for key, value in identity.items() if value)
    found.lines.extend([f"{where}: {shown}", f"  gives a pulse at: {trigger.at}; none was given now"])
    found.devices[where] = {"identity": identity, "state": {"at": trigger.at}}


def _read(rig: Rig, name: str) -> list[TimedSamples]:
    samples: list[TimedSamples] = []
    channels = RunChannels(
        {name: rig.channels[name]}, rig.clock, lambda _, timed: samples.append(timed), any_value=True
    )
    with rig.clock.activity():
        try:
            channels.begin()
            while not channels.are_ready:
                rig.clock.sleep(_POLL_S)
            begun_s = rig.clock.now_s()
            while not _is_enough(samples, rig.clock.now_s() - begun_s):
                channels.read()
                rig.clock.sleep(_POLL_S)
            channels.read()
        finally:
            rig.lost.update(channels.end())
    return list(samples)


def _is_enough(samples: list[TimedSamples], passed_s: float) -> bool:
    count = sum(len(each.values) for each in list(samples))
    return passed_s >= _LONGEST_S or (passed_s >= CHECK_S and count >= _LEAST_SAMPLES)


def _signal(found: RigCheck, rig: Rig, signal: Signal, values: Floats, times_s: Floats) -> dict[str, Any]:
    """Tell the newest value of a signal, its noise and its range."""
    noise = noise_of(times_s, values)
    known = "" if math.isnan(noise) else f", noise {noise:.3g} {signal.unit}"
    quantities = [f"the {quantity}" for quantity, name in rig.measured.items() if name == signal.name]
    taken = f", taken as {quantities[0]} of the load frame" if quantities else ""
    found.lines.append(
        f"  {signal.name} {values[-1]:.6g} {signal.unit}{known}, "
        f"range {signal.low:g} to {signal.high:g} {signal.unit}{taken}"
    )
    newest = float(values[-1])
    if not signal.low <= newest <= signal.high:
        got = "no valid value" if math.isnan(newest) else f"{newest:.6g} {signal.unit}"
        found.problems.append(
            f"channels.{signal.name}: it is {got}, expected {signal.low:g} to {signal.high:g} {signal.unit}; "
            "check the sensor and its cable, or widen its range"
        )
    if signal.std and noise > _NOISE_TIMES * signal.std:
        found.problems.append(
            f"channels.{signal.name}: the noise is {noise:.3g} {signal.unit}, and std = {signal.std:g} is "
            "declared; shield the cable, or correct std in the rig file"
        )
    return {
        "unit": signal.unit,
        # JSON cannot express NaN, so write None
        "newest": newest if math.isfinite(newest) else None,
        "noise": None if math.isnan(noise) else noise,
        "range": [signal.low, signal.high],
        "delay_s": signal.delay_s,
        "delay_std_s": signal.delay_std_s,
    }


def noise_of(times_s: Floats, values: Floats) -> float:
    """Return the standard deviation about a straight line; NaN for too few samples."""
    if len(values) < _LEAST_SAMPLES // 2:
        return math.nan
    if np.ptp(values) == 0.0:
        return 0.0
    at_s = times_s - times_s.mean()
    line = np.polyfit(at_s, values, 1)
    return float(np.std(values - np.polyval(line, at_s), ddof=2))


def rate_of(times_s: Floats) -> float:
    """Return the number of samples per second; NaN for less than two."""
    span_s = float(times_s[-1] - times_s[0])
    return (len(times_s) - 1) / span_s if span_s > 0.0 else math.nan


def _judge_rate(found: RigCheck, where: str, device: ChannelDevice, rate_hz: float, lost: int) -> None:
    if device.rate_hz and not abs(rate_hz / device.rate_hz - 1.0) <= _RATE_SHARE:
        found.problems.append(
            f"{where}: {rate_hz:.4g} samples per second are reached, and rate_hz = {device.rate_hz:g} is "
            "asked for; ask for less, or read fewer inputs"
        )
    if lost:
        found.problems.append(
            f"{where}: {lost} samples were lost; use a faster line, or ask for a lower rate"
        )
