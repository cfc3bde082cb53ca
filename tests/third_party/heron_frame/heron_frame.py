"""A driver by a third party for a small load frame: a motor with a microcontroller, and a load cell.

The machine controls the displacement only. It answers lines of text: ``ID?`` with its name, ``S?`` with
sample, load in N, displacement in mm, state, fault and number of the last motion. ``LIM``, ``GO`` and
``TARE`` are answered with ``OK`` or ``NO`` and a reason; ``HOLD`` has no answer. ``SPD`` changes the speed
of a motion, and is refused without one.
"""

import math
from dataclasses import astuple, dataclass
from functools import partial
from typing import ClassVar

from pydantic import Field

from drivers.errors import DeviceFault, DeviceTimeout, LinkLost
from drivers.interfaces import DeviceInfo, LoadFrameLimits, LoadFrameState, OpenContext
from drivers.lines.addresses import resolve_address
from drivers.lines.call_time import CallTime, one_call
from drivers.lines.channel import Channel, open_device
from drivers.lines.line_guard import LineTalk, guard_spec
from drivers.lines.line_port import LinePort, LineSyntax, Proof
from drivers.lines.stop_deadline import STOP_TIMES, stop_until_confirmed
from drivers.load_frames.travel import Travel
from drivers.registry import DriverSpec
from drivers.settings import Settings

BAUD, STALE_S = 115_200, 0.5


class HeronSettings(Settings):
    """Port and limits, as given in the rig file."""

    port: str
    load_min_n: float = -100.0
    load_max_n: float = Field(gt=0)
    displacement_min_mm: float = -1.0
    displacement_max_mm: float = Field(gt=0)
    speed_max_mm_s: float = Field(default=1.0, gt=0)
    reply_timeout_s: float = Field(default=0.25, gt=0, le=10)
    load_rate_max_n_s: ClassVar[float] = 0.0  # without control of the load
    changes_speed: ClassVar[bool] = True

    @property
    def limits(self) -> LoadFrameLimits:
        """The limits, which are also written into the machine."""
        names = LoadFrameLimits.__dataclass_fields__
        return LoadFrameLimits(**{name: getattr(self, name) for name in names})


@dataclass(frozen=True)
class Status:
    """An answer to ``S?``."""

    sample: int
    load_n: float
    displacement_mm: float
    state: str
    fault: str
    motion: int


def read_status(line: str) -> Status:
    """Return the status in a line. Raise `ValueError` for any other line."""
    sample, load, displacement, state, fault, motion = line.removeprefix("S ").split()
    return Status(int(sample), float(load), float(displacement), state, fault, int(motion))


def port_on(name: str, channel: Channel, reply_timeout_s: float) -> LinePort:
    """Return a port on an open channel."""
    proof = Proof("ID?", lambda line: line.startswith("HERON "))
    return LinePort(name, channel, reply_timeout_s, LineSyntax(proof=proof))


def hold_once(port: LinePort, answer_s: float) -> str:
    """Command a hold once. Return an empty text if the crosshead stands."""
    port.send("HOLD")
    return "a moving crosshead" if port.ask_first("S?", read_status, answer_s).state == "MOVE" else ""


