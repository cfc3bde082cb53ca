"""The tables of an `acquire` protocol: when images are due, what begins the test, and what ends it."""

import math
from typing import Literal, Self

import numpy as np
from pydantic import Field, model_validator

from drivers.settings import Settings
from rig.measured_load import PREFIX
from rig.protocol.dues import AskedDues, Dues, EdgeDues, IncrementDues, TimedDues
from rig.protocol.step import RigReading
from rig.samples import GAUGE_PREFIX

MOST_IMAGES = 1_000_000
_SECONDS_MAX = 30 * 24 * 3600.0


class OfSignal(Settings):
    """A table that names a signal of the rig."""

    channel: str = Field(
        pattern=r"^(channels\.\w+|load_frame\.(load|displacement)|gauge\..+)$",
        description="signal of the rig, such as channels.force, load_frame.load, or gauge.NAME (live gauge)",
    )

    @property
    def signal(self) -> str:
        """The signal's name in a reading: for a channel the one in the rig file."""
        return self.channel.removeprefix(PREFIX)

    @property
    def is_of_channel(self) -> bool:
        """True if a measured channel of the rig file has this signal."""
        return self.channel.startswith(PREFIX)

    @property
    def gauge(self) -> str:
        """The name of the live gauge that has this signal, or an empty text."""
        return self.channel.removeprefix(GAUGE_PREFIX) if self.channel.startswith(GAUGE_PREFIX) else ""

    def new(self, reading: RigReading) -> list[float]:
        """Return the new values of the signal in a reading."""
        found = reading.signals.get(self.signal)
        return found.values.tolist() if found is not None and found.is_new else []


class Level(OfSignal):
    """A level that a signal rises above or falls below."""

    above: float | None = None
    below: float | None = None

    @model_validator(mode="after")
    def _one(self) -> Self:
        if (self.above is None) == (self.below is None):
            raise ValueError("exactly one of above and below is expected")
        return self

    def is_beyond(self, value: float) -> bool:
        """Return True if a value is beyond the level."""
        if self.above is not None:
            return value > self.above
        return self.below is not None and value < self.below

    def is_met(self, reading: RigReading) -> bool:
        """Return True if a new sample is beyond the level."""
        return any(self.is_beyond(value) for value in self.new(reading))

    def __str__(self) -> str:
        return (
            f"{self.channel} {'below' if self.above is None else 'above'} {self.above or self.below or 0:g}"
        )


class ByIncrement(OfSignal):
    """An image at each increment of a signal."""

    by: float = Field(gt=0.0, description="change of the signal between two images, in its unit")


class Drop(OfSignal):
    """A drop of a signal by a fraction of its highest value, such as the load at a break."""

    fraction: float = Field(gt=0.0, lt=1.0)
    least: float = Field(gt=0.0, description="the drop counts only after the signal has reached this value")


class Logarithmic(Settings):
    """Times that become longer, for relaxation and creep."""

    first_s: float = Field(gt=0.0, description="time of the second image; the first one is at 0")
    per_decade: int = Field(ge=1, le=1000, description="number of images in which the time grows tenfold")


