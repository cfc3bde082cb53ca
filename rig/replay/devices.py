"""Devices that return the recorded readings and images of a run at the recorded times. Commands to these
devices have no effect."""

from collections.abc import Callable
from typing import Generic, TypeVar

from drivers.clock import Clock
from drivers.errors import DeviceError
from drivers.interfaces import (
    CameraInfo,
    DeviceInfo,
    Frame,
    InterlockState,
    LoadFrameLimits,
    LoadFrameState,
    OperatorAction,
    OperatorQuestion,
    StageState,
)
from rig.replay.script import Script

_LAG_S = 1e-9
"""Time in s by which the replay's clock stays behind the record, to allow for rounding errors."""

S = TypeVar("S", bound=StageState | LoadFrameState | InterlockState)


class RecordedReadings(Generic[S]):
    """Returns the recorded readings of one device, one after the other.

    `state` returns the reading in a row, and raises IndexError after the last row. `ended` returns the error
    which ends the replay after the last reading, or None if the run was completed.
    """

    def __init__(
        self,
        device: str,
        state: Callable[[int], S],
        clock: Clock,
        ended: Callable[[str], DeviceError | None],
    ) -> None:
        self.taken = 0
        self._device = device
        self._state = state
        self._clock = clock
        self._ended = ended

    def next(self) -> S:
        """Wait until the recorded time of the next reading, and return this reading."""
        try:
            state = self._state(self.taken)
        except IndexError:
            error = self._ended(self._device)
            if error is not None:
                raise error from None
            # Return the last reading again. After a run the engine reads the machine once more without
            # recording it.
            return self._state(self.taken - 1)
        self.taken += 1
        self._clock.sleep(state.time_s - self._clock.now_s() - _LAG_S)
        return state


class _Replayed(Generic[S]):
    """A device of an archived run. Commands have no effect."""

    def __init__(self, info: DeviceInfo, readings: RecordedReadings[S]) -> None:
        self.info = info
        self.readings = readings

    def read(self) -> S:
        """Return the next reading."""
        return self.readings.next()

    def _ignore(self, *_: object, **__: object) -> None:
        """Do nothing, because the run is over."""

    close = _ignore


class ReplayedStage(_Replayed[StageState]):
    """The stage of an archived run."""

    home = move_to = stop = _Replayed._ignore


class ReplayedLoadFrame(_Replayed[LoadFrameState]):
    """The load frame of an archived run."""

    def __init__(
        self, info: DeviceInfo, readings: RecordedReadings[LoadFrameState], limits: LoadFrameLimits
    ) -> None:
        super().__init__(info, readings)
        self.limits = limits

    go_to_load = go_to_displacement = change_speed = hold = tare = _Replayed._ignore


class ReplayedInterlock(_Replayed[InterlockState]):
    """An interlock of an archived run."""

    def __init__(self, info: DeviceInfo, unit: str, readings: RecordedReadings[InterlockState]) -> None:
        super().__init__(info, readings)
        self.unit = unit


class ReplayedCamera:
    """A camera of an archived run. If the engine refuses an image and requests another, the same image is
    returned again.
    """

    def __init__(self, name: str, info: CameraInfo, script: Script) -> None:
        self.info = info
        self.recorded = 0
        self._name = name
        self._script = script
        self._columns = script.run.columns(f"instrument/{name}")

    def grab(self, timeout_s: float) -> Frame:
        """Return the image that was recorded next."""
        del timeout_s
        if self.recorded >= len(self._columns["valid"]):
            raise DeviceError(
                f"cameras.{self._name}", "replay", "one more image", "the end of the record", _REMEDY
            )
        return self._script.frame(self._name, self.recorded, self._columns)

    def close(self) -> None:
        """Do nothing."""


class ReplayedOperator:
    """The operator of an archived run, whose actions have been done already."""

    def perform(self, action: OperatorAction) -> None:
        """Do nothing."""

    def ask(self, question: OperatorQuestion) -> None:
        """Do nothing, because the question was answered."""

    def withdraw(self) -> None:
        """Do nothing."""


_REMEDY = "the run ended here; its reason is in the run file"


def end_of_record(device: str, reason: str) -> DeviceError:
    """Return the error that ends the replay of an unfinished run at the end of its record."""
    return DeviceError(device, "replay", "one more reading", f"the end of the record ({reason})", _REMEDY)