class HeronFrame:
    """A `LoadFrame`."""

    def __init__(self, settings: HeronSettings, context: OpenContext) -> None:
        address = resolve_address(settings.port, context)
        self._name, self._clock, self.limits = f"{context.name} ({address})", context.clock, settings.limits
        self._call_time = CallTime(context.call_timeout_s, patience_s=context.patience_s)
        timeout_s = settings.reply_timeout_s
        self._connect = partial(open_device, self._name, address, BAUD, timeout_s, context.relay)
        self._timeout_s = timeout_s
        self._closed = self._in_doubt = False
        self._travel, self._moved_after = Travel(), -1
        self._holds, self._sample, self._sampled_s = 0, -1, -math.inf
        self._reopen()
        try:
            with self._call_time.opening(timeout_s):
                _, model, serial, firmware = self._port.ask("ID?", str).split()
                self.info = DeviceInfo("Heron", model, serial, firmware)
                low_n, high_n, low_mm, high_mm, speed_mm_s, _ = astuple(self.limits)
                written = f"{low_n:g} {high_n:g} {low_mm:g} {high_mm:g} {speed_mm_s:g}"
                self._command(f"LIM {written}", "write the limits")
                if (got := self._port.ask("LIM?", str)) != written:
                    raise self._fault("write the limits", written, got, "check the machine's own limits")
        except BaseException:
            self.close()
            raise

    @one_call
    def read(self) -> LoadFrameState:
        """Return the state. Raise `DeviceFault` if the readings are old, or the load is no number."""
        asked_s = self._clock.now_s()
        status = self._status()
        if status.state != "MOVE" or self._holds != self._moved_after:
            self._travel.end()
        try:
            self._travel.check(status.displacement_mm, asked_s, self._clock.now_s())
        except ValueError as error:
            self._in_doubt = True
            raise self._fault(
                "read", "the confirmed speed", str(error), "hold, and check the motor"
            ) from error
        fault = () if status.fault == "-" else (status.fault.lower(),)
        return LoadFrameState(
            status.load_n,
            status.displacement_mm,
            status.state == "MOVE",
            status.state == "DONE",
            status.state != "MOVE",
            status.sample,
            fault,
            self._clock.now_s(),
        )

    def go_to_load(self, load_n: float, rate_n_s: float) -> None:
        """Refuse the load."""
        step, remedy = f"go to {load_n:g} N", "use motions to a displacement"
        raise self._fault(step, "a displacement, as the load frame has no control of the load", step, remedy)

    @one_call
    def go_to_displacement(self, displacement_mm: float, speed_mm_s: float) -> None:
        """Start a motion. The command is sent once; if its answer is lost, the number of motions tells."""
        step, limits, holds = f"go to {displacement_mm:g} mm", self.limits, self._holds
        if not limits.displacement_min_mm <= displacement_mm <= limits.displacement_max_mm:
            raise self._fault(step, "a target within the limits", step, "correct the protocol")
        if not 0 < speed_mm_s <= limits.speed_max_mm_s:
            raise self._fault(step, "a speed within the limits", f"{speed_mm_s:g} mm/s", "correct it")
        if self._in_doubt:
            raise self._fault(step, "a confirmed hold", "silence before", "hold the load frame first")
        self._travel.end()
        before = self._status().motion
        try:
            go = f"GO {displacement_mm:.4f} {speed_mm_s:.4f}"
            self._command(go, step, lambda: self._refuse_held(step, holds))
        except DeviceTimeout:
            self._in_doubt = self._status().motion == before
            if self._in_doubt:
                raise
        self._moved_after = holds
        self._travel.begin(displacement_mm, speed_mm_s)

    @one_call
    def change_speed(self, speed_mm_s: float) -> None:
        """Change the speed of the present motion. The command is sent once, and the machine confirms it."""
        step, holds, asked_s = f"change the speed to {speed_mm_s:g} mm/s", self._holds, self._clock.now_s()
        if not 0 < speed_mm_s <= self.limits.speed_max_mm_s:
            raise self._fault(step, "a speed within the limits", f"{speed_mm_s:g} mm/s", "correct it")
        in_motion = self._travel.begun and self._holds == self._moved_after and not self._in_doubt
        if not in_motion or self._status().state != "MOVE":
            raise self._fault(step, "a motion to a displacement", "none", "change it in motion only")
        try:
            self._command(f"SPD {speed_mm_s:.6f}", step, lambda: self._refuse_held(step, holds))
        except DeviceTimeout:
            self._in_doubt = True
            raise
        place_mm = self._status().displacement_mm
        self._travel.change(speed_mm_s, place_mm, asked_s, self._clock.now_s())

    @one_call
    def tare(self) -> None:
        """Set load and displacement to zero."""
        self._command("TARE", "tare")

    def hold(self) -> None:
        """Hold at once, and repeat this until the machine confirms it, also on a new connection."""
        self._holds += 1
        stop_until_confirmed(self._name, self._hold_once, self._clock, on_lost=self._reopen)
        self._in_doubt = False

    def close(self) -> None:
        """Release the port. A repeated call has no effect."""
        self._closed = True
        self._port.close()

    def _hold_once(self) -> str:
        return hold_once(self._port, STOP_TIMES.answer_s)

    def _status(self) -> Status:
        try:
            status, now_s = self._port.ask("S?", read_status), self._clock.now_s()
        except (DeviceTimeout, LinkLost):
            self._in_doubt = True
            raise
        if status.sample != self._sample:
            self._sample, self._sampled_s = status.sample, now_s
        if now_s - self._sampled_s > STALE_S:
            raise self._fault("read", "new samples", f"sample {status.sample} again", "restart the machine")
        if not math.isfinite(status.load_n):
            raise self._fault("read", "a load", f"{status.load_n}", "check the load cell and its cable")
        return status

    def _command(self, command: str, step: str, permit=None) -> None:
        answer = self._port.ask(command, str, 1, permit)
        if not answer.startswith("OK"):
            raise self._fault(step, "acceptance", answer, "see the machine's display")

    def _refuse_held(self, step: str, holds: int) -> None:
        """Raise `DeviceFault` just before a command is sent, if a hold was requested since `holds`."""
        if self._holds != holds:
            raise self._fault(step, "no hold meanwhile", "a hold", "command it again if needed")

    def _reopen(self) -> None:
        if hasattr(self, "_port"):
            self._port.close()
        if not self._closed:
            self._port = port_on(self._name, self._connect(), self._timeout_s)
            self._port.call_time = self._call_time

    def _fault(self, step: str, expected: str, got: str, remedy: str) -> DeviceFault:
        return DeviceFault(self._name, step, expected, got, remedy)


def _talk(settings: HeronSettings) -> LineTalk[LinePort]:
    return LineTalk(
        settings.port,
        BAUD,
        b"\n",
        port_on,
        hold_once,
        lambda port, answer_s: port.ask_first("ID?", str, answer_s),
    )


SPEC = DriverSpec("load_frame", HeronSettings, HeronFrame, guard=guard_spec(_talk))
