"""The state of a run, a snapshot of a run, and the outcome of a run."""

from dataclasses import dataclass
from enum import Enum

from dic.runfile.schema import RunStatus
from rig.protocol.step import ProtocolStep, Reading


class State(Enum):
    """The states of the engine; the transitions are drawn in `Engine`."""

    IDLE = "idle"
    PREPARING = "preparing"
    MOVING = "moving"
    IMAGING = "imaging"
    SAFING = "making safe"
    COMPLETED = "completed"
    ABORTED = "aborted"
    FAILED = "failed"

    @property
    def ending(self) -> bool:
        """Whether the run is ending or has ended."""
        return self in (State.SAFING, State.COMPLETED, State.ABORTED, State.FAILED)


@dataclass(frozen=True)
class Status:
    """A snapshot of a run."""

    state: State
    step: ProtocolStep | None
    steps_planned: int
    steps_done: int
    reading: Reading | None


@dataclass(frozen=True)
class Outcome:
    """How a run ended.

    Attributes
    ----------
    status, reason : str
        As in the run file.
    steps_done : int
    unsafe : tuple of str
        The devices whose safe state was not confirmed, each with the cause.
    lost_listeners : tuple of str
        The listeners that raised, each with what it raised. The run went on without them.
    """

    status: RunStatus
    reason: str
    steps_done: int
    unsafe: tuple[str, ...] = ()
    lost_listeners: tuple[str, ...] = ()
