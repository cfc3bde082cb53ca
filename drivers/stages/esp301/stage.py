"""Rotation stage on a Newport ESP301 (or ESP300, ESP302) motion controller."""

from collections.abc import Callable
from functools import partial

from drivers.errors import DeviceTimeout
from drivers.interfaces import DeviceInfo, OpenContext, StageState
from drivers.lines.stop_deadline import STOP_TIMES, StopTimes
from drivers.registry import DriverSpec
from drivers.stages.esp301.axis import EspAxis
from drivers.stages.esp301.find import FINDER
from drivers.stages.esp301.port import EspPort
from drivers.stages.esp301.protocol import (
    DEGREES,
    LIMITS_ACTED_ON,
    LIMITS_WATCHED,
    MODEL,
    read_bits,
    read_name,
    read_number,
    read_switch,
)
from drivers.stages.esp301.reference import MOTOR_OFF, Reference
from drivers.stages.esp301.settings import EspSettings
from drivers.stages.guarded import GuardedStage, set_up

POLL_S = 0.02
START_POLLS = 5
POSITION_ATTEMPTS = 3
# The controller rounds settings to encoder counts.
SETTING_TOLERANCE = 1e-3


class EspStage(GuardedStage[EspPort]):
    """A `RotationStage` on an ESP301; construct it with `open_stage`."""

    def __init__(self, settings: EspSettings, context: OpenContext, stop_times: StopTimes) -> None:
        super().__init__(partial(EspPort, settings.baud), settings, context, stop_times)
        self._settings = settings
        self._reference = Reference()
        self._axis = EspAxis(self._port, settings.axis, self._reference)

    def set_up(self) -> None:
        """Identify controller and stage, write limits and speed; nothing moves."""
        self._axis.take_errors()
        # earlier errors do not belong to this program; a stage without reference does not move anyway
        self._reference.acknowledge()
        found = MODEL.fullmatch(self._port.version)
        self._identity = self._axis.ask("ID?", read_name)
        stage, _, serial = self._identity.partition("SN")
        self.info = DeviceInfo(
            vendor="Newport",
            model=f"{found['model'] if found else ''} with {stage.strip(' ,')}",
            serial=serial.strip(),
            firmware=found["firmware"] if found else "",
            simulated=self._settings.port.startswith("@"),
        )
        self._home_mode = self._signals_to_home_by()
        self._configure()

    def read(self) -> StageState:
        """Ask for position and status.

        Raises
        ------
        DeviceFault
            If motion failed or the motor was switched off; the fault stays until `home` acknowledges it.
        DeviceTimeout, LinkLost
        """
        sought = self._reference.seeking
        angle_deg, moving = self._position()
        on = self._axis.ask("MO?", read_switch)
        # answers to TB? have a unique format: this one proves that no earlier answer was out of order
        errors = self._axis.take_errors()
        referenced, failure = self._reference.see(on=on, ended=sought and not moving)
        if failure:
            raise self._fault("read position", "no fault", failure, "remove the cause, then home the stage")
        warnings = [str(error) for error in errors] + ([] if on else [MOTOR_OFF])
        return StageState(angle_deg, moving, referenced, tuple(warnings), self._clock.now_s())

    def home(self) -> None:
        """Acknowledge past faults, switch the motor on and begin to find the reference position."""
        permit = self._unless_stopped("home")
        self._require_standing(not self._axis.ask("MD?", read_switch), "home")
        self._axis.take_errors()
        self._reference.acknowledge()
        self._axis.tell("MO", "home", permit)
        if not self._axis.ask("MO?", read_switch):
            raise self._fault("home", "a motor that is on", MOTOR_OFF, "check emergency stop and interlock")
        self._reference.motor_is_on()
        self._axis.tell(f"OR{self._home_mode}", "home", permit)
        self._confirm_start("home", None, permit)
        with self._stop_lock:
            permit()
            self._reference.seek()

    def _begin_move(self, angle_deg: float, state: StageState, step: str, permit: Callable[[], None]) -> None:
        self._refuse_forgotten_limits(step)
        self._axis.tell(f"PA{angle_deg:.5f}", step, permit)
        self._confirm_start(step, angle_deg, permit)

    def _try_to_stop(self, port: EspPort) -> str:
        port.send(f"{self._axis.number}ST")
        stands = port.ask_first(f"{self._axis.number}MD?", read_switch, self._stop_times.answer_s)
        return "" if stands else "a stage in motion"

    def _stranger(self, port: EspPort) -> str:
        identity = port.ask_first(f"{self._axis.number}ID?", read_name, self._stop_times.answer_s)
        return "" if identity == self._identity else f"the stage {identity!r}"

    def _break_off_search(self) -> None:
        self._reference.break_off()

    def _configure(self) -> None:
        """Check the unit, write limits and speed and read them back."""
        unit = self._axis.ask("SN?", read_number)
        if unit != DEGREES:
            raise self._fault(
                "read unit", f"degrees ({DEGREES})", f"unit {unit:g}", "set up the axis for a rotation stage"
            )
        low, high = self._limits_deg
        limits = [("SR", high, "set right limit"), ("SL", low, "set left limit")]
        # the lower limit never exceeds the upper limit in this order
        if high <= self._axis.ask("SL?", read_number):
            limits.reverse()
        for name, value, step in limits:
            self._set(name, value, step)
        self._refuse_idle_limits()
        self._set_speed(self._settings.speed_deg_s)

    def _set_speed(self, speed_deg_s: float) -> None:
        greatest_deg_s = self._axis.ask("VU?", read_number)
        if speed_deg_s > greatest_deg_s:
            expected, got = f"a speed above 0 up to {greatest_deg_s:g}°/s", f"{speed_deg_s:g}°/s"
            raise self._fault("set speed", expected, got, "correct speed_deg_s in the rig file")
        self._set("VA", speed_deg_s, "set speed")

    def _signals_to_home_by(self) -> int:
        """Return the home mode, by default the controller's; refuse a mode that looks for no signal."""
        mode = self._settings.home_mode or self._axis.ask("OM?", read_number)
        if mode < 1:
            raise self._fault(
                "read home mode",
                "a home search that looks for a signal (1 to 6)",
                f"{mode:g}, which goes to where the counter is 0",
                "set home_mode, as the stage's signals are",
            )
        return int(mode)

    def _refuse_idle_limits(self) -> None:
        """Refuse a controller that does not enforce its software limits."""
        bits = self._axis.ask("ZS?", read_bits)
        if not (bits & LIMITS_WATCHED and bits & LIMITS_ACTED_ON):
            raise self._fault(
                "read limits",
                "software limits that are watched and stop the stage (ZS with bit 0, and 1 or 2)",
                f"{bits:X}H",
                f"switch them on, as {self._axis.number}ZS5 does",
            )

    def _set(self, name: str, value: float, step: str) -> None:
        self._axis.tell(f"{name}{value:.5f}", step)
        got = self._axis.ask(f"{name}?", read_number)
        if abs(got - value) > SETTING_TOLERANCE:
            raise self._fault(step, f"{value:g}", f"{got:g} on reading back", "check the stage's own limits")

    def _refuse_forgotten_limits(self, step: str) -> None:
        """Refuse motion if the limits have changed: a controller that was reset loses the limits set here."""
        for name, value in zip(("SL", "SR"), self._limits_deg, strict=True):
            got = self._axis.ask(f"{name}?", read_number)
            if abs(got - value) > SETTING_TOLERANCE:
                self._reference.forget()
                raise self._fault(
                    step,
                    f"the limit {value:g}° that was set",
                    f"{got:g}°: the controller was reset",
                    "open the stage again and home it",
                )

    def _confirm_start(self, step: str, target_deg: float | None, permit: Callable[[], None]) -> None:
        """Check that the stage moves, or stands at its target already."""
        for _ in range(START_POLLS):
            if not self._axis.ask("MD?", read_switch):
                return
            if target_deg is not None:
                off_deg = abs(self._axis.ask("TP", read_number) - target_deg)
                if off_deg <= self._settings.tolerance_deg:
                    return
            self._clock.sleep(POLL_S)
        permit()
        raise DeviceTimeout(
            self._port.name,
            step,
            "a motion",
            "a stage that stands still",
            "check the line for noise and the motor, then command it again",
        )

    def _position(self) -> tuple[float, bool]:
        """Return the angle and whether the stage moves; read the angle of a standing stage twice.

        Answers have no checksum: a digit changed by noise cannot be detected in a single reading.
        """
        for _ in range(POSITION_ATTEMPTS):
            angle_deg = self._axis.ask("TP", read_number)
            moving = not self._axis.ask("MD?", read_switch)
            if moving or abs(self._axis.ask("TP", read_number) - angle_deg) <= self._settings.tolerance_deg:
                return angle_deg, moving
        raise DeviceTimeout(
            self._port.name,
            "read position",
            "two readings in a row that agree while the stage stands",
            f"{angle_deg:g}° and others",
            "check the line for noise",
        )


def open_stage(settings: EspSettings, context: OpenContext, stop_times: StopTimes = STOP_TIMES) -> EspStage:
    """Open the port, identify controller and stage and write the limits; nothing moves.

    Raises
    ------
    DeviceError
        If the port cannot be opened, no device answers, or the stage does not accept a setting.
    """
    return set_up(EspStage(settings, context, stop_times))


SPEC = DriverSpec(kind="stage", settings=EspSettings, open=open_stage, find=FINDER)
