"""Rotation stage in the Zaber ASCII protocol."""

import math
import threading
from collections.abc import Callable

from drivers.address import resolve_address
from drivers.errors import DeviceError, DeviceFault, DeviceTimeout
from drivers.interfaces import DeviceInfo, OpenContext, StageState
from drivers.patience import Patience, calling_for_the_emergency_stop
from drivers.registry import DriverSpec
from drivers.zaber_port import ZaberPort
from drivers.zaber_protocol import (
    DISABLED,
    FLAGS,
    MOTION_FAILED,
    NOT_REFERENCED,
    REJECTIONS,
    SPEED_UNIT,
    Reply,
)
from drivers.zaber_settings import ZaberSettings

STOP_PATIENCE_S = 5.0
STOP_POLL_S = 0.02
READ_ATTEMPTS = 2


class ZaberStage:
    """A `RotationStage` on a Zaber ASCII line; construct it with `open_stage`."""

    info: DeviceInfo

    def __init__(self, settings: ZaberSettings, context: OpenContext, port: ZaberPort) -> None:
        self._settings = settings
        self._clock = context.clock
        self._port = port
        self._stops = 0
        self._stop_lock = threading.Lock()
        self.info = DeviceInfo(
            vendor="Zaber",
            model=f"device {self._get('deviceid', axis=0)}",
            serial=self._get("system.serial", axis=0),
            firmware=self._get("version", axis=0),
            simulated=settings.port.startswith("@"),
        )
        self._configure()

    def read(self) -> StageState:
        """Ask for position and status.

        Raises
        ------
        DeviceFault
            If a flag says that motion failed; it stays until `home` acknowledges it.
        """
        reply = self._query("get pos", "read position")
        flags = self._flags(reply)
        self._refuse_failed(flags, "read position")
        return StageState(
            angle_deg=self._integer(reply) / self._settings.microsteps_per_deg,
            moving=reply.busy,
            homed=not NOT_REFERENCED.intersection(flags),
            warnings=flags,
            time_s=self._clock.now_s(),
        )

    def home(self) -> None:
        """Acknowledge past faults and begin to find the reference position."""
        permit = self._unless_stopped("home")
        cleared = self._query("warnings clear", "home")
        if DISABLED.intersection(self._flags(cleared)):
            self._query("driver enable", "home")
        self._begin("home", "home", permit, lambda reply: not NOT_REFERENCED.intersection(self._flags(reply)))

    def move_to(self, angle_deg: float) -> None:
        """Begin to move to an absolute angle.

        Raises
        ------
        DeviceFault
            If the angle is out of limits, or the stage moves, has no reference, has a fault or refuses.
        DeviceTimeout
            If the stage did not take the command. A command whose answer was lost is never sent again: the
            stage is asked what it does instead.
        """
        step = f"move to {angle_deg:g}°"
        low, high = self._settings.angle_min_deg, self._settings.angle_max_deg
        if not (math.isfinite(angle_deg) and low <= angle_deg <= high):
            raise self._fault(
                step, f"an angle from {low:g}° to {high:g}°", f"{angle_deg:g}°", "correct the protocol"
            )
        permit = self._unless_stopped(step)
        state = self.read()
        if state.moving:
            raise self._fault(step, "a standing stage", "a stage in motion", "wait for its end, or stop it")
        if not state.homed:
            raise self._fault(step, "a referenced stage", "no reference position", "home the stage first")
        if state.warnings:
            # so that NI afterwards tells of this motion, not of the last one
            self._query("warnings clear", step)
        target = round(angle_deg * self._settings.microsteps_per_deg)
        self._begin(f"move abs {target}", step, permit, lambda reply: self._integer(reply) == target)

    def move_by(self, angle_deg: float) -> None:
        """Begin to move by an angle from where the stage stands.

        It is sent as an absolute angle: a relative command that is lost, or arrives twice, would leave the
        stage somewhere else. Raises what `move_to` raises.
        """
        self.move_to(self.read().angle_deg + angle_deg)

    def set_speed(self, speed_deg_s: float) -> None:
        """Set the speed of motions to come and read it back; `DeviceFault` if it is not taken."""
        speed = round(speed_deg_s * self._settings.microsteps_per_deg * SPEED_UNIT)
        if not speed > 0:
            raise self._fault("set speed", "a speed above 0", f"{speed_deg_s:g}°/s", "correct the rig file")
        self._set("maxspeed", speed)

    def stop(self) -> None:
        """Stop now; repeated until the stage says that it stands still.

        Other threads' requests do not delay it, and a motion command that was not yet sent is kept back.

        Raises
        ------
        DeviceTimeout
            If the stage does not confirm within 5 s.
        LinkLost
            If the port is gone.
        """
        with self._stop_lock:
            self._stops += 1
        patience = Patience(self._clock, STOP_PATIENCE_S)
        got = "silence"
        while not patience.exhausted:
            try:
                with calling_for_the_emergency_stop(self._port.name):
                    reply = self._port.ask(self._settings.address, self._settings.axis, "stop")
            except DeviceTimeout as silence:
                got = silence.got
                continue
            if reply.accepted and not reply.busy:
                return
            got = "a stage in motion" if reply.accepted else _reason(reply)
            self._clock.sleep(STOP_POLL_S)
        raise DeviceTimeout(
            self._port.name, "stop", expected="standstill", got=got, remedy="press the emergency stop"
        )

    def close(self) -> None:
        """Release the port; harmless when repeated. It does not stop anything."""
        self._port.close()

    def _configure(self) -> None:
        """Check the scale, write limits and speed to the stage and read them back."""
        scale = self._settings.microsteps_per_deg
        self._check_scale(scale)
        low, high = round(self._settings.angle_min_deg * scale), round(self._settings.angle_max_deg * scale)
        limits = [("limit.max", high), ("limit.min", low)]
        # in the order that never crosses them: a stage may refuse a minimum above its present maximum
        if high <= self._integer(self._query("get limit.min", "read limit.min"), "read limit.min"):
            limits.reverse()
        for name, value in limits:
            self._set(name, value)
        self.set_speed(self._settings.speed_deg_s)

    def _check_scale(self, scale: float) -> None:
        """Compare with the stage's own microsteps in a turn, where it knows them."""
        try:
            reply = self._query("get limit.cycle.dist", "read limit.cycle.dist")
        except DeviceFault:
            return  # older firmware, or a stage without turns
        turn = self._integer(reply, "read limit.cycle.dist")
        if turn > 0 and turn != round(360 * scale):
            raise self._fault(
                "read limit.cycle.dist",
                f"{360 * scale:g} microsteps in a turn",
                f"{turn}",
                f"set microsteps_per_deg = {turn / 360:g}, and check that it is the right stage",
            )

    def _set(self, name: str, value: int) -> None:
        self._query(f"set {name} {value}", f"set {name}")
        if (got := self._get(name)) != str(value):
            raise self._fault(
                f"set {name}", str(value), f"{got} on reading back", "check the stage's own limits"
            )

    def _get(self, name: str, axis: int | None = None) -> str:
        return self._query(f"get {name}", f"read {name}", axis).data

    def _query(self, command: str, step: str, axis: int | None = None) -> Reply:
        """Ask what may be asked twice: a reading, or a setting, or an acknowledgement."""
        axis = self._settings.axis if axis is None else axis
        for attempt in range(READ_ATTEMPTS):
            try:
                return self._accepted(self._port.ask(self._settings.address, axis, command), step)
            except DeviceTimeout:
                if attempt == READ_ATTEMPTS - 1:
                    raise
        raise AssertionError("unreachable")

    def _begin(
        self, command: str, step: str, permit: Callable[[], None], arrived: Callable[[Reply], bool]
    ) -> None:
        """Send a motion command once; if its answer is lost, find out whether the stage took it."""
        try:
            self._accepted(
                self._port.ask(self._settings.address, self._settings.axis, command, permit=permit), step
            )
        except DeviceTimeout as silence:
            seen = self._query("get pos", step)
            if seen.busy or arrived(seen):
                return
            raise DeviceTimeout(
                self._port.name,
                step,
                expected="a motion",
                got=f"{silence.got} to the command, and a stage that stands still",
                remedy="check the line for noise, then command it again",
            ) from silence

    def _unless_stopped(self, step: str) -> Callable[[], None]:
        stops = self._stops

        def permit() -> None:
            if self._stops != stops:
                raise self._fault(
                    step, "no stop meanwhile", "a stop", "command the motion again if it is wanted"
                )

        return permit

    def _flags(self, reply: Reply) -> tuple[str, ...]:
        if reply.flag == "--":
            return ()
        return tuple(self._query("warnings", "read warnings").data.split()[1:])

    def _refuse_failed(self, flags: tuple[str, ...], step: str) -> None:
        failed = [flag for flag in flags if flag in MOTION_FAILED]
        if failed:
            got = ", ".join(f"{FLAGS[flag]} ({flag})" for flag in failed)
            raise self._fault(step, "no fault", got, "remove the cause, then home the stage")

    def _accepted(self, reply: Reply, step: str) -> Reply:
        if reply.address != self._settings.address:
            raise self._fault(
                step,
                f"device {self._settings.address}",
                f"an answer of device {reply.address}",
                "give every device of the chain its own address",
            )
        if not reply.accepted:
            raise self._fault(step, "acceptance", _reason(reply), "see the stage's manual for the reason")
        return reply

    def _integer(self, reply: Reply, step: str = "read position") -> int:
        try:
            return int(reply.data)
        except ValueError as error:
            raise self._fault(step, "a whole number", repr(reply.data), "check axis") from error

    def _fault(self, step: str, expected: str, got: str, remedy: str) -> DeviceFault:
        return DeviceFault(self._port.name, step, expected=expected, got=got, remedy=remedy)


def _reason(reply: Reply) -> str:
    meaning = REJECTIONS.get(reply.data, "see the manual")
    return f"rejection {reply.data} ({meaning})"


def open_stage(settings: ZaberSettings, context: OpenContext) -> ZaberStage:
    """Open the port, identify the stage and write its limits; nothing moves.

    Raises
    ------
    DeviceError
        If the port cannot be opened, nothing answers, or a setting is not taken.
    """
    url = resolve_address(settings.port, context)
    port = ZaberPort(f"{context.name} ({url})", url, settings.reply_timeout_s)
    try:
        return ZaberStage(settings, context, port)
    except DeviceError:
        port.close()
        raise


SPEC = DriverSpec(kind="stage", settings=ZaberSettings, open=open_stage)
