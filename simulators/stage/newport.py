"""A rotation stage on a Newport ESP301 motion controller, as a server on a pseudo-terminal or a TCP port.

A command is ``xxAAnn``: the axis, two letters, and a value or ``?``. A line has one or more commands with
``;`` between them, and ends with CR. The controller answers only queries, with a value and CR LF. The
protocol has no message numbers, no checksums and no acknowledgements. An error waits in a queue until the
client sends ``TB?`` or ``TE?``.
Source: ESP301 Integrated 3-Axis Motion Controller/Driver, User's Manual, section Command Set.
"""

import re
from collections.abc import Callable

from drivers.clock import Clock
from simulators.stage import newport_errors as errors
from simulators.stage.device import StageDevice, StageRefusedError
from simulators.stage.faults import stage_faults
from simulators.stage.newport_errors import ErrorQueue, NewportError
from simulators.wire.faults import NEWPORT, FaultPanel
from simulators.wire.ports import LineServer, port_of

COMMAND = re.compile(r"(?P<axis>\d*)(?P<name>[A-Z]{2})(?P<value>\?|[-+]?\d*\.?\d*)")
AXES = 3
DEGREE = 7
NUMBER_MAX = 2e9
HOME_MODES = range(7)
# The home mode in which the stage moves to the counter value 0 instead of searching for the mark.
TO_THE_COUNTERS_ZERO = 0
# The answer to ``ZS?``: the software limits are active (bit 0) and stop the motion (bit 2).
SOFT_LIMITS = "5H"
VERSION = "ESP301 Version 3.0.1 6/1/99"
SPEED_MAX_DEG_S, ACCELERATION_MAX_DEG_S2 = 40.0, 400.0
ANSWERED_WITHOUT_MARK = frozenset({"TP", "TV", "TS", "TX", "TE", "TB", "VE", "ID", "DP"})
SETTINGS = frozenset({"VA", "AC", "AG", "SL", "SR", "SN"})