class Schedule(Settings):
    """The table `[acquire]`: when images are due. Exactly one of the first seven keys is given."""

    every_s: float | None = Field(default=None, ge=0.001, le=_SECONDS_MAX, description="time between images")
    times_s: list[float] | None = Field(default=None, min_length=1, max_length=100_000)
    logarithmic: Logarithmic | None = None
    increment: ByIncrement | None = None
    trigger: Level | None = Field(default=None, description="an image at each rise above, or fall below")
    on_request: Literal[True] | None = Field(default=None, description="an image when the operator asks")
    every_frame: Literal[True] | None = Field(
        default=None, description="every frame of the camera, such as one at each trigger of its input line"
    )
    begin: Level | None = Field(default=None, description="wait for this before the first image")
    keep_s: float | None = Field(
        default=None,
        ge=1.0,
        le=_SECONDS_MAX,
        description="only the images of the last seconds stay in the file",
    )
    tolerance_s: float | None = Field(
        default=None, gt=0.0, le=3600.0, description="an image that is later makes the run end with status 1"
    )

    @model_validator(mode="after")
    def _one(self) -> Self:
        names = ("every_s", "times_s", "logarithmic", "increment", "trigger", "on_request", "every_frame")
        given = [name for name in names if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(
                f"exactly one of {', '.join(names)} is expected, got {', '.join(given) or 'none'}"
            )
        times_s = self.times_s or []
        if times_s != sorted(set(times_s)) or min(times_s, default=0.0) < 0.0:
            raise ValueError("times_s must rise from 0 or later")
        return self

    @property
    def signals(self) -> list[str]:
        """The measured channels that the table names."""
        return [table.signal for table in self._of_signals if table.is_of_channel]

    @property
    def gauges(self) -> list[str]:
        """The live gauges that the table names."""
        return [table.gauge for table in self._of_signals if table.gauge]

    @property
    def _of_signals(self) -> list[OfSignal]:
        tables = (self.increment, self.trigger, self.begin)
        return [table for table in tables if table is not None]

    @property
    def text(self) -> str:
        """When images are due, in words."""
        if self.every_s is not None:
            return f"every {self.every_s:g} s"
        if self.times_s is not None:
            return f"at {len(self.times_s)} times from {self.times_s[0]:g} s to {self.times_s[-1]:g} s"
        if self.logarithmic is not None:
            log = self.logarithmic
            return f"at times that grow tenfold in {log.per_decade} images, from {log.first_s:g} s"
        if self.increment is not None:
            return f"at each change of {self.increment.channel} by {self.increment.by:g}"
        if self.every_frame:
            return "at every frame of the camera"
        return "whenever the operator asks" if self.trigger is None else f"each time {self.trigger} begins"

    @property
    def lateness_max_s(self) -> float:
        """The longest accepted time between the due time of an image and the middle of its exposure."""
        if self.tolerance_s is not None:
            return self.tolerance_s
        return 0.5 if self.every_s is None else min(0.5, 0.5 * self.every_s)

    def times(self, duration_s: float, images: int) -> list[float] | None:
        """Return the times of all images in s, up to a duration and a number; None if they are not known."""
        if self.every_s is not None:
            count = (
                min(images, math.floor(duration_s / self.every_s + 1e-9) + 1)
                if duration_s < math.inf
                else images
            )
            return None if count >= MOST_IMAGES else [number * self.every_s for number in range(count)]
        if self.logarithmic is not None:
            log = self.logarithmic
            decades = math.log10(min(duration_s, _SECONDS_MAX) / log.first_s)
            count = max(0, math.floor(decades * log.per_decade + 1e-9) + 1)
            later = (log.first_s * 10.0 ** (np.arange(count) / log.per_decade)).tolist()
            return [0.0, *later][:images]
        if self.times_s is not None:
            return [time_s for time_s in self.times_s if time_s <= duration_s][:images]
        return None

    def dues(self, duration_s: float, images: int) -> Dues:
        """Return what tells the times of the images during a run."""
        if self.increment is not None:
            return IncrementDues(self.increment.signal, self.increment.by)
        if self.trigger is not None:
            rising = self.trigger.above is not None
            level = self.trigger.above if self.trigger.above is not None else self.trigger.below
            assert level is not None
            return EdgeDues(self.trigger.signal, level, rising=rising)
        if self.on_request:
            return AskedDues()
        if self.every_frame:
            return Dues()
        times_s = self.times(duration_s, images)
        if times_s is None:
            assert self.every_s is not None
            return TimedDues.every(self.every_s)
        return TimedDues(times_s)


class End(Settings):
    """The table `[end]`: what ends the images. The operator can always end them."""

    duration_s: float | None = Field(default=None, gt=0.0, le=_SECONDS_MAX)
    images: int | None = Field(default=None, ge=1, le=MOST_IMAGES)
    reaches: Level | None = Field(default=None, description="end as soon as a signal is beyond a level")
    drop: Drop | None = None
    on_request: Literal[True] | None = Field(default=None, description="end only when the operator asks")

    @model_validator(mode="after")
    def _at_least_one(self) -> Self:
        if all(getattr(self, name) is None for name in type(self).model_fields):
            raise ValueError(f"at least one of {', '.join(type(self).model_fields)} is expected")
        return self

    @property
    def signals(self) -> list[str]:
        """The measured channels that the table names."""
        return [table.signal for table in (self.reaches, self.drop) if table and table.is_of_channel]

    @property
    def gauges(self) -> list[str]:
        """The live gauges that the table names."""
        return [table.gauge for table in (self.reaches, self.drop) if table and table.gauge]

    @property
    def text(self) -> str:
        """What ends the images, in words."""
        drop = self.drop
        ends = [
            "" if self.duration_s is None else f"{self.duration_s:g} s are over",
            "" if self.images is None else f"{self.images} images were asked for",
            "" if self.reaches is None else f"{self.reaches} is reached",
            "" if drop is None else f"{drop.channel} falls by {drop.fraction:.0%}",
            "the operator ends them",
        ]
        return " or ".join(filter(None, ends))


class FirstBeyond:
    """Looks in every reading for the first sample beyond a level; `time_s` is its time, NaN before it."""

    def __init__(self, level: Level) -> None:
        self._level = level
        self.time_s = math.nan

    def see(self, reading: RigReading) -> None:
        """Search the new samples of the signal."""
        found = reading.signals.get(self._level.signal)
        if found is None or not found.is_new or not math.isnan(self.time_s):
            return
        for time_s, value in zip(found.time_s.tolist(), found.values.tolist(), strict=True):
            if self._level.is_beyond(value):
                self.time_s = time_s
                return


class EndOfSignals:
    """Looks in every reading for the events of a channel that end the images.

    `met` is what has happened, or an empty text.
    """

    def __init__(self, end: End) -> None:
        self.met = ""
        self._end = end
        self._highest = -math.inf

    def see(self, reading: RigReading) -> None:
        """Look at the new samples of a reading."""
        if (reaches := self._end.reaches) is not None and reaches.is_met(reading):
            self.met = self.met or f"{reaches} was reached"
        if (drop := self._end.drop) is not None:
            for value in drop.new(reading):
                self._highest = max(self._highest, value)
                if self._highest >= drop.least and value < (1.0 - drop.fraction) * self._highest:
                    self.met = self.met or f"{drop.channel} fell from {self._highest:.6g} to {value:.6g}"
