"""The settings of a closed machine: its program, its voltage outputs and its trigger output."""

import math
from typing import Self

from pydantic import Field, model_validator

from drivers.settings import Settings


class ProgramStep(Settings):
    """One step of the machine's program: a motion to a position, or a wait."""

    to_mm: float | None = Field(default=None, ge=-100, le=100, description="position of the crosshead")
    speed_mm_s: float | None = Field(default=None, gt=0, le=100)
    wait_s: float | None = Field(
        default=None, gt=0, le=1e6, description="time for which the crosshead stands"
    )

    @model_validator(mode="after")
    def _one_of_two(self) -> Self:
        motion = (self.to_mm is not None, self.speed_mm_s is not None)
        if any(motion) == (self.wait_s is not None) or any(motion) != all(motion):
            raise ValueError("either to_mm and speed_mm_s, or wait_s is expected")
        return self


class OutputSettings(Settings):
    """A voltage output of the machine: 10 V at `full_scale`.

    The voltage is late by `delay_s` on average. For each period of `jitter_period_s` the machine draws
    another delay, from a uniform distribution of the width `jitter_s` around `delay_s`.
    """

    full_scale: float = Field(gt=0, description="value at 10 V")
    delay_s: float = Field(default=0.0, ge=0, le=10)
    jitter_s: float = Field(default=0.0, ge=0, le=10)
    jitter_period_s: float = Field(default=0.01, ge=0.001, le=10)
    noise_v: float = Field(default=0.0, ge=0, le=5, description="standard deviation of the white noise")
    hum_v: float = Field(default=0.0, ge=0, le=5, description="amplitude of the mains hum")
    hum_hz: float = Field(default=50.0, gt=0, le=400)
    drift_v_h: float = Field(default=0.0, ge=-10, le=10, description="drift per hour")
    offset_v: float = Field(default=0.0, ge=-10, le=10)
    end_v: float = Field(
        default=10.5, gt=0, le=20, description="voltage at which the amplifier is at its end"
    )

    @model_validator(mode="after")
    def _causal(self) -> Self:
        if self.jitter_s > 2.0 * self.delay_s:
            raise ValueError(
                "jitter_s may be at most twice delay_s, because no voltage comes before what it shows"
            )
        return self

    @property
    def delay_std_s(self) -> float:
        """Standard deviation of the delay."""
        return self.jitter_s / math.sqrt(12.0)


class ClosedMachineSettings(Settings):
    """A machine that pulls the specimen by its own program, and takes no command from this computer."""

    start_s: float = Field(default=30.0, ge=0, le=1e6, description="from switching on to the program's start")
    program: list[ProgramStep] = Field(
        default_factory=lambda: [ProgramStep(to_mm=3.0, speed_mm_s=0.02)], min_length=1, max_length=1000
    )
    force: OutputSettings = OutputSettings(full_scale=50_000.0)
    crosshead: OutputSettings = OutputSettings(full_scale=100.0)
    extensometer: OutputSettings = OutputSettings(full_scale=0.1)
    trigger_every_s: float = Field(default=1.0, gt=0, le=1e6, description="time between two trigger pulses")
    trigger_width_s: float = Field(default=0.05, gt=0, le=1e6)

    @model_validator(mode="after")
    def _pulses(self) -> Self:
        if self.trigger_width_s >= self.trigger_every_s:
            raise ValueError("trigger_width_s must be shorter than trigger_every_s, or the pulses merge")
        return self
