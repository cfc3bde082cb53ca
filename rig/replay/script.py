"""The recorded readings and images of a run, in the order in which the engine received them."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from datetime import UTC, datetime, timedelta
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from dic.runfile import schema
from dic.runfile.reader import RunFile
from drivers.interfaces import Frame, InterlockState, LoadFrameState, StageState
from rig.errors import RigError
from rig.protocol.protocol import Protocol
from rig.recorder.records import COMPLETED, OPERATOR_DONE, STEP_ON_FILE
from rig.replay.pauses import RecordedPause, recorded_pauses

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
T = TypeVar("T")
Columns = Mapping[str, NDArray[Any]]


class ReplayError(RigError):
    """The run cannot be replayed, or there are no more recorded data."""


def of_another_version(run: RunFile, what: str, error: Exception) -> ReplayError:
    """Return the error for a text in a run file, such as its protocol, that this version cannot read."""
    return ReplayError(
        str(run.path),
        f"a run with a {what} of this version",
        " ".join(str(error).split())[:200],
        "replay it with the version of offaxis that recorded it",
    )


def require_commanded(run: RunFile, protocol: Protocol) -> None:
    """Raise `ReplayError` if the run's images were taken at times or events, and not after commanded steps.

    Such a run has no decisions of an engine that could be repeated: its times are those of real cameras, and
    its samples came on threads of their own.
    """
    measured = any(known.quantity for signals in run.channels.values() for known in signals.values())
    if protocol.takes_acquisitions or protocol.conditions.signals or measured:
        raise ReplayError(
            str(run.path),
            "a run whose steps were commanded",
            "one with images at times or events, or with measured load or channels",
            "check it with rig verify, and evaluate it with dic process, which need no replay",
        )


@dataclass(frozen=True)
class Script:
    """The recorded data of a run that a replay needs."""

    run: RunFile
    # the columns of the readings. A missing device has none.
    stage: Columns
    load_frame: Columns
    # the columns of the readings of each interlock
    interlocks: dict[str, Columns] = field(default_factory=dict)
    # the list under a camera's name has the number of readings before each of its images. The list under the
    # message of an event that ends a wait has the number of readings before each such event.
    readings_before: dict[str, list[int]] = field(default_factory=dict)
    pauses: list[RecordedPause] = field(default_factory=list)

    @classmethod
    def of(cls, run: RunFile) -> "Script":
        """Read the data of a run that a replay needs.

        Raise `ReplayError` if the run was recorded by an earlier program, which did not record the order of
        the rows.
        """
        tables = {name: run.columns(f"instrument/{name}") for name in ("stage", "load_frame")}
        cameras = {name: run.columns(f"instrument/{name}") for name in run.cameras}
        events = run.columns("events")
        interlocks: dict[str, Columns] = {name: run.columns(f"interlocks/{name}") for name in run.interlocks}
        columns = [*filter(None, tables.values()), *cameras.values(), *interlocks.values(), events]
        order = schema.ORDER.name
        if not any(tables.values()) or any(order not in found for found in columns):
            raise ReplayError(
                str(run.path),
                "a run with the order of its readings",
                "one that was recorded by an earlier version, or without any reading",
                "evaluate it with dic process; only runs of this version can be replayed",
            )
        readings = (tables["load_frame"] or tables["stage"])[order]

        def before(rows: NDArray[Any]) -> list[int]:
            return [int(count) for count in np.searchsorted(readings, rows)]

        counts = {name: before(found[order]) for name, found in cameras.items()}
        for message in (OPERATOR_DONE, STEP_ON_FILE, COMPLETED):
            chosen = events["message"] == message.encode()
            counts[message] = before(events[order][chosen])
        messages = (message.decode(errors="replace") for message in events["message"])
        pauses = recorded_pauses(zip(messages, before(events[order]), strict=True))
        return cls(run, tables["stage"], tables["load_frame"], interlocks, counts, pauses)

    @property
    def cameras(self) -> list[str]:
        """The cameras in the order of the rig file, in which they take their images."""
        firsts = {name: self.run.columns(f"instrument/{name}")["order"][:1] for name in self.run.cameras}
        return sorted(firsts, key=lambda name: firsts[name].tolist() or [np.inf])

    @property
    def starts_s(self) -> float:
        """Time in s of the first reading, on the clock of the recorded run."""
        return float(min(table["time_s"][0] for table in (self.stage, self.load_frame) if table))

    @property
    def started(self) -> datetime:
        """The date and time of the start."""
        return datetime.fromisoformat(self.run.info.start_time)

    def stage_state(self, row: int) -> StageState:
        """Return the stage's reading in a row. Raise IndexError after the last row."""
        return _of_row(StageState, self.stage, row, warnings=())

    def load_frame_state(self, row: int) -> LoadFrameState:
        """Return the load frame's reading in a row. Raise IndexError after the last row."""
        return _of_row(LoadFrameState, self.load_frame, row, faults=())

    def interlock_state(self, name: str, row: int) -> InterlockState:
        """Return an interlock's reading in a row. Raise IndexError after the last row."""
        return _of_row(InterlockState, self.interlocks[name], row)

    def frame(self, camera: str, row: int, columns: Columns) -> Frame:
        """Return an image of a camera, with the columns of its table."""
        utc = _EPOCH + timedelta(microseconds=int(columns["utc_ns"][row]) // 1000)
        return _of_row(Frame, columns, row, image=self.run.frame(camera, row), utc=utc)


def _of_row(kind: type[T], columns: Columns, row: int, **others: Any) -> T:
    """Return a reading or an image from a row of its table, whose columns are named as the attributes."""
    types: dict[str, Any] = {each.name: each.type for each in fields(cast(Any, kind))}
    known = types.keys() & columns.keys() - others.keys()
    values = {name: types[name](columns[name][row]) for name in known}
    return kind(**values, **others)
