"""Read back what the heartbeat file and the HTTP interface tell of a run."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any

import numpy as np

from drivers.interfaces import OperatorQuestion
from rig.engine.status import EngineStatus, State
from rig.engine.timing import TimingNow
from rig.errors import RigError
from rig.live.values import GaugeValue, LiveNow, LiveReading
from rig.news.images_now import ImageNow
from rig.news.wording import VERSION
from rig.protocol.step import ProtocolStep, RigReading
from rig.samples import SignalReading


@dataclass(frozen=True)
class ToldStep(ProtocolStep):
    """A step of which only the number, the kind, the target and a text for people are known."""

    text: str = ""

    def __str__(self) -> str:
        return self.text


@dataclass(frozen=True)
class ToldRun:
    """What a run tells of itself.

    Attributes
    ----------
    status : EngineStatus
    run_id, title, run_file : str
    utc : datetime or None
        The time of the heartbeat; None over HTTP.
    age_s : float
        The time since the run's last news, as the run itself counts it; NaN in a heartbeat file.
    running_s : float
        The time since the first reading on the rig's clock; NaN before it.
    images : mapping of str to ImageNow
        Light and focus of the newest image of each camera.
    stale_after_s : float
        If the news are older than this, the run hangs or was killed; infinite after its end.
    ended, reason : str
        How the run ended and why, as in the run file; empty while it runs.
    pid, host : int, str
        The program of the run and its computer; 0 and empty if they are unknown.
    """

    status: EngineStatus
    run_id: str = ""
    title: str = ""
    run_file: str = ""
    utc: datetime | None = None
    age_s: float = math.nan
    running_s: float = math.nan
    images: Mapping[str, ImageNow] = field(default_factory=dict)
    stale_after_s: float = math.inf
    ended: str = ""
    reason: str = ""
    pid: int = 0
    host: str = ""


def told_run(table: Any, source: str) -> ToldRun:
    """Return what a run tells as a JSON object. `source` is the name of the file or the address.

    Raise `RigError` if it is not the JSON object of a run, or one of another version. Earlier programs lack
    some keys.
    """
    version = table.get("v") if isinstance(table, dict) else None
    if version != VERSION:
        got = "another file" if version is None else f"version {version!r}"
        raise RigError(
            source, f"the news of a run, version {VERSION}", got, "name the run file, as in: rig watch run.h5"
        )
    try:
        return _told(table)
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        got = f"others ({type(error).__name__}: {error})"
        raise RigError(source, "the keys of the news of a run", got, "start the run again") from error


def _told(table: dict[str, Any]) -> ToldRun:
    outcome = table.get("outcome") or {}
    utc = table.get("utc")
    return ToldRun(
        status_of(table),
        run_id=str(table.get("run", "")),
        title=str(table.get("title", "")),
        run_file=str(table.get("run_file", "")),
        utc=None if utc is None else datetime.fromisoformat(utc),
        age_s=_number(table.get("age_s")),
        running_s=_number(table.get("running_s")),
        images={
            str(name): ImageNow(
                _number(each["brightness"]), _number(each["saturated"]), _number(each["sharpness"])
            )
            for name, each in (table.get("images") or {}).items()
        },
        stale_after_s=math.inf if table.get("stale_after_s") is None else float(table["stale_after_s"]),
        ended=str(table.get("status") or outcome.get("status") or ""),
        reason=str(table.get("reason") or outcome.get("reason") or ""),
        pid=int(table.get("pid", 0)),
        host=str(table.get("host", "")),
    )


def status_of(table: Mapping[str, Any]) -> EngineStatus:
    """Return the status of a run from the JSON object that `rig.news.wording.status_table` has made."""
    return EngineStatus(
        State(table["state"]),
        _step(table["step"], table.get("question")),
        int(table["steps_planned"]),
        int(table["steps_done"]),
        _reading(table.get("reading")),
        simulated=bool(table.get("simulated", False)),
        steps_before=int(table.get("steps_before", 0)),
        acquisition=_acquisition(table.get("acquisition")),
        load_is_measured=bool(table.get("load_is_measured", False)),
        live=_live(table.get("live")),
    )


def _step(table: Mapping[str, Any] | None, question: Mapping[str, Any] | None) -> ToldStep | None:
    if table is None:
        return None
    return ToldStep(
        int(table["index"]),
        table["kind"],
        _number(table["target"]),
        question=None if question is None else OperatorQuestion(question["text"], question["word"]),
        acquisition=True if table.get("acquires") else None,
        text=str(table["text"]),
    )


def _reading(table: Mapping[str, Any] | None) -> RigReading | None:
    if table is None:
        return None
    time_s, units = _number(table["time_s"]), table.get("units", {})
    signals = {
        name: SignalReading(np.array([_number(value)]), np.array([time_s]), unit=units.get(name, ""))
        for name, value in table.get("channels", {}).items()
    }
    load_n, displacement_mm, angle_deg = (
        _number(table[key]) for key in ("load_n", "displacement_mm", "angle_deg")
    )
    moving = bool(table["moving"])
    return RigReading(time_s, load_n, displacement_mm, angle_deg, moving, signals=signals)


def _acquisition(table: Mapping[str, Any] | None) -> TimingNow | None:
    if table is None:
        return None
    return TimingNow(
        int(table["asked"]),
        int(table["taken"]),
        int(table["late"]),
        int(table["missing"]),
        planned=None if table["planned"] is None else int(table["planned"]),
        interval_s=_number(table["asked_interval_s"]),
        reached_s=_number(table["reached_interval_s"]),
        waits_for=str(table["waits_for"]),
        on_request=bool(table["on_request"]),
    )


def _live(table: Mapping[str, Any] | None) -> LiveNow | None:
    if table is None:
        return None
    return LiveNow(
        _live_reading(table["reading"]),
        frames_per_s=_number(table["frames_per_s"]),
        values_per_s=_number(table["values_per_s"]),
        recorded=int(table["recorded"]),
        lost=int(table["lost"]),
        left_out=int(table["left_out"]),
        curves={
            str(name): [(_number(strain), _number(force)) for strain, force in points]
            for name, points in table["curves"].items()
        },
        unit=str(table["unit"]),
    )


def _live_reading(table: Mapping[str, Any] | None) -> LiveReading | None:
    if table is None:
        return None
    gauges = {
        str(name): GaugeValue(
            _number(each["strain"]),
            _number(each["std"]),
            bool(each["valid"]),
            str(each["reason"]),
            str(each["kind"]),
            str(each["camera"]),
        )
        for name, each in table["gauges"].items()
    }
    time_s, time_std_s, known_s = (_number(table[key]) for key in ("time_s", "time_std_s", "known_s"))
    return LiveReading(time_s, time_std_s, known_s, dict(table["frames"]), gauges)


def _number(value: Any) -> float:
    """Return a number; null, which stands for an unknown one, becomes NaN."""
    return math.nan if value is None else float(value)
