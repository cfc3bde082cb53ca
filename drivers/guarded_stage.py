"""What every rotation stage of ours sees to before the stage moves, and how it is stopped."""

import math
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable

from drivers.clock import Clock
from drivers.errors import DeviceFault, DeviceTimeout
from drivers.interfaces import StageState
from drivers.patience import Patience, calling_for_the_emergency_stop
from drivers.stage_settings import StageSettings

STOP_PATIENCE_S = 5.0
STOP_ANSWER_S = 1.0
"""A stop is repeated after so long, however patient the rig file is with other answers."""
STOP_POLL_S = 0.02


class GuardedStage(ABC):
    """Limits, permission and stop of a `RotationStage`; a driver adds how its device is asked and told.

    Parameters
    ----------
    name : str
        The device's name and port, for messages.
    settings : StageSettings
    clock : Clock
    """

    def __init__(self, name: str, settings: StageSettings, clock: Clock) -> None:
        self._name = name
        self._limits_deg = (settings.angle_min_deg, settings.angle_max_deg)
        self._clock = clock
        self._stops = 0
        self._stop_lock = threading.Lock()

    @abstractmethod
    def read(self) -> StageState:
        """Ask for position and status; `DeviceFault` if the device reports that motion failed."""

    @abstractmethod
    def _begin_move(self, angle_deg: float, state: StageState, step: str, permit: Callable[[], None]) -> None:
        """Send the motion once, if `permit` lets it; `state` was read just before."""

    @abstractmethod
    def _try_to_stop(self) -> str:
        """Command a stop once, and return what was seen instead of standstill; empty if it stands.

        `DeviceTimeout` if nothing is known.
        """

    def move_to(self, angle_deg: float) -> None:
        """Begin to move to an absolute angle.

        Raises
        ------
        DeviceFault
            If the angle is out of limits, or the stage moves, has no reference, has a fault or refuses.
        DeviceTimeout
            If the stage did not take the command. It is never sent twice: the stage is asked what it does.
        """
        step = f"move to {angle_deg:g}°"
        permit = self._unless_stopped(step)
        self._require_within(angle_deg, step)
        state = self._ready(step)
        self._begin_move(angle_deg, state, step, permit)

    def move_by(self, angle_deg: float) -> None:
        """Begin to move by an angle from where the stage stands; raises what `move_to` raises.

        It is sent as an absolute angle: a relative command that is lost, or arrives twice, would leave the
        stage somewhere else.
        """
        step = f"move by {angle_deg:g}°"
        permit = self._unless_stopped(step)
        state = self._ready(step)
        target_deg = state.angle_deg + angle_deg
        self._require_within(target_deg, step)
        self._begin_move(target_deg, state, step, permit)

    def stop(self) -> None:
        """Stop now; repeated until the device says that the stage stands still.

        Other threads' requests do not delay it, and a motion command that was not yet sent is kept back.

        Raises
        ------
        DeviceTimeout
            If that is not confirmed within 5 s.
        LinkLost
            If the port is gone.
        """
        with self._stop_lock:
            self._stops += 1
            self._break_off_search()
        patience = Patience(self._clock, STOP_PATIENCE_S)
        got = "silence"
        while not patience.exhausted:
            try:
                with calling_for_the_emergency_stop(self._name):
                    if not (got := self._try_to_stop()):
                        return
            except DeviceTimeout as silence:
                got = silence.got
            self._clock.sleep(STOP_POLL_S)
        raise DeviceTimeout(
            self._name, "stop", expected="standstill", got=got, remedy="press the emergency stop"
        )

    @abstractmethod
    def _break_off_search(self) -> None:
        """A home search under way will find nothing; called with the stop's lock, before the stop is sent."""

    def _unless_stopped(self, step: str) -> Callable[[], None]:
        """Return what raises if a stop was called for since now."""
        stops = self._stops

        def permit() -> None:
            if self._stops != stops:
                raise self._fault(
                    step, "no stop meanwhile", "a stop", "command the motion again if it is wanted"
                )

        return permit

    def _require_within(self, angle_deg: float, step: str) -> None:
        low, high = self._limits_deg
        if not (math.isfinite(angle_deg) and low <= angle_deg <= high):
            raise self._fault(
                step, f"an angle from {low:g}° to {high:g}°", f"{angle_deg:g}°", "correct the protocol"
            )

    def _ready(self, step: str) -> StageState:
        state = self.read()
        self._require_standing(state.moving, step)
        if not state.homed:
            raise self._fault(step, "a referenced stage", "no reference position", "home the stage first")
        return state

    def _require_standing(self, moving: bool, step: str) -> None:
        if moving:
            raise self._fault(step, "a standing stage", "a stage in motion", "wait for its end, or stop it")

    def _require_speed(self, speed_deg_s: float, greatest_deg_s: float) -> None:
        if not 0 < speed_deg_s <= greatest_deg_s:
            expected = f"a speed above 0 up to {greatest_deg_s:g}°/s"
            raise self._fault("set speed", expected, f"{speed_deg_s:g}°/s", "correct the rig file")

    def _fault(self, step: str, expected: str, got: str, remedy: str) -> DeviceFault:
        return DeviceFault(self._name, step, expected=expected, got=got, remedy=remedy)
