"""Driver for a rotation stage with the Zaber ASCII protocol."""

from collections.abc import Callable

from drivers.errors import DeviceTimeout
from drivers.interfaces import DeviceInfo, OpenContext, Setting, StageState
from drivers.lines.call_time import one_call
from drivers.lines.stop_deadline import STOP_TIMES, StopTimes
from drivers.registry import DriverSpec
from drivers.stages.guarded import GuardedStage
from drivers.stages.zaber.find import FINDER
from drivers.stages.zaber.guard import GUARD, foreign, serial_number, stop_once
from drivers.stages.zaber.port import BAUD, ZaberPort
from drivers.stages.zaber.protocol import (
    ACCELERATION_UNIT,
    FLAGS,
    NOT_REFERENCED,
    SPEED_UNIT,
    UNKNOWN_COMMAND,
    Reply,
    is_fault,
    reason,
)
from drivers.stages.zaber.settings import ZaberSettings

READ_ATTEMPTS = 2
INTERRUPTED = "NI"


class ZaberStage(GuardedStage[ZaberPort]):
    """A `RotationStage` with the Zaber ASCII protocol. To construct this class, call `open_stage`."""

    def __init__(self, settings: ZaberSettings, context: OpenContext, stop_times: StopTimes) -> None:
        super().__init__(ZaberPort, BAUD, settings, context, stop_times)
        self._settings = settings
        # After a fault the stage may still report a valid reference, but the driver requires a home search.
        self._doubted = self._seeking = False
        self._stops_before_motion = -1

    def set_up(self) -> None:
        """Identify the stage, and write limits and speed. No motion is started."""
        self.info = DeviceInfo(
            vendor="Zaber",
            model=f"device {self._get('deviceid', axis=0)}",
            serial=self._get("system.serial", axis=0),
            firmware=self._get("version", axis=0),
            simulated=self._settings.port.startswith("@"),
        )
        self._configure()
        # forget a foreign answer that an earlier program may have caused
        self._port.foreign = ""

    @one_call
    def read(self) -> StageState:
        """Return position and status of the stage.

        Raise `DeviceFault` if a flag reports that a motion failed. The flag remains until `home` is called.
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
        if INTERRUPTED in flags and self._stops == self._stops_before_motion:
            self._own_motion.note("a motion that another program interrupted (NI)")
        if self._port.foreign:
            self._own_motion.note(self._port.foreign)
        return self._judged(
            StageState(
                angle_deg=self._integer(reply) / self._settings.microsteps_per_deg,
                moving=reply.busy,
                homed=not (self._doubted or NOT_REFERENCED.intersection(flags)),
                warnings=flags,
                time_s=self._clock.now_s(),
            )
        )

    def read_settings(self) -> dict[str, Setting]:
        """Read limits, speed, acceleration, resolution and firmware back from the stage."""
        scale = self._settings.microsteps_per_deg
        found: dict[str, Setting] = {}
        for name, setting, factor in (
            ("angle_min_deg", "limit.min", 1.0),
            ("angle_max_deg", "limit.max", 1.0),
            ("speed_deg_s", "maxspeed", SPEED_UNIT),
            ("acceleration_deg_s2", "accel", ACCELERATION_UNIT),
        ):
            step = f"read {setting}"
            found[name] = self._integer(self._query(f"get {setting}", step), step) / (factor * scale)
        # leave these two settings out for older firmware, which does not have them
        for name, setting in (
            ("microsteps_per_step", "resolution"),
            ("microsteps_per_turn", "limit.cycle.dist"),
        ):
            if (number := self._number_if_known(setting)) is not None:
                found[name] = number
        return found | {"firmware": self._get("version", axis=0)}

    @one_call
    def home(self) -> None:
        """Clear the flags of failed motions and start the search for the reference position."""
        permit = self._unless_stopped("home")
        self._require_standing(self._query("", "home").busy, "home")
        self._seeking, self._doubted = False, True
        flags = self._flags(self._query("warnings clear", "home"))
        if any(is_fault(flag) for flag in flags):
            self._query("driver enable", "home")
        had_none = bool(NOT_REFERENCED.intersection(flags))
        self._own_motion.acknowledge()
        self._port.foreign = ""
        self._stops_before_motion = self._stops
        with self._commanding():
            self._begin(
                "home",
                "home",
                permit,
                lambda seen: had_none and not NOT_REFERENCED.intersection(seen.warnings),
            )
        with self._stop_lock:
            permit()
            self._seeking = True

    def _begin_move(self, angle_deg: float, state: StageState, step: str, permit: Callable[[], None]) -> None:
        if state.warnings:
            # clear the flags, so that a later flag NI (interrupted) belongs to this motion
            self._query("warnings clear", step)
        self._stops_before_motion = self._stops
        target = self._microsteps(angle_deg)
        self._begin(
            f"move abs {target}", step, permit, lambda seen: self._microsteps(seen.angle_deg) == target
        )

    def _try_to_stop(self, port: ZaberPort) -> str:
        return stop_once(self._settings, port, self._stop_times.answer_s)

    def _stranger(self, port: ZaberPort) -> str:
        serial = serial_number(self._settings, port, self._stop_times.answer_s)
        return "" if serial == self.info.serial else f"a device with serial number {serial}"

    def _break_off_search(self) -> None:
        self._seeking = False

    def _configure(self) -> None:
        """Check the scale. Write limits and speed to the stage, and read them back."""
        self._check_scale(self._settings.microsteps_per_deg)
        low, high = (self._microsteps(angle_deg) for angle_deg in self._limits_deg)
        limits = [("limit.max", high), ("limit.min", low)]
        # the minimum must never exceed the maximum, not even between the two commands, or a stage may refuse
        if high <= self._integer(self._query("get limit.min", "read limit.min"), "read limit.min"):
            limits.reverse()
        for name, value in limits:
            self._set(name, value)
        speed_microsteps_s = self._settings.speed_deg_s * self._settings.microsteps_per_deg
        self._set("maxspeed", round(speed_microsteps_s * SPEED_UNIT))
        if (acceleration_deg_s2 := self._settings.acceleration_deg_s2) is not None:
            acceleration_microsteps_s2 = acceleration_deg_s2 * self._settings.microsteps_per_deg
            self._set("accel", max(1, round(acceleration_microsteps_s2 * ACCELERATION_UNIT)))

    def _check_scale(self, scale: float) -> None:
        """Compare the scale with the number of microsteps per turn, if the stage reports this number."""
        step = "read limit.cycle.dist"
        # older firmware, and stages that cannot make a full turn, do not have this setting
        turn = self._number_if_known("limit.cycle.dist") or 0
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

    def _number_if_known(self, name: str) -> int | None:
        """Return the whole number of a setting, or None if the stage does not know the setting."""
        reply = self._query(f"get {name}", f"read {name}", tolerated=UNKNOWN_COMMAND)
        return self._integer(reply, f"read {name}") if reply.accepted else None

    def _get(self, name: str, axis: int | None = None) -> str:
        return self._query(f"get {name}", f"read {name}", axis).data

    def _query(self, command: str, step: str, axis: int | None = None, tolerated: str = "") -> Reply:
        """Send a command that may be repeated: a query, a setting, or the command that clears flags."""
        axis = self._settings.axis if axis is None else axis
        reply = self._port.ask(self._settings.address, axis, command, attempts=READ_ATTEMPTS)
        return self._accepted(reply, step, tolerated)

    def _begin(
        self, command: str, step: str, permit: Callable[[], None], arrived: Callable[[StageState], bool]
    ) -> None:
        """Send a motion command once. If the answer is lost, check whether the stage executes the command."""
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
                foreign(reply),
                "give every device of the chain its own address",
            )
        if not (reply.accepted or reply.data == tolerated):
            raise self._fault(step, "acceptance", reason(reply), "see the stage's manual for the reason")
        return reply

    def _microsteps(self, angle_deg: float) -> int:
        return round(angle_deg * self._settings.microsteps_per_deg)

    def _integer(self, reply: Reply, step: str = "read position") -> int:
        try:
            return int(reply.data)
        except ValueError as error:
            raise self._fault(step, "a whole number", repr(reply.data), "check axis") from error


def open_stage(
    settings: ZaberSettings, context: OpenContext, stop_times: StopTimes = STOP_TIMES
) -> ZaberStage:
    """Open the port, identify the stage and write its limits. No motion is started.

    Raise `DeviceError` if the port cannot be opened, no device answers, or the stage does not accept a
    setting.
    """
    return ZaberStage(settings, context, stop_times).opened()


SPEC = DriverSpec(kind="stage", settings=ZaberSettings, open=open_stage, find=FINDER, guard=GUARD)
