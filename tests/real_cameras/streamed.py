"""Runs with the streams of real cameras, beside a machine or moving it: rates, and frames that were lost."""

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

PULL = """
kind = "phases"
title = "the streams of real cameras while the machine moves"

[sample]
name = "sheet"
thickness_mm = 1.0
width_mm = 25.0
gauge_length_mm = 60.0

[[phases]]
do = "pull"
displacement_mm = 0.6
elastic_n = 4000.0
images = {images}
[[phases.stages]]
speed_mm_s = 0.05
until.displacement_mm = 0.2
[[phases.stages]]
speed_mm_s = 0.1

[start]
tare_max_n = 20.0

[settle]
load_tolerance_n = 20.0
displacement_tolerance_mm = 0.002
dwell_s = 0.2
timeout_s = 30.0
poll_s = 0.05

[limits]
load_max_n = 14000.0
displacement_max_mm = 5.0
break_load_drop = 0.5

[images]
per_step = 1
still = 0
timeout_s = 10.0
"""
"""A test without a stop at two speeds, of 8 s."""

MACHINE = {
    "rig": {"name": "tensile rig with real cameras"},
    "simulation": {
        "driver": "virtual-rig",
        "specimen": {"grip_slip_mm": 0.02, "machine_stiffness_n_mm": 60_000.0},
    },
    "load_frame": {
        "driver": "modbus-frame",
        "address": "@load_frame",
        "load_max_n": 15_000.0,
        "displacement_max_mm": 6.0,
        "watchdog_s": 20.0,
    },
    "operator": {"driver": "simulated-operator", "duration_s": 0.2},
}
"""A rig without cameras, for `simulators.rig.simulation.Simulation`."""

PATIENT = """
[guardian]
patience_s = 5.0
"""
"""An emulated processor may keep the run waiting; it is not the guardian that is tested here."""

EARLY, SPREAD = 0.9, 0.95
"""A frame before the others by this part of a frame has a wrong number or time, and so has a tenth of them
that are this far apart."""


@dataclass
class Streamed:
    """What a run has recorded from streams.

    Attributes
    ----------
    outcome : Any
        See `rig.engine.status.Outcome`.
    cameras : dict
        For each camera the datasets ``sequence``, ``middle_s`` and ``data`` of the streamed images.
    steps : dict
        For these images the datasets ``load`` and ``displacement`` of the steps, if there is a load frame.
    live : dict
        The columns of the live gauges by name, empty without them.
    messages : list of str
        The events of the run.
    """

    outcome: Any
    cameras: dict[str, dict[str, np.ndarray]]
    steps: dict[str, np.ndarray]
    live: dict[str, np.ndarray]
    messages: list[str]

    @property
    def timing(self) -> Any:
        """See `rig.engine.timing.Timing`."""
        return self.outcome.timing

    def report(self, what: str) -> str:
        """Return one line with rate and losses."""
        timing = self.timing
        losses = [text for text in self.messages if "frames of its stream" in text]
        return (
            f"{what}: {timing.taken} of {timing.asked} images of each camera, "
            f"{1.0 / timing.reached_s:.2f} per second, {timing.late} late, {timing.missing} missing; "
            f"{'; '.join(losses) or 'no frame of a stream is lost'}"
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


def assert_travels(streamed: Streamed) -> None:
    """Check that the machine went through both stages of `PULL` while the images were taken."""
    travel_mm = streamed.steps["displacement_mm"]
    # an image has the reading before it, and readings have noise
    assert (np.diff(travel_mm) > -0.005).all()
    assert travel_mm[0] < 0.2
    assert travel_mm[-1] > 0.4


def acquire(folder: Path, rig_file: str, every_s: float, duration_s: float, tolerance_s: float) -> Streamed:
    """Record images of all cameras of a rig file from their streams."""
    protocol = PROTOCOL.format(every_s=every_s, duration_s=duration_s, tolerance_s=tolerance_s)
    return _run(folder, rig_file, protocol)


def pull(folder: Path, rig_file: str, images: str, live: str = "") -> Streamed:
    """Record images of all cameras of a rig file from their streams, while the machine of `MACHINE` pulls.

    `images` is the value of the key of the phase, `live` is text after the protocol.
    """
    return _run(folder, rig_file + PATIENT, PULL.format(images=images) + live)


def _run(folder: Path, rig_text: str, protocol_text: str) -> Streamed:
    protocol, rig, path = folder / "protocol.toml", folder / "rig.toml", folder / "run.h5"
    rig.write_text(rig_text)
    protocol.write_text(protocol_text, encoding="utf-8")
    outcome = run_protocol(protocol, rig, path)
    assert (outcome.status, outcome.unsafe) == ("completed", ()), outcome.reason
    with h5py.File(path) as file:
        messages = [text.decode() for text in file["entry/events/message"][:]]
        steps = file["entry/steps"]
        acquired = ~np.isnan(steps["due_s"][()])
        state = {key: steps[key][()][acquired] for key in ("load_n", "displacement_mm") if key in steps}
        cameras = {
            name: {
                key: group[key][()][acquired[group["step"][()]]] for key in ("sequence", "middle_s", "data")
            }
            for name, group in file["entry/instrument"].items()
            if "data" in group
        }
        gauges = file.get("entry/channels/live_gauges", {})
        live = {name.removeprefix("value_"): column[()] for name, column in gauges.items() if column.shape}
    return Streamed(outcome, cameras, state, live, messages)
