"""The news of a run as JSON objects. docs/news.md describes every key."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from drivers.interfaces import OperatorQuestion
from rig.engine.status import EngineStatus, LogEntry, Outcome
from rig.engine.timing import TimingNow
from rig.live.values import GaugeValue, LiveNow, LiveReading
from rig.news.images_now import ImageNow
from rig.protocol.step import ProtocolStep, RigReading
from rig.recorder import StepRecord

VERSION = 1
"""Version of the events, the heartbeat and the HTTP interface. New keys do not change the version."""


@dataclass(frozen=True)
class About:
    """The data about a run that stay the same during the run."""

    # identity of the run, path of the run file, title and kind of the protocol
    run_id: str
    run_file: str
    title: str
    kind: str
    simulated: bool
    cameras: tuple[str, ...]

    @property
    def mark(self) -> str:
        """The word SIMULATED for messages about a simulated run, otherwise an empty text."""
        return "SIMULATED " if self.simulated else ""


def head(about: About) -> dict[str, Any]:
    """Return the keys that every object begins with."""
    return {"v": VERSION, "run": about.run_id, "simulated": about.simulated}


def step_table(step: ProtocolStep | None) -> dict[str, Any] | None:
    """Return a step of the protocol as a JSON object."""
    if step is None:
        return None
    return {
        "index": step.index,
        "kind": step.kind,
        "target": number(step.target),
        "text": str(step),
        "acquires": step.acquisition is not None,
    }


def question_table(question: OperatorQuestion | None) -> dict[str, Any] | None:
    """Return a question of the protocol as a JSON object."""
    return None if question is None else {"text": question.text, "word": question.word}


def reading_table(reading: RigReading | None) -> dict[str, Any] | None:
    """Return a reading as a JSON object. A value that no device measures is null."""
    if reading is None:
        return None
    return {
        "time_s": reading.time_s,
        "load_n": number(reading.load_n),
        "displacement_mm": number(reading.displacement_mm),
        "angle_deg": number(reading.angle_deg),
        "moving": reading.moving,
        "channels": {name: number(each.newest) for name, each in reading.signals.items()},
        "units": {name: each.unit for name, each in reading.signals.items()},
    }


def status_table(status: EngineStatus) -> dict[str, Any]:
    """Return a status of the run as a JSON object."""
    return {
        "state": status.state.value,
        "step": step_table(status.step),
        "steps_before": status.steps_before,
        "steps_done": status.steps_done,
        "steps_planned": status.steps_planned,
        "reading": reading_table(status.reading),
        "acquisition": acquisition_table(status.acquisition),
        "load_is_measured": status.load_is_measured,
        "live": live_table(status.live),
    }


def acquisition_table(now: TimingNow | None) -> dict[str, Any] | None:
    """Return the numbers of images of an acquisition as a JSON object, None without one."""
    if now is None:
        return None
    return {
        "asked": now.asked,
        "taken": now.taken,
        "late": now.late,
        "missing": now.missing,
        "planned": now.planned,
        "asked_interval_s": number(now.interval_s),
        "reached_interval_s": number(now.reached_s),
        "waits_for": now.waits_for,
        "on_request": now.on_request,
    }


def images_table(images: Mapping[str, ImageNow]) -> dict[str, Any]:
    """Return light and focus of the newest image of each camera as a JSON object."""
    return {
        name: {
            "brightness": number(image.brightness),
            "saturated": number(image.saturated),
            "sharpness": number(image.sharpness),
        }
        for name, image in images.items()
    }


def live_table(live: LiveNow | None) -> dict[str, Any] | None:
    """Return what a person sees of a phase without interruption as a JSON object, None without one."""
    if live is None:
        return None
    return {
        "reading": _live_reading(live.reading),
        "frames_per_s": number(live.frames_per_s),
        "values_per_s": number(live.values_per_s),
        "recorded": live.recorded,
        "lost": live.lost,
        "left_out": live.left_out,
        "unit": live.unit,
        "curves": {
            # a running run appends to its curves, so take a copy first
            name: [[_short(strain), _short(force)] for strain, force in tuple(points)]
            for name, points in live.curves.items()
        },
    }


def _live_reading(reading: LiveReading | None) -> dict[str, Any] | None:
    if reading is None:
        return None
    return {
        "time_s": number(reading.time_s),
        "time_std_s": number(reading.time_std_s),
        "known_s": number(reading.known_s),
        "frames": dict(reading.frames),
        "gauges": {name: _gauge(value) for name, value in reading.gauges.items()},
    }


def _gauge(value: GaugeValue) -> dict[str, Any]:
    return {
        "strain": number(value.strain),
        "std": number(value.std),
        "valid": value.valid,
        "reason": value.reason,
        "kind": value.kind,
        "camera": value.camera,
    }


def _short(value: float) -> float | None:
    """Return a number with the digits that a plot shows."""
    return number(float(f"{value:.6g}"))


def started(about: About, steps_planned: int) -> dict[str, Any]:
    """Return the event ``started`` of a run."""
    return {
        "event": "started",
        "title": about.title,
        "kind": about.kind,
        "run_file": about.run_file,
        "cameras": list(about.cameras),
        "steps_planned": steps_planned,
    }


def state_changed(status: EngineStatus) -> dict[str, Any]:
    """Return the event ``state``, for a new state of the engine or a new step, without the curves."""
    live = None if status.live is None else replace(status.live, curves={})
    return {"event": "state", **status_table(replace(status, live=live))}


def step_finished(record: StepRecord) -> dict[str, Any]:
    """Return the event ``step``, for a step that was written into the run file."""
    return {
        "event": "step",
        "step": step_table(record.step),
        "reading": reading_table(record.reading),
        "images": {name: {"first_row": row, "count": count} for name, (row, count) in record.frames.items()},
    }


def logged(entry: LogEntry) -> dict[str, Any]:
    """Return the event ``log``, for a log entry of the engine."""
    return {"event": "log", "time_s": entry.time_s, "level": entry.level, "message": entry.message}


def ended(outcome: Outcome) -> dict[str, Any]:
    """Return the event ``ended``, which is the last event of a run."""
    return {
        "event": "ended",
        "status": outcome.status,
        "reason": outcome.reason,
        "steps_done": outcome.steps_done,
        "unsafe": list(outcome.unsafe),
        "lost_devices": list(outcome.lost_devices),
        "lost_listeners": list(outcome.lost_listeners),
    }


def number(value: float) -> float | None:
    """Return a number that JSON can express. NaN and infinite values become None."""
    return value if math.isfinite(value) else None
