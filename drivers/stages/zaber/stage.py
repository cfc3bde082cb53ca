"""Rotation stage in the Zaber ASCII protocol."""

from collections.abc import Callable

from drivers.errors import DeviceTimeout
from drivers.interfaces import DeviceInfo, OpenContext, StageState
from drivers.lines.stop_deadline import STOP_TIMES, StopTimes
from drivers.registry import DriverSpec
from drivers.stages.guarded import GuardedStage, set_up
from drivers.stages.zaber.find import FINDER
from drivers.stages.zaber.port import ZaberPort
from drivers.stages.zaber.protocol import (
    FLAGS,
    NOT_REFERENCED,
    REJECTIONS,
    SPEED_UNIT,
    UNKNOWN_COMMAND,
    Reply,
    is_fault,
)
from drivers.stages.zaber.settings import ZaberSettings

READ_ATTEMPTS = 2
INTERRUPTED = "NI"


class ZaberStage(GuardedStage[ZaberPort]):
    """A `RotationStage` on a Zaber ASCII line; construct it with `open_stage`."""

    def __init__(self, settings: ZaberSettings, context: OpenContext, stop_times: StopTimes) -> None:
        super().__init__(ZaberPort, settings, context, stop_times)
        self._settings = settings
        # After a fault the stage may still report a valid reference; only a completed home search is trusted.
        self._doubted = self._seeking = False

    def set_up(self) -> None:
        """Identify the stage, write limits and speed; nothing moves."""
        self.info = DeviceInfo(
            vendor="Zaber",
            model=f"device {self._get('deviceid', axis=0)}",
            serial=self._get("system.serial", axis=0),
            firmware=self._get("version", axis=0),
            simulated=self._settings.port.startswith("@"),
        )
        self._configure()

    def read(self) -> StageState:
        """Ask for position and status.

        Raises
        ------
        DeviceFault
            If a flag reports failed motion; the fault stays until `home` acknowledges it.
        """
        seeking = self._seeking
        reply = self._query("get pos", "read position")
        flags = self._flags(reply)
        faults = [flag for flag in flags if is_fault(flag)]
        with self._stop_lock:
            if faults:
                self._seeking, self._doubted = False, True
            elif seeking and self._seeking and not reply.busy:
                self._seeking, self._doubted = False, INTERRUPTED in flags
        if faults:
            got = ", ".join(f"{FLAGS.get(flag, 'a fault')} ({flag})" for flag in faults)
            raise self._fault("read position", "no fault", got, "remove the cause, then home the stage")
        return StageState(
            angle_deg=self._integer(reply) / self._settings.microsteps_per_deg,
            moving=reply.busy,
            homed=not (self._doubted or NOT_REFERENCED.intersection(flags)),
            warnings=flags,
            time_s=self._clock.now_s(),
        )

    def home(self) -> None:
        """Acknowledge past faults and begin to find the reference position."""
        permit = self._unless_stopped("home")
        self._require_standing(self._query("", "home").busy, "home")
        self._seeking, self._doubted = False, True
        flags = self._flags(self._query("warnings clear", "home"))
        if any(is_fault(flag) for flag in flags):
            self._query("driver enable", "home")
        had_none = bool(NOT_REFERENCED.intersection(flags))
        self._begin(
            "home", "home", permit, lambda seen: had_none and not NOT_REFERENCED.intersection(seen.warnings)
        )
        with self._stop_lock:
            permit()
            self._seeking = True

    def _begin_move(self, angle_deg: float, state: StageState, step: str, permit: Callable[[], None]) -> None:
        if state.warnings:
            # so that a later flag NI belongs to this motion, not to the previous motion
            self._query("warnings clear", step)
        target = self._microsteps(angle_deg)
        self._begin(
            f"move abs {target}", step, permit, lambda seen: self._microsteps(seen.angle_deg) == target
        )

    def _try_to_stop(self, port: ZaberPort) -> str:
        settings = self._settings
        reply = port.ask(settings.address, settings.axis, "stop", at_most_s=self._stop_times.answer_s)
        if reply.address != settings.address:
            return _foreign(reply)
        if not reply.accepted:
            return _reason(reply)
        return "a stage in motion" if reply.busy else ""

    def _stranger(self, port: ZaberPort) -> str:
        reply = port.ask(self._settings.address, 0, "get system.serial", at_most_s=self._stop_times.answer_s)
        return "" if reply.data == self.info.serial else f"a device with serial number {reply.data}"

    def _break_off_search(self) -> None:
        self._seeking = False

    def _configure(self) -> None:
        """Check the scale, write limits and speed to the stage and read them back."""
        self._check_scale(self._settings.microsteps_per_deg)
        low, high = (self._microsteps(angle_deg) for angle_deg in self._limits_deg)
        limits = [("limit.max", high), ("limit.min", low)]
        # the minimum never exceeds the maximum in this order: a stage may refuse such limits
        if high <= self._integer(self._query("get limit.min", "read limit.min"), "read limit.min"):
            limits.reverse()
        for name, value in limits:
            self._set(name, value)
        speed_microsteps_s = self._settings.speed_deg_s * self._settings.microsteps_per_deg
        self._set("maxspeed", round(speed_microsteps_s * SPEED_UNIT))

    def _check_scale(self, scale: float) -> None:
        """Compare the scale with the microsteps per turn that the stage reports, if any."""
        step = "read limit.cycle.dist"
        # older firmware and stages without full turns do not have this setting
        reply = self._query("get limit.cycle.dist", step, tolerated=UNKNOWN_COMMAND)
        turn = self._integer(reply, step) if reply.accepted else 0
        if turn > 0 and turn != round(360 * scale):
            raise self._fault(
                step,
                f"{round(360 * scale)} microsteps in a turn",
                f"{turn}",
                f"set microsteps_per_deg = {turn / 360!r}, and check that it is the right stage",
            )

    def _set(self, name: str, value: int) -> None:
        self._query(f"set {name} {value}", f"set {name}")
        if (got := self._get(name)) != str(value):
            raise self._fault(
                f"set {name}", str(value), f"{got} on reading back", "check the stage's own limits"
            )

    def _get(self, name: str, axis: int | None = None) -> str:
        return self._query(f"get {name}", f"read {name}", axis).data

    def _query(self, command: str, step: str, axis: int | None = None, tolerated: str = "") -> Reply:
        """Send a command that is harmless when repeated: a reading, a setting or an acknowledgement."""
        axis = self._settings.axis if axis is None else axis
        for attempt in range(READ_ATTEMPTS):
            try:
                return self._accepted(self._port.ask(self._settings.address, axis, command), step, tolerated)
            except DeviceTimeout:
                if attempt == READ_ATTEMPTS - 1:
                    raise
        raise AssertionError("unreachable")

    def _begin(
        self, command: str, step: str, permit: Callable[[], None], arrived: Callable[[StageState], bool]
    ) -> None:
        """Send a motion command once; if the answer is lost, find out whether the stage executes it."""
        settings = self._settings
        try:
            self._accepted(self._port.ask(settings.address, settings.axis, command, permit=permit), step)
        except DeviceTimeout as silence:
            seen = self.read()
            if seen.moving or arrived(seen):
                return
            permit()
            raise DeviceTimeout(
                self._name,
                step,
                "a motion",
                f"{silence.got} to the command, and a stage that stands still",
                "check the line for noise, then command it again",
            ) from silence

    def _flags(self, reply: Reply) -> tuple[str, ...]:
        if reply.flag == "--":
            return ()
        return tuple(self._query("warnings", "read warnings").data.split()[1:])

    def _accepted(self, reply: Reply, step: str, tolerated: str = "") -> Reply:
        if reply.address != self._settings.address:
            raise self._fault(
                step,
                f"device {self._settings.address}",
                _foreign(reply),
                "give every device of the chain its own address",
            )
        if not (reply.accepted or reply.data == tolerated):
            raise self._fault(step, "acceptance", _reason(reply), "see the stage's manual for the reason")
        return reply

    def _microsteps(self, angle_deg: float) -> int:
        return round(angle_deg * self._settings.microsteps_per_deg)

    def _integer(self, reply: Reply, step: str = "read position") -> int:
        try:
            return int(reply.data)
        except ValueError as error:
            raise self._fault(step, "a whole number", repr(reply.data), "check axis") from error


def _foreign(reply: Reply) -> str:
    return f"an answer of device {reply.address}"


def _reason(reply: Reply) -> str:
    meaning = REJECTIONS.get(reply.data, "see the manual")
    return f"rejection {reply.data} ({meaning})"


def open_stage(
    settings: ZaberSettings, context: OpenContext, stop_times: StopTimes = STOP_TIMES
) -> ZaberStage:
    """Open the port, identify the stage and write its limits; nothing moves.

    Raises
    ------
    DeviceError
        If the port cannot be opened, no device answers, or the stage does not accept a setting.
    """
    return set_up(ZaberStage(settings, context, stop_times))


SPEC = DriverSpec(kind="stage", settings=ZaberSettings, open=open_stage, find=FINDER)
