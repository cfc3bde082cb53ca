"""Base class of all rotation stages: the checks before a motion, and the stop."""

import math
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Generic, Self, TypeVar

from drivers.errors import DeviceFault, DeviceTimeout, LinkLost
from drivers.interfaces import DeviceInfo, OpenContext, StageState
from drivers.lines.addresses import resolve_address
from drivers.lines.call_time import CallTime, one_call
from drivers.lines.channel import Channel, open_device
from drivers.lines.stop_deadline import StopDeadline, StopTimes, calling_for_the_emergency_stop
from drivers.stages.own_motion import OwnMotion
from drivers.stages.port import StagePort
from drivers.stages.settings import StageSettings

P = TypeVar("P", bound=StagePort)


class GuardedStage(ABC, Generic[P]):
    """A `RotationStage` with limit checks and a stop. A subclass adds the messages of its device.

    ``open_port(name, channel, reply_timeout_s)`` returns a port on an open channel. The function is called
    again for a stop after the link was lost. `name` is the device's name and port, used in error messages.
    Raise `LinkLost` if the port cannot be opened.
    """

    info: DeviceInfo

    def __init__(
        self,
        open_port: Callable[[str, Channel, float], P],
        baud: int,
        settings: StageSettings,
        context: OpenContext,
        stop_times: StopTimes,
    ) -> None:
        self._url = resolve_address(settings.port, context)
        self._name = f"{context.name} ({self._url})"
        self._fault = partial(DeviceFault, self._name)
        self._open_port = open_port
        self._baud = baud
        self._relay = context.relay
        self._reply_timeout_s = settings.reply_timeout_s
        self._stop_times = stop_times
        self._call_time = CallTime(context.call_timeout_s, patience_s=context.patience_s)
        self._port = self._opened_port(self._reply_timeout_s)
        self._port.call_time = self._call_time
        self._closed = False
        self._limits_deg = (settings.angle_min_deg, settings.angle_max_deg)
        self._clock = context.clock
        self._own_motion = OwnMotion()
        self._stops = 0
        self._stop_lock = threading.Lock()
        self._new_link_lock = threading.Lock()

    @abstractmethod
    def set_up(self) -> None:
        """Identify the device, write limits and speed and read them back. No motion is started."""

    @abstractmethod
    def read(self) -> StageState:
        """Return position and status. Raise `DeviceFault` if the device reports that a motion failed."""

    @abstractmethod
    def _begin_move(self, angle_deg: float, state: StageState, step: str, permit: Callable[[], None]) -> None:
        """Call `permit`, then send a motion command once. If `permit` raises an exception, send nothing.

        `state` is the latest state of the stage.
        """

    @abstractmethod
    def _try_to_stop(self, port: P) -> str:
        """Send the stop command once. Return an empty text if the stage stands still, otherwise what it does.

        Raise `DeviceTimeout` if the state of the stage is unknown.
        """

    @abstractmethod
    def _stranger(self, port: P) -> str:
        """Return an empty text if the same device as at `set_up` answers, otherwise the other device's name.

        Raise `DeviceTimeout` if no device answers.
        """

    @one_call
    def move_to(self, angle_deg: float) -> None:
        """Start a move to an absolute angle.

        Raise `DeviceFault` if the angle is outside the limits, or if the stage is moving, has no reference,
        has a fault or refuses the command, and `DeviceTimeout` if the stage does not start to move. The
        driver never sends a motion command twice, but reads from the stage whether it moves.
        """
        step = f"move to {angle_deg:g}°"
        permit = self._unless_stopped(step)
        self._require_within(angle_deg, step)
        state = self._ready(step)
        with self._commanding():
            self._begin_move(angle_deg, state, step, permit)

    def stop(self) -> None:
        """Send the stop command at once, and repeat the command until the device reports standstill.

        Requests of other threads do not delay the stop. A motion command that is not yet sent is cancelled.
        If the link is lost, the port is opened again, for the stop only, until the deadline of the stop.

        Raise `DeviceTimeout` if the device does not report standstill before the deadline of the stop, and
        `LinkLost` if the stage was closed, or no new link could be used before the deadline of the stop.
        """
        with self._stop_lock:
            self._stops += 1
            self._break_off_search()
        with calling_for_the_emergency_stop(self._name):
            try:
                self._stop_on(self._port, lambda: "", self._stop_deadline())
            except LinkLost:
                if self._closed:
                    raise
                self._stop_on_new_links()

    def _opened_port(self, timeout_s: float) -> P:
        channel = open_device(self._name, self._url, self._baud, timeout_s, self._relay)
        return self._open_port(self._name, channel, timeout_s)

    def _stop_on_new_links(self) -> None:
        """Stop the stage over a new link after the link was lost. All other requests still fail.

        A new link can be lost too. For example, the relay of a guardian that was killed may still accept a
        connection, which then breaks.
        """
        with self._new_link_lock:
            self._port.close()
            deadline = self._stop_deadline()
            while True:
                try:
                    self._stop_on_new_link(deadline)
                    return
                except LinkLost:
                    if deadline.passed:
                        raise
                self._clock.sleep(self._stop_times.poll_s)

    def _stop_on_new_link(self, deadline: StopDeadline) -> None:
        port = self._opened_port(min(self._reply_timeout_s, self._stop_times.answer_s))
        try:
            self._stop_on(port, lambda: self._stranger(port), deadline)
        finally:
            port.close()

    def _stop_deadline(self) -> StopDeadline:
        return StopDeadline(self._clock, self._stop_times.deadline_s)

    def _stop_on(self, port: P, stranger: Callable[[], str], deadline: StopDeadline) -> None:
        got = "silence"
        while not deadline.passed:
            try:
                if not (got := self._try_to_stop(port) or stranger()):
                    return
            except DeviceTimeout as silence:
                got = silence.got
            self._clock.sleep(self._stop_times.poll_s)
        raise DeviceTimeout(self._name, "stop", "standstill", got, "press the emergency stop")

    def close(self) -> None:
        """Release the port without stopping the stage. A repeated call has no effect."""
        self._closed = True
        self._port.close()

    def opened(self) -> Self:
        """Set up the stage, whose port is open, and return it. Close the port if this fails."""
        try:
            with self._call_time.opening(self._reply_timeout_s):
                self.set_up()
        except BaseException:
            self.close()
            raise
        return self

    @contextmanager
    def _commanding(self) -> Iterator[None]:
        """Mark the time in which a motion command is sent. Readings in this time are not judged."""
        self._own_motion.begin()
        try:
            yield
        finally:
            self._own_motion.sent()

    def _judged(self, state: StageState) -> StageState:
        """Return `state`. Raise `DeviceFault` if it shows that another program moved the stage.

        The fault remains until `home` is called.
        """
        foreign = self._own_motion.see(state.angle_deg, moving=state.moving, referenced=state.homed)
        if foreign:
            remedy = "stop the stage, end the other program, then home the stage"
            raise self._fault("read position", "only the motions of this program", foreign, remedy)
        return state

    @abstractmethod
    def _break_off_search(self) -> None:
        """Record that a stop will interrupt a home search. The caller holds the lock and stops afterwards."""

    def _unless_stopped(self, step: str) -> Callable[[], None]:
        """Return a function `permit`, which raises `DeviceFault` if a stop was requested after this call."""
        stops = self._stops

        def permit() -> None:
            if self._stops != stops:
                raise self._fault(step, "no stop meanwhile", "a stop", "command the motion again if needed")

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
