"""The clock of a testing machine, compared with the clock of the images."""

from dataclasses import dataclass, replace

import numpy as np

from dic.records.machine import MachineRecord
from dic.typing import Float

ASSUMED, GIVEN, FOUND = "assumed", "given", "found"
"""Where an offset or a rate comes from: nobody gave it, the user did, or strain and load show it."""
ASSUMED_INTERVALS, ASSUMED_RATE_STD = 1.0 / np.sqrt(3.0), 0.01 / np.sqrt(3.0)
"""Standard deviations of an offset, in intervals between two images, and of a rate that nobody gave: all
errors up to one interval, and up to 1 %, are equally probable.
"""
SMOOTHED_INTERVALS = 0.25
"""The load is averaged over this part of an interval where its change with time is needed."""


@dataclass(frozen=True)
class MachineClock:
    """The machine's clock, compared with the images' clock.

    Attributes
    ----------
    offset_s, offset_std_s : float
        Machine's time minus image's time at the first image, and its standard deviation; infinity if it is to
        be found.
    rate, rate_std : float
        Seconds of the machine's clock in one second of the images' clock, and its standard deviation.
    correlation : float
        Correlation of the errors of offset and rate.
    offset_from, rate_from : str
        "assumed", "given" or "found".
    """

    offset_s: float
    offset_std_s: float
    rate: float
    rate_std: float
    correlation: float = 0.0
    offset_from: str = ASSUMED
    rate_from: str = ASSUMED

    def at(self, times_s: Float, first_s: float) -> Float:
        """Return the machine's times at `times_s` of the images; `first_s` is the first image's time."""
        return np.asarray(first_s + self.offset_s + self.rate * (times_s - first_s))

    def sampled(self, sample_s: float) -> "MachineClock":
        """Return the clock of a record whose readings may be half a sample, `sample_s`, earlier or later."""
        half_s = 0.5 * sample_s if np.isfinite(sample_s) else 0.0
        std_s = float(np.hypot(self.offset_std_s, half_s))
        share = self.offset_std_s / std_s if std_s > 0.0 else 0.0
        return replace(self, offset_std_s=std_s, correlation=share * self.correlation)


def usual_interval_s(times_s: Float) -> float:
    """Return the usual time between two images, or two samples; infinity for a single one."""
    return float(np.median(np.diff(times_s))) if len(times_s) > 1 else np.inf


def smoothed(values: Float, time_s: Float, width_s: float) -> Float:
    """Return values at the times `time_s`, averaged over `width_s`."""
    sample_s = usual_interval_s(time_s)
    half = int(min(0.5 * width_s / sample_s, (len(time_s) - 1) // 2)) if sample_s > 0.0 else 0
    padded = np.pad(values, half, mode="reflect", reflect_type="odd")
    return np.convolve(padded, np.full(2 * half + 1, 1.0 / (2 * half + 1)), "valid")


def clock_errors_n(record: MachineRecord, time_s: Float, image_times_s: Float, clock: MachineClock) -> Float:
    """Return the change of each image's load, N, if offset or rate is larger by one standard deviation.

    Shape (images, 2). `time_s`: the times of the record.
    """
    load = smoothed(record.load_n, time_s, SMOOTHED_INTERVALS * usual_interval_s(image_times_s))
    passed = image_times_s - image_times_s[0]
    at = clock.at(image_times_s, image_times_s[0])
    late = np.column_stack([np.full(len(at), clock.offset_std_s), clock.rate_std * passed])
    ahead, behind = (np.interp(at[:, None] + sign * late, time_s, load) for sign in (1.0, -1.0))
    return np.asarray(0.5 * (ahead - behind))
