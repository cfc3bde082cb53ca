"""A run with an acquisition from the streams of real cameras: its rate, and the frames that were lost."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from rig.run import run_protocol

PROTOCOL = """
kind = "acquire"
title = "the streams of real cameras"
grid_images = "never"
reference = false

[acquire]
every_s = {every_s}
tolerance_s = {tolerance_s}

[end]
duration_s = {duration_s}

[images]
timeout_s = 10.0
"""

EARLY, SPREAD = 0.9, 0.95
"""A frame before the others by this part of a frame has a wrong number or time, and so has a tenth of them
that are this far apart."""


@dataclass
class Streamed:
    """What an acquisition has recorded.

    Attributes
    ----------
    timing : Any
        See `rig.engine.timing.Timing`.
    cameras : dict
        For each camera the datasets ``sequence``, ``middle_s`` and ``data``.
    losses : list of str
        What the run file says about lost frames.
    """

    timing: Any
    cameras: dict[str, dict[str, np.ndarray]]
    losses: list[str]

    def report(self, source: str) -> str:
        """Return one line with rate and losses."""
        timing = self.timing
        return (
            f"acquisition from {source}: {timing.taken} of {timing.asked} images of each camera, "
            f"{1.0 / timing.reached_s:.2f} per second, {timing.late} late, {timing.missing} missing; "
            f"{'; '.join(self.losses) or 'no frame of a stream is lost'}"
        )


def assert_counter_keeps_time(sequence: np.ndarray, time_s: np.ndarray, rate_hz: float) -> None:
    """Check that the kernel's counter and the kernel's clock agree, on a computer of any speed.

    The kernel's camera counts a frame by the time at which it is drawn, rounded to whole frames. If the
    processor has no time for it, a stamp is late by less than half a frame, or is early by less than half a
    frame after the next number. A process that is interrupted between the two makes it late by any time.
    """
    assert (np.diff(sequence) >= 1).all()
    assert (np.diff(time_s) > 0.0).all()
    after = (time_s - time_s[0]) * rate_hz - (sequence - sequence[0]).astype(float)
    soon, late = np.quantile(after, [0.1, 0.9])
    assert after.min() >= soon - EARLY
    assert late - soon <= SPREAD


def acquire(folder: Path, rig_file: str, every_s: float, duration_s: float, tolerance_s: float) -> Streamed:
    """Record images of all cameras of a rig file from their streams."""
    protocol, rig, run = folder / "protocol.toml", folder / "rig.toml", folder / "run.h5"
    rig.write_text(rig_file)
    protocol.write_text(
        PROTOCOL.format(every_s=every_s, duration_s=duration_s, tolerance_s=tolerance_s), encoding="utf-8"
    )
    outcome = run_protocol(protocol, rig, run)
    assert (outcome.status, outcome.unsafe) == ("completed", ()), outcome.reason
    with h5py.File(run) as file:
        messages = [text.decode() for text in file["entry/events/message"][:]]
        cameras = {
            name: {key: group[key][()] for key in ("sequence", "middle_s", "data")}
            for name, group in file["entry/instrument"].items()
            if "data" in group
        }
    return Streamed(outcome.timing, cameras, [text for text in messages if "frames of its stream" in text])