class NewportServer(LineServer):
    """A controller on a pseudo-terminal or on TCP. The stage is axis 1; the other axes have no stage.

    Parameters
    ----------
    device : StageDevice
    clock : Clock
    host : str, optional
        Address at which the server listens on TCP. Default: a pseudo-terminal instead of TCP.
    port : int
        The TCP port; 0 takes any free port.
    serial : int
        The serial number that the stage reports.
    faults : FaultPanel, optional
        The faults of the stage. Default: a new panel.

    Attributes
    ----------
    home_mode : int
        Mode of a home search for a command ``OR`` without a mode.
    soft_limits : str
        The action at the software limits, as the answer to ``ZS?``.
    """

    line_max = 256

    def __init__(
        self,
        device: StageDevice,
        clock: Clock,
        *,
        host: str | None = None,
        port: int = 0,
        serial: int = 110001,
        faults: FaultPanel | None = None,
    ) -> None:
        self.device = device
        self.faults = faults or stage_faults(FaultPanel(NEWPORT), device)
        self._clock = clock
        self._serial = serial
        super().__init__()
        self.home_mode = 1
        self.soft_limits = SOFT_LIMITS
        self._switch_on()
        self._port = port_of(self, host, port)

    def _switch_on(self) -> None:
        start_s = self._clock.now_s()
        self._power_ups = self.device.power_ups
        self._errors = ErrorQueue(lambda: self._clock.now_s() - start_s)
        self._motor_on = False
        self._target_deg = 0.0

    def damaged(self, reply: bytes) -> bytes:
        """Return the answer with a damaged first character.

        The protocol has no checksum, so a client cannot detect the damage.
        """
        return bytes([reply[0] | 0x80]) + reply[1:]

    def readdressed(self, reply: bytes) -> bytes:
        """Return the answer unchanged, because answers in this protocol have no address."""
        return reply

    def answer(self, line: bytes) -> bytes:
        """Execute the commands of one line and return the answers to the queries."""
        answers = (self._answer_one(text) for text in line.decode("ascii", "replace").split(";"))
        return b"".join(f"{answer}\r\n".encode("ascii") for answer in answers if answer)

    def _answer_one(self, text: str) -> str:
        if self._power_ups != self.device.power_ups:
            self._switch_on()
        if self._errors.watch(self.device):
            self._motor_on = False
        command = COMMAND.fullmatch(text.replace(" ", "").upper())
        try:
            if command is None:
                raise NewportError(errors.UNKNOWN_COMMAND)
            axis, name, value = int(command["axis"] or 0), command["name"], command["value"]
            if value == "?" or (name in ANSWERED_WITHOUT_MARK and not value):
                return self._ask(axis, name)
            if (code := self.faults.take("error")) is not None:
                raise NewportError(int(code))
            self._tell(axis, name, value)
        except NewportError as error:
            self._errors.add(error.code)
        return ""

    def _ask(self, axis: int, name: str) -> str:
        if name == "TB":
            return "{}, {}, {}".format(*self._errors.take())
        if name == "TE":
            return str(self._errors.take()[0])
        controller: dict[str, Callable[[], str]] = {
            "VE": lambda: VERSION,
            "TS": lambda: chr(0x40 | self.device.moving | self._motor_on << 4),
            "TX": lambda: chr(0x40 | self.device.moving),
        }
        if name in controller:
            return controller[name]()
        self._require_axis(axis)
        device = self.device
        readings: dict[str, Callable[[], str]] = {
            "TP": lambda: f"{device.position / device.microsteps_per_deg:.4f}",
            "TV": lambda: f"{device.speed_deg_s:.4f}",
            "MD": lambda: str(int(not device.moving)),
            "MO": lambda: str(int(self._motor_on)),
            "MF": lambda: str(int(self._motor_on)),
            "PA": lambda: f"{self._target_deg:.4f}",
            "DP": lambda: f"{self._target_deg:.4f}",
            "VA": lambda: f"{device.speed_microsteps_s / device.microsteps_per_deg:.4f}",
            "AC": lambda: f"{device.acceleration_microsteps_s2 / device.microsteps_per_deg:.4f}",
            "VU": lambda: f"{SPEED_MAX_DEG_S:.4f}",
            "AG": lambda: f"{device.acceleration_microsteps_s2 / device.microsteps_per_deg:.4f}",
            "AU": lambda: f"{ACCELERATION_MAX_DEG_S2:.4f}",
            "SL": lambda: f"{device.limit_min / device.microsteps_per_deg:.4f}",
            "SR": lambda: f"{device.limit_max / device.microsteps_per_deg:.4f}",
            "SN": lambda: str(DEGREE),
            "SU": lambda: f"{1 / device.microsteps_per_deg:.9f}",
            "ID": lambda: f"URS100BCC, SN {self._serial}",
            "OM": lambda: str(self.home_mode),
            "ZE": lambda: "3H",
            "ZS": lambda: self.soft_limits,
        }
        if name not in readings:
            raise NewportError(errors.UNKNOWN_COMMAND)
        return readings[name]()

    def _tell(self, axis: int, name: str, value: str) -> None:
        device = self.device
        if name in ("ST", "AB", "RS"):
            # Without an axis number, these commands are for all axes.
            if name == "RS":
                device.power_cycle()
            elif name == "ST" or not device.moving:
                device.stop()
            else:
                device.fail("NI")
            self._motor_on = self._motor_on and name == "ST"
            return
        self._require_axis(axis)
        match name:
            case "MO":
                self._switch_motor_on()
            case "MF":
                if device.moving:
                    device.fail("NI")
                self._motor_on = False
            case "OR":
                self._find_home(int(_number(value)) if value else self.home_mode)
            case "OM":
                self.home_mode = _home_mode(int(_number(value)))
            case "PA":
                self._go_to(_number(value))
            case "PR":
                self._go_to(device.position / device.microsteps_per_deg + _number(value))
            case "MV" if value in ("+", "-"):
                self._require_motor()
                speed = device.speed_microsteps_s
                self._begin(lambda: device.turn(speed if value == "+" else -speed))
            case "DH":
                device.set_position(round(_number(value or "0") * device.microsteps_per_deg))
            case "WS":
                pass  # WS delays only stored programs, and this controller stores no programs
            case _ if name in SETTINGS:
                self._set(name, _number(value))
            case _:
                raise NewportError(errors.UNKNOWN_COMMAND)

    def _find_home(self, mode: int) -> None:
        if _home_mode(mode) == TO_THE_COUNTERS_ZERO:
            self._go_to(0.0)
            return
        self._require_motor()
        self._begin(self.device.home)
        self._target_deg = 0.0

    def _set(self, name: str, number: float) -> None:
        device, scale = self.device, self.device.microsteps_per_deg
        match name:
            case "VA" if number > SPEED_MAX_DEG_S:
                raise NewportError(errors.AXIS + errors.TOO_FAST)
            case "AC" | "AG" if number > ACCELERATION_MAX_DEG_S2:
                raise NewportError(errors.AXIS + errors.TOO_SUDDEN)
            case "VA" if number > 0:
                device.speed_microsteps_s = number * scale
            case "AC" if number > 0:
                device.acceleration_microsteps_s2 = number * scale
            case "AG" if number > 0:
                pass
            case "SL" if number * scale < device.limit_max:
                device.limit_min = round(number * scale)
            case "SR" if number * scale > device.limit_min:
                device.limit_max = round(number * scale)
            case "SN" if number == DEGREE:
                pass
            case _:
                raise NewportError(errors.AXIS + errors.AXIS_OUT_OF_RANGE)

    def _go_to(self, angle_deg: float) -> None:
        self._require_motor()
        device = self.device
        target = round(angle_deg * device.microsteps_per_deg)
        if target > device.limit_max:
            raise NewportError(errors.AXIS + errors.SOFT_LIMIT_MAX)
        if target < device.limit_min:
            raise NewportError(errors.AXIS + errors.SOFT_LIMIT_MIN)
        self._begin(lambda: device.move_to(target))
        self._target_deg = angle_deg

    def _begin(self, motion: Callable[[], None]) -> None:
        """Begin a motion, and clear the flags of the previous motion."""
        self.device.clear_flags()
        self._errors.watch(self.device)
        motion()

    def _switch_motor_on(self) -> None:
        try:
            self.device.enable_driver()
        except StageRefusedError as refusal:
            raise NewportError(errors.EMERGENCY_STOP) from refusal
        self._motor_on = True

    def _require_motor(self) -> None:
        if not self._motor_on or not self.device.enabled:
            raise NewportError(errors.AXIS + errors.MOTOR_OFF)

    def _require_axis(self, axis: int) -> None:
        if axis == 0:
            raise NewportError(errors.NO_AXIS)
        if axis > AXES:
            raise NewportError(errors.NO_SUCH_AXIS)
        if axis > 1:
            raise NewportError(errors.AXIS * axis + errors.NOT_CONNECTED)


def _number(value: str) -> float:
    if not value:
        raise NewportError(errors.NO_PARAMETER)
    try:
        number = float(value)
    except ValueError as error:
        raise NewportError(errors.OUT_OF_RANGE) from error
    if abs(number) > NUMBER_MAX:
        raise NewportError(errors.OUT_OF_RANGE)
    return number


def _home_mode(mode: int) -> int:
    if mode not in HOME_MODES:
        raise NewportError(errors.AXIS + errors.AXIS_OUT_OF_RANGE)
    return mode
