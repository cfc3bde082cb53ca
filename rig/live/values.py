"""What live gauges tell the rest of the rig, and the interface of what measures them."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import Frame

CAUSES = (
    "", "not_measured", "repeated", "saturated", "outside", "low_correlation", "points_lost", "jump",
    "no_value", "no_motion", "declined", "cameras_disagree", "old", "no_frame", "faint",
)  # fmt: skip
"""Names of the reasons why a value is not valid. The run file has their places in the list: it only grows."""


@dataclass(frozen=True)
class GaugeValue:
    """The strain of one gauge in the frames of one moment.

    Attributes
    ----------
    strain, std : float
        Engineering strain and its standard deviation; NaN without a value.
    valid : bool
        True if the value may be used for limits and control.
    reason : str
        Why it may not, for people; empty for a valid value.
    kind : str
        "raw", "calibrated" or "corrected".
    camera : str
        The camera whose value this is.
    cause : str
        The name of the reason, one of `CAUSES`, for programs; empty for a valid value.
    """

    strain: float
    std: float
    valid: bool
    reason: str
    kind: str
    camera: str
    cause: str = ""


@dataclass(frozen=True)
class LiveReading:
    """The values of all gauges in the frames of one moment.

    Attributes
    ----------
    time_s, time_std_s : float
        The middle of the exposures on the rig's clock, and its standard deviation.
    known_s : float
        The time on the rig's clock at which the values were known.
    frames : mapping of str to int
        The number (`Frame.sequence`) of the frame of each camera.
    gauges : mapping of str to GaugeValue
        By the name of the gauge.
    missing : mapping of str to str
        Why a camera has no frame of this moment, by its name. The others are measured without it.
    """

    time_s: float
    time_std_s: float
    known_s: float
    frames: Mapping[str, int]
    gauges: Mapping[str, GaugeValue]
    missing: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class LiveNow:
    """What a person sees of a test while it runs.

    Attributes
    ----------
    reading : LiveReading or None
        The newest one.
    frames_per_s, values_per_s : float
        Frames of each camera recorded per second, and readings of the gauges per second, in the last seconds.
    recorded, lost, left_out : int
        Frames that were recorded, frames that cameras or computer have lost, and recorded frames that were
        not measured, because the measurement was busy.
    curves : mapping of str to list of (float, float)
        For each gauge the points of its curve so far, strain and stress in MPa, or load in N without a cross
        section; at most some hundred, so that older ones are thinned out.
    unit : str
        "MPa" or "N".
    """

    reading: LiveReading | None = None
    frames_per_s: float = math.nan
    values_per_s: float = math.nan
    recorded: int = 0
    lost: int = 0
    left_out: int = 0
    curves: Mapping[str, list[tuple[float, float]]] = field(default_factory=dict)
    unit: str = "MPa"


class LiveMeasurement(Protocol):
    """Measures the live gauges of one run, in another process or, in simulated time, at once.

    Any thread may call `offer`; the other methods are called by one thread.
    """

    @property
    def failed(self) -> str:
        """Why nothing is measured any more; empty while the measurement works."""

    @property
    def left_out(self) -> int:
        """Number of frames that were not measured, because a newer one had come."""

    def prepare(
        self, grids: Mapping[str, NDArray[np.generic]], references: Mapping[str, NDArray[np.generic]]
    ) -> None:
        """Calibrate with an image of the grid, and prepare with a reference image, of each camera.

        Without an image of the grid the strains of a camera are raw, or calibrated by the earlier run that
        the declaration names. This takes seconds. Raise `DeviceError` if an image cannot be used.
        """

    def offer(self, camera: str, frame: Frame) -> None:
        """Give a frame that has arrived. It is copied; the call never waits for the measurement."""

    def take(self) -> list[LiveReading]:
        """Return the readings since the last call, the oldest first, without waiting."""

    def close(self) -> None:
        """End the measurement within a second. A repeated call has no effect."""
