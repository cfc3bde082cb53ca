"""Rotation stage on a Newport ESP301 (or ESP300, ESP302) motion controller."""

import math
from collections.abc import Callable
from typing import TypeVar

from drivers.address import resolve_address
from drivers.errors import DeviceError, DeviceFault, DeviceTimeout, LinkLost
from drivers.esp301_port import EspPort
from drivers.esp301_protocol import (
    DEGREES,
    MODEL,
    QUEUE_DEPTH,
    QueuedError,
    read_error,
    read_number,
    read_switch,
)
from drivers.esp301_reference import MOTOR_OFF, Reference
from drivers.esp301_settings import EspSettings
from drivers.interfaces import DeviceInfo, OpenContext, StageState
from drivers.patience import Patience, calling_for_the_emergency_stop
from drivers.registry import DriverSpec

STOP_PATIENCE_S = 5.0
POLL_S = 0.02
START_POLLS = 5
POSITION_ATTEMPTS = 3
# The controller rounds what it is told to its own counts.
SETTING_TOLERANCE = 1e-3

T = TypeVar("T")


class EspStage:
    """A `RotationStage` on an ESP301; construct it with `open_stage`."""

    info: DeviceInfo

    def __init__(self, settings: EspSettings, context: OpenContext, port: EspPort) -> None:
        self._settings = settings
        self._clock = context.clock
        self._port = port
        self._axis = settings.axis
        self._reference = Reference()
        self._empty_queue()
        found = MODEL.fullmatch(port.version)
        stage, _, serial = self._ask("ID?", str).partition("SN")
        self.info = DeviceInfo(
            vendor="Newport",
            model=f"{found['model'] if found else ''} with {stage.strip(' ,')}",
            serial=serial.strip(),
            firmware=found["firmware"] if found else "",
            simulated=settings.port.startswith("@"),
        )
        self._configure()

    def read(self) -> StageState:
        """Ask for position and status.

        Raises
        ------
        DeviceFault
            If motion failed or the motor was switched off; it stays until `home` acknowledges it.
        DeviceTimeout, LinkLost
        """
        angle_deg, moving = self._position()
        on = self._ask("MO?", read_switch)
        # the last question has an answer like no other: it proves that all answers were in their places
        errors = self._empty_queue()
        failures = [str(error) for error in errors if error.fails(self._axis)]
        referenced, failure = self._reference.see(on=on, moving=moving, failures=failures)
        if failure:
            raise self._fault("read position", "no fault", failure, "remove the cause, then home the stage")
        warnings = [str(error) for error in errors] + ([] if on else [MOTOR_OFF])
        return StageState(angle_deg, moving, referenced, tuple(warnings), self._clock.now_s())

    def home(self) -> None:
        """Acknowledge past faults, switch the motor on and begin to find the reference position."""
        permit = self._unless_stopped("home")
        stops = self._reference.stops
        self._empty_queue()
        self._reference.acknowledge()
        self._command("MO", "home", permit)
        if not self._ask("MO?", read_switch):
            raise self._fault("home", "a motor that is on", MOTOR_OFF, "check emergency stop and interlock")
        self._reference.motor_is_on()
        mode = "" if self._settings.home_mode is None else str(self._settings.home_mode)
        self._command(f"OR{mode}", "home", permit)
        self._confirm_start("home", None)
        self._reference.seek(stops)

    def move_to(self, angle_deg: float) -> None:
        """Begin to move to an absolute angle.

        Raises
        ------
        DeviceFault
            If the angle is out of limits, or the stage moves, has no reference, has a fault or refuses.
        DeviceTimeout
            If the stage did not begin to move. The command is never sent twice.
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
        self._refuse_forgotten_limits(step)
        self._command(f"PA{angle_deg:.5f}", step, permit)
        self._confirm_start(step, angle_deg)

    def move_by(self, angle_deg: float) -> None:
        """Begin to move by an angle from where the stage stands; sent as an absolute one, like `move_to`."""
        self.move_to(self.read().angle_deg + angle_deg)

    def set_speed(self, speed_deg_s: float) -> None:
        """Set the speed of motions to come and read it back; `DeviceFault` if the stage does not take it."""
        greatest = self._ask("VU?", read_number)
        if not 0 < speed_deg_s <= greatest:
            expected = f"a speed above 0 up to {greatest:g}°/s"
            raise self._fault("set speed", expected, f"{speed_deg_s:g}°/s", "correct the rig file")
        self._set("VA", speed_deg_s, "set speed")

    def stop(self) -> None:
        """Stop now; repeated until the controller says that the stage stands still.

        Other threads' questions do not delay it, and a motion command that was not yet sent is kept back.

        Raises
        ------
        DeviceTimeout
            If it does not confirm within 5 s.
        LinkLost
            If the port is gone.
        """
        self._reference.stop()
        patience = Patience(self._clock, STOP_PATIENCE_S)
        got = "silence"
        while not patience.exhausted:
            try:
                with calling_for_the_emergency_stop(self._port.name):
                    self._port.send(f"{self._axis}ST")
                    if self._port.ask_first(f"{self._axis}MD?", read_switch):
                        return
                got = "a stage in motion"
            except DeviceTimeout as silence:
                got = silence.got
            self._clock.sleep(POLL_S)
        raise DeviceTimeout(
            self._port.name, "stop", expected="standstill", got=got, remedy="press the emergency stop"
        )

    def close(self) -> None:
        """Release the port; harmless when repeated. It does not stop anything."""
        self._port.close()

    def _configure(self) -> None:
        """Check the unit, write limits and speed and read them back."""
        unit = self._ask("SN?", read_number)
        if unit != DEGREES:
            raise self._fault(
                "read unit", f"degrees ({DEGREES})", f"unit {unit:g}", "set up the axis for a rotation stage"
            )
        low, high = self._settings.angle_min_deg, self._settings.angle_max_deg
        limits = [("SR", high, "set right limit"), ("SL", low, "set left limit")]
        # in the order that never crosses them
        if high <= self._ask("SL?", read_number):
            limits.reverse()
        for name, value, step in limits:
            self._set(name, value, step)
        self.set_speed(self._settings.speed_deg_s)

    def _set(self, name: str, value: float, step: str) -> None:
        self._command(f"{name}{value:.5f}", step)
        got = self._ask(f"{name}?", read_number)
        if abs(got - value) > SETTING_TOLERANCE:
            raise self._fault(step, f"{value:g}", f"{got:g} on reading back", "check the stage's own limits")

    def _refuse_forgotten_limits(self, step: str) -> None:
        """A controller that was reset and switched on again behind our back has its own limits again."""
        for name, value in (("SL", self._settings.angle_min_deg), ("SR", self._settings.angle_max_deg)):
            got = self._ask(f"{name}?", read_number)
            if abs(got - value) > SETTING_TOLERANCE:
                self._reference.forget()
                raise self._fault(
                    step,
                    f"the limit {value:g}° that was set",
                    f"{got:g}°: the controller was reset",
                    "open the stage again and home it",
                )

    def _command(self, command: str, step: str, permit: Callable[[], None] | None = None) -> None:
        """Send a command once, and see whether the controller refused it."""
        self._port.send(f"{self._axis}{command}", permit)
        try:
            errors = self._empty_queue()
        except LinkLost:
            raise
        except DeviceTimeout:
            return  # whether it was obeyed is seen by what the stage does
        refused = [str(error) for error in errors if error.axis in (0, self._axis)]
        if refused:
            raise self._fault(
                step, "acceptance", "; ".join(refused), "see appendix A of the controller's manual"
            )

    def _confirm_start(self, step: str, target_deg: float | None) -> None:
        """See that the stage moves, or stands at its target already."""
        for _ in range(START_POLLS):
            if not self._ask("MD?", read_switch):
                return
            if target_deg is not None:
                off_deg = abs(self._ask("TP", read_number) - target_deg)
                if off_deg <= self._settings.tolerance_deg:
                    return
            self._clock.sleep(POLL_S)
        raise DeviceTimeout(
            self._port.name,
            step,
            expected="a motion",
            got="a stage that stands still",
            remedy="check the line for noise and the motor, then command it again",
        )

    def _position(self) -> tuple[float, bool]:
        """Return the angle and whether the stage moves; that of a standing stage is asked for twice.

        There is no checksum: a digit that was disturbed on the line looks like any other.
        """
        for _ in range(POSITION_ATTEMPTS):
            angle_deg = self._ask("TP", read_number)
            moving = not self._ask("MD?", read_switch)
            if moving or abs(self._ask("TP", read_number) - angle_deg) <= self._settings.tolerance_deg:
                return angle_deg, moving
        raise DeviceTimeout(
            self._port.name,
            "read position",
            expected="two readings in a row that agree while the stage stands",
            got=f"{angle_deg:g}° and others",
            remedy="check the line for noise",
        )

    def _empty_queue(self) -> list[QueuedError]:
        errors = []
        for _ in range(QUEUE_DEPTH + 1):
            error = self._port.ask("TB?", read_error)
            if error.code == 0:
                break
            errors.append(error)
        return errors

    def _ask(self, question: str, read: Callable[[str], T]) -> T:
        return self._port.ask(f"{self._axis}{question}", read)

    def _unless_stopped(self, step: str) -> Callable[[], None]:
        stops = self._reference.stops

        def permit() -> None:
            if self._reference.stops != stops:
                raise self._fault(
                    step, "no stop meanwhile", "a stop", "command the motion again if it is wanted"
                )

        return permit

    def _fault(self, step: str, expected: str, got: str, remedy: str) -> DeviceFault:
        return DeviceFault(self._port.name, step, expected=expected, got=got, remedy=remedy)


def open_stage(settings: EspSettings, context: OpenContext) -> EspStage:
    """Open the port, identify controller and stage and write the limits; nothing moves.

    Raises
    ------
    DeviceError
        If the port cannot be opened, nothing answers, or a setting is not taken.
    """
    url = resolve_address(settings.port, context)
    port = EspPort(f"{context.name} ({url})", url, settings.baud, settings.reply_timeout_s)
    try:
        return EspStage(settings, context, port)
    except DeviceError:
        port.close()
        raise


SPEC = DriverSpec(kind="stage", settings=EspSettings, open=open_stage)
