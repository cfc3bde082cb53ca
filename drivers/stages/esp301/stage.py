"""Driver for a rotation stage on a Newport ESP301, ESP300 or ESP302 motion controller."""

from collections.abc import Callable

from drivers.errors import DeviceTimeout
from drivers.interfaces import DeviceInfo, OpenContext, Setting, StageState
from drivers.lines.call_time import one_call
from drivers.lines.stop_deadline import STOP_TIMES, StopTimes
from drivers.registry import DriverSpec
from drivers.stages.esp301.axis import EspAxis
from drivers.stages.esp301.find import FINDER
from drivers.stages.esp301.guard import GUARD, identity, stop_once
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
from drivers.stages.esp301.reference import MOTOR_OFF, HomeReference
from drivers.stages.esp301.settings import EspSettings
from drivers.stages.guarded import GuardedStage

POLL_S = 0.02
START_POLLS = 5
POSITION_ATTEMPTS = 3
TARGET_ATTEMPTS = 2
# Largest accepted difference between a written setting and the value read back. The controller rounds
# settings to encoder counts.
SETTING_TOLERANCE = 1e-3


class EspStage(GuardedStage[EspPort]):
    """A `RotationStage` on an ESP301. To construct this class, call `open_stage`."""

    def __init__(self, settings: EspSettings, context: OpenContext, stop_times: StopTimes) -> None:
        super().__init__(EspPort, settings.baud, settings, context, stop_times)
        self._settings = settings
        self._reference = HomeReference()
        self._target_deg: float | None = None
        self._axis = EspAxis(self._port, settings.axis, self._reference)

    def set_up(self) -> None:
        """Identify controller and stage, and write limits and speed. No motion is started."""
        self._axis.take_errors()
        # ignore errors from before this program started, because the driver requires a home search anyway
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

    @one_call
    def read(self) -> StageState:
        """Return position and status of the stage.

        Raise `DeviceFault` if a motion failed or the motor was switched off. The fault remains until `home`
        is called. May also raise `DeviceTimeout` or `LinkLost`.
        """
        sought = self._reference.seeking
        angle_deg, moving = self._position()
        on = self._axis.ask("MO?", read_switch)
        # Only the answer to TB? has this format. So a valid answer shows that the answers came in order.
        errors = self._axis.take_errors()
        referenced, failure = self._reference.see(on=on, ended=sought and not moving)
        if failure:
            raise self._fault("read position", "no fault", failure, "remove the cause, then home the stage")
        warnings = [str(error) for error in errors] + ([] if on else [MOTOR_OFF])
        self._notice_another_target()
        return self._judged(StageState(angle_deg, moving, referenced, tuple(warnings), self._clock.now_s()))

    def read_settings(self) -> dict[str, Setting]:
        """Read limits, speeds, accelerations, resolution and other settings back from the controller."""
        ask = self._axis.ask
        found: dict[str, Setting] = {
            name: ask(question, read_number)
            for name, question in {
                "angle_min_deg": "SL?",
                "angle_max_deg": "SR?",
                "speed_deg_s": "VA?",
                "speed_max_deg_s": "VU?",
                "acceleration_deg_s2": "AC?",
                "deceleration_deg_s2": "AG?",
                "acceleration_max_deg_s2": "AU?",
                "encoder_step_deg": "SU?",
            }.items()
        }
        return found | {
            "home_mode": int(ask("OM?", read_number)),
            "soft_limit_bits": ask("ZS?", read_bits),
            "firmware": self.info.firmware,
        }

    @one_call
    def home(self) -> None:
        """Clear recorded failures, switch the motor on and start the search for the reference position."""
        permit = self._unless_stopped("home")
        self._require_standing(not self._axis.ask("MD?", read_switch), "home")
        self._axis.take_errors()
        self._reference.acknowledge()
        self._axis.tell("MO", "home", permit)
        if not self._axis.ask("MO?", read_switch):
            raise self._fault("home", "a motor that is on", MOTOR_OFF, "check emergency stop and interlock")
        self._reference.motor_is_on()
        self._own_motion.acknowledge()
        self._target_deg = None
        with self._commanding():
            self._axis.tell(f"OR{self._home_mode}", "home", permit)
            self._confirm_start("home", None, permit)
        with self._stop_lock:
            permit()
            self._reference.seek()

    def _begin_move(self, angle_deg: float, state: StageState, step: str, permit: Callable[[], None]) -> None:
        self._refuse_forgotten_limits(step)
        self._axis.tell(f"PA{angle_deg:.5f}", step, permit)
        self._confirm_start(step, angle_deg, permit)
        with self._stop_lock:
            permit()
            self._target_deg = angle_deg

    def _notice_another_target(self) -> None:
        """Compare the controller's target with the target that this program commanded.

        A difference is read a second time, because answers have no checksum.
        """
        for _ in range(TARGET_ATTEMPTS):
            # there is no target to compare if a stop has deleted it meanwhile
            if (target_deg := self._target_deg) is None:
                return
            got_deg = self._axis.ask("PA?", read_number)
            if abs(got_deg - target_deg) <= self._settings.tolerance_deg:
                return
        if self._target_deg is not None:
            self._own_motion.note(f"the target {got_deg:g}°, which this program did not command")

    def _try_to_stop(self, port: EspPort) -> str:
        return stop_once(self._axis.number, port, self._stop_times.answer_s)

    def _stranger(self, port: EspPort) -> str:
        found = identity(self._axis.number, port, self._stop_times.answer_s)
        return "" if found == self._identity else f"the stage {found!r}"

    def _break_off_search(self) -> None:
        self._target_deg = None
        self._reference.break_off()

    def _configure(self) -> None:
        """Check that the controller uses degrees. Write limits and speed to the controller, and read them
        back."""
        unit = self._axis.ask("SN?", read_number)
        if unit != DEGREES:
            raise self._fault(
                "read unit", f"degrees ({DEGREES})", f"unit {unit:g}", "set up the axis for a rotation stage"
            )
        low, high = self._limits_deg
        limits = [("SR", high, "set right limit"), ("SL", low, "set left limit")]
        # write in an order in which the lower limit never exceeds the upper limit
        if high <= self._axis.ask("SL?", read_number):
            limits.reverse()
        for name, value, step in limits:
            self._set(name, value, step)
        self._refuse_idle_limits()
        self._set_speed(self._settings.speed_deg_s)
        if (acceleration_deg_s2 := self._settings.acceleration_deg_s2) is not None:
            self._set_acceleration(acceleration_deg_s2)

    def _set_speed(self, speed_deg_s: float) -> None:
        greatest_deg_s = self._axis.ask("VU?", read_number)
        if speed_deg_s > greatest_deg_s:
            expected, got = f"a speed above 0 up to {greatest_deg_s:g}°/s", f"{speed_deg_s:g}°/s"
            raise self._fault("set speed", expected, got, "correct speed_deg_s in the rig file")
        self._set("VA", speed_deg_s, "set speed")

    def _set_acceleration(self, acceleration_deg_s2: float) -> None:
        greatest_deg_s2 = self._axis.ask("AU?", read_number)
        if acceleration_deg_s2 > greatest_deg_s2:
            expected, got = f"at most {greatest_deg_s2:g}°/s²", f"{acceleration_deg_s2:g}°/s²"
            remedy = "correct acceleration_deg_s2 in the rig file"
            raise self._fault("set acceleration", expected, got, remedy)
        self._set("AC", acceleration_deg_s2, "set acceleration")
        self._set("AG", acceleration_deg_s2, "set deceleration")

    def _signals_to_home_by(self) -> int:
        """Return the home mode from the settings or the controller. Refuse mode 0, which uses no signal."""
        mode = self._settings.home_mode or self._axis.ask("OM?", read_number)
        if mode < 1:
            raise self._fault(
                "read home mode",
                "a home search that looks for a signal (1 to 6)",
                f"{mode:g}, which moves to the counter value 0",
                "set home_mode to match the signals of the stage",
            )
        return int(mode)

    def _refuse_idle_limits(self) -> None:
        """Raise `DeviceFault` if the controller does not enforce its software limits."""
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
        """Raise `DeviceFault` if the controller's limits have changed, as they do after a reset."""
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
        """Wait until the stage moves or stands at its target. Raise `DeviceTimeout` if neither happens."""
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
        """Return the angle and whether the stage moves. If the stage stands still, read the angle twice.

        Answers have no checksum, so that a single reading does not show whether noise changed a digit.
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
    """Open the port, identify controller and stage, and write the limits. No motion is started.

    Raise `DeviceError` if the port cannot be opened, no device answers, or the stage does not accept a
    setting.
    """
    return EspStage(settings, context, stop_times).opened()


SPEC = DriverSpec(kind="stage", settings=EspSettings, open=open_stage, find=FINDER, guard=GUARD)
