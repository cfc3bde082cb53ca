"""What the screen says while images are taken at times or events."""

import math

from rig import EngineStatus, RigReading, State, StepRecord
from rig.engine.timing import TimingNow
from rig.protocol.step import ProtocolStep
from rig.samples import DISPLACEMENT, GAUGE_PREFIX, LOAD

SUMMARY_S = 10.0
"""Shortest time in s between two printed lines about the images of an acquisition."""
_SHOWN = 4


def is_acquiring(status: EngineStatus) -> bool:
    """Return True while images are taken at times or events, also in a pause."""
    step = status.step
    running = status.state in (State.IMAGING, State.PAUSED)
    return running and status.acquisition is not None and step is not None and step.acquisition is not None


def what_is_taken(status: EngineStatus, now: TimingNow) -> str:
    """Return a line with the numbers of images, the rates, and the newest values of the channels."""
    paused = "PAUSED: " if status.state is State.PAUSED else ""
    paused += _what_moves(status)
    values = channel_values(status.reading)
    if now.waits_for:
        return f"{paused}waiting for {now.waits_for}{values}"
    return f"{paused}{counts(now)}{values}"


def _what_moves(status: EngineStatus) -> str:
    """Return what a machine does that takes commands; nothing is claimed of another one."""
    units = {} if status.reading is None else status.reading.by_unit()
    if status.load_is_measured or status.reading is None:
        return ""
    if status.reading.moving:
        return "the load frame MOVES, " if "N" in units else "the stage MOVES, "
    return "nothing moves, " if status.state is State.PAUSED and "N" in units else ""


def beside_a_machine(status: EngineStatus, step: ProtocolStep, at: str) -> str:
    """Return a line about a step beside a machine that takes no commands, of which it claims nothing."""
    moves = ", the stage MOVES" if status.reading is not None and status.reading.moving else ""
    match status.state:
        case State.PAUSED:
            return f"PAUSED in {step}: the images wait{moves}, {at}"
        case State.PREPARING if step.question is not None:
            return f"{step}: waiting for the operator{moves}, {at}"
        case State.PREPARING:
            return f"preparing the {step.kind}{moves}, {at}"
        case State.MOVING:
            return f"{step}: waiting for its images{moves}, {at}"
        case State.IMAGING:
            return f"{step}: taking images{moves}, {at}"
        case State.SAFING:
            return "stopping the run; the load frame takes no commands"
    return f"{status.state.value}, {at}"


def counts(now: TimingNow) -> str:
    """Return the number of images, how many are off their times or missing, and the rates."""
    said = f"{now.taken} of {now.planned} images" if now.planned else f"{now.taken} images"
    if now.late or now.missing:
        said += f", {now.late} LATE, {now.missing} MISSING"
    if not math.isnan(now.interval_s):
        reached = "" if math.isnan(now.reached_s) else f" ({now.reached_s:.3g} s reached)"
        said += f", every {now.interval_s:g} s{reached}"
    return said


def channel_values(reading: RigReading | None) -> str:
    """Return the newest values of the first channels with their units, without the gauges."""
    every = {} if reading is None else reading.signals
    signals = {name: each for name, each in every.items() if not name.startswith(GAUGE_PREFIX)}
    # Load and displacement of a load frame have a place of their own.
    shown_signals = [(name, each) for name, each in signals.items() if name not in (LOAD, DISPLACEMENT)]
    shown = [f"{name} {each.newest:.5g} {each.unit}" for name, each in shown_signals[:_SHOWN]]
    return "".join(f", {text}" for text in shown)


def how_to_end(now: TimingNow) -> str:
    """Return the keys of an acquisition."""
    return ", i: image, ee: end images" if now.on_request else ", ee: end images"


class SummaryLines:
    """Prints a line about the images of an acquisition now and then, and not one for each image."""

    def __init__(self) -> None:
        self._told_s = -math.inf

    def of(self, record: StepRecord, status: EngineStatus | None, now_s: float) -> str:
        """Return the line to print after a step, or an empty text. `now_s` is a time of the real clock."""
        if now_s - self._told_s < SUMMARY_S:
            return ""
        self._told_s = now_s
        now = None if status is None else status.acquisition
        if now is None:
            return str(record.step)
        return f"{record.step}: {counts(now)}{channel_values(None if status is None else status.reading)}"
