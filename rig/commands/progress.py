"""The screen of a run, with the moving device, its step, the effect of Ctrl-C, and finished steps."""

import math
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from typing import TYPE_CHECKING, TypeAlias

from dic.shell.bottom_lines import bottom_lines
from dic.shell.console import say
from drivers.clock import SystemClock
from drivers.terminal.keys import Keys
from rig import Engine, EngineStatus, RigReading, State, StepRecord
from rig.commands.acquiring import (
    SummaryLines,
    beside_a_machine,
    how_to_end,
    is_acquiring,
    what_is_taken,
)
from rig.commands.live_view import Panel, RunView
from rig.commands.pause_key import KEY, PauseKey
from rig.engine.devices import Asked
from rig.engine.status import PauseTotals
from rig.limits.by_hand import HandMotion
from rig.news.images_now import ImagesNow

if TYPE_CHECKING:
    from rich.console import Group, RenderableType
    from rich.live import Live

Confirm: TypeAlias = Callable[[HandMotion, RigReading], None]

REFRESHES_PER_S = 4.0
TOLD_EVERY_S = 10.0
"""Shortest time in s between two lines about live gauges, where no terminal shows them."""
BAR_WIDTH = 20
LATE_NEWS_S = 0.5
"""Longest time in s for which a question waits until another thread has printed the finished steps."""
WITHDRAWAL_S = 1.0
"""Longest time in s for which the end of the screen waits until the operator's driver leaves the terminal."""


def what_happens(status: EngineStatus | None) -> str:
    """Return a line, usually of at most 80 characters, that names the moving device and its step."""
    if status is None or status.step is None:
        return "opening the rig; nothing moves"
    if is_acquiring(status) and status.acquisition is not None:
        return what_is_taken(status, status.acquisition)
    step, at = status.step, _values(status.reading)
    if status.load_is_measured:
        return beside_a_machine(status, step, at)
    moves = status.reading is not None and status.reading.moving
    mover = "stage" if step.kind == "rotation" else "load frame"
    match status.state:
        case State.PAUSED:
            return f"PAUSED in {step}: {'the machine MOVES' if moves else 'nothing moves'}, {at}"
        case State.PREPARING if step.question is not None:
            return f"{step}: waiting for the operator, {at}"
        case State.PREPARING if moves and at.endswith("deg"):
            return f"preparing the {step.kind}: the stage MOVES to 0 deg, {at}"
        case State.PREPARING if moves:
            return f"preparing the {step.kind}: waiting until nothing moves, {at}"
        case State.PREPARING:
            return f"preparing the {step.kind}: nothing moves, {at}"
        case State.MOVING if step.target == step.target:
            return f"{step}: the {mover} MOVES, {at}" if moves else f"{step}: the {mover} settles, {at}"
        case State.MOVING:
            return f"{step}: waiting until nothing moves, {at}"
        case State.IMAGING:
            return f"{step}: taking images, {f'{mover} MOVES' if moves else 'nothing moves'}, {at}"
        case State.SAFING:
            return "stopping: the load frame is to hold, the stage is to stop"
    return f"{status.state.value}, {at}"


def how_to_stop(status: EngineStatus | None) -> str:
    """Return a text that says what Ctrl-C does on this rig."""
    units = {} if status is None or status.reading is None else status.reading.by_unit()
    if status is not None and status.load_is_measured:
        units.pop("N", None)
    effects = [effect for unit, effect in _EFFECTS if unit in units]
    return f"Ctrl-C: {', '.join(effects) or 'the run ends'}"


_EFFECTS = (("N", "the load frame holds"), ("deg", "the stage stops"))


class Screen:
    """Draws two lines at the bottom of a terminal, and prints finished steps above them.

    While a phase without interruption goes on, the curves of the gauges and their newest values stand above
    the two lines, or one line in `TOLD_EVERY_S` is printed.

    The engine calls `on_status` and `on_step` on threads of their own, and `on_question` on the operator's
    thread. While a person is asked, nothing else is written on the terminal. If standard error is not a
    terminal, or standard output is a pipe, only the finished steps are printed, on standard output. `live` is
    Rich's display that draws the two lines, or None to draw nothing.
    """

    def __init__(self, late_news_s: float) -> None:
        self._late_news_s = late_news_s
        self.live: Live | None = None
        self._changed = threading.Condition()
        self._status: EngineStatus | None = None
        self._notice = ""
        self._asking = False
        self._steps_printed = 0
        self._held_back: list[str] = []
        self._summaries, self._clock = SummaryLines(), SystemClock()
        self._pause_key: PauseKey | None = None
        self._images: ImagesNow | None = None
        self._first_s, self._told_s = math.nan, -math.inf

    def listen(self, engine: Engine) -> None:
        """Let a key at the terminal pause the run of an engine, if the screen is drawn on a terminal."""
        if self.live is not None:
            self._images = ImagesNow(engine)
        if self.live is not None and Keys().there:
            self._pause_key = PauseKey(engine, self._free)
            self._pause_key.start()

    def on_status(self, status: EngineStatus) -> None:
        """Show a new status of the run on the screen."""
        with self._changed:
            self._status = status
            if math.isnan(self._first_s) and status.reading is not None:
                self._first_s = status.reading.time_s
            if self.live is None and status.live is not None:
                self._tell_now_and_then(status)
            self._changed.notify_all()
        if self._pause_key is not None:
            self._pause_key.tell(paused=status.state is State.PAUSED)

    def _tell_now_and_then(self, status: EngineStatus) -> None:
        if self._clock.now_s() - self._told_s < TOLD_EVERY_S:
            return
        self._told_s = self._clock.now_s()
        self._print(RunView(status, self._running_s).sentence())

    @property
    def _running_s(self) -> float:
        reading = None if self._status is None else self._status.reading
        return math.nan if reading is None else reading.time_s - self._first_s

    def _print(self, line: str) -> None:
        """Print a line, if it has text; during a question after the answer."""
        if line and self._asking:
            self._held_back.append(line)
        elif line:
            say(line)

    def on_step(self, record: StepRecord) -> None:
        """Print a finished step, or now and then one of an acquisition. During a question, print it after the
        answer."""
        if record.step.kind == "reference" and self._images is not None:
            self._images.keep_reference()
        with self._changed:
            self._print(self._line_of(record))
            self._steps_printed += 1
            self._changed.notify_all()

    def _line_of(self, record: StepRecord) -> str:
        if record.step.kind != "acquired":
            return _step_line(record)
        if self._status is not None and self._status.live is not None:
            return ""  # the curves, or the lines instead of them, tell more
        return self._summaries.of(record, self._status, self._clock.now_s())

    @contextmanager
    def on_question(self, _: Asked, notice: str) -> Iterator[None]:
        """Draw nothing until the operator has answered. Print the notice of the operator's driver if it has
        one."""
        if self.live is None and (notice or not sys.stderr.isatty()):
            yield
            return
        with self._changed:
            self._changed.wait_for(self._is_up_to_date, self._late_news_s)
            self._notice = notice
        try:
            if notice:
                yield
                return
            with nullcontext() if self._pause_key is None else self._pause_key.lent(), self._free():
                yield
        finally:
            with self._changed:
                self._notice = ""

    @contextmanager
    def _free(self) -> Iterator[None]:
        """Leave the terminal to a question. Print nothing else until it is answered."""
        with self._changed:
            self._asking = True
            if self.live is not None:
                self.live.stop()
            say(_holding(self._status), err=True)
        try:
            yield
        finally:
            with self._changed:
                self._asking = False
                for line in self._held_back:
                    say(line)
                self._held_back.clear()
                self._changed.notify_all()
                if self.live is not None and not self._ended:
                    self.live.start()

    def leave(self) -> None:
        """Wait until a withdrawn question has ended, so that its output does not mix with the run's last
        lines, and leave the keyboard as it was."""
        if self._pause_key is not None:
            self._pause_key.leave()
        with self._changed:
            self._changed.wait_for(lambda: not self._asking, WITHDRAWAL_S)

    @property
    def _ended(self) -> bool:
        return self._status is not None and self._status.state.ending

    def _is_up_to_date(self) -> bool:
        status = self._status
        return (
            status is not None
            and status.state is State.PREPARING
            and self._steps_printed >= status.steps_done
        )

    def draw(self) -> "RenderableType":
        """Return the lines at the bottom, for Rich."""
        from rich.console import Group
        from rich.progress_bar import ProgressBar
        from rich.table import Table
        from rich.text import Text

        status = self._status
        done, planned = (0, 1) if status is None else (status.steps_finished, status.steps_planned)
        below = Table.grid(padding=(0, 1))
        simulated = "SIMULATED, " if status is not None and status.simulated else ""
        counted = "" if status is None else f"{done} of {planned} steps, "
        pause = "" if self._pause_key is None else f", {KEY}: pause"
        if status is not None and is_acquiring(status) and (now := status.acquisition) is not None:
            done, planned, counted = now.taken, now.planned or max(now.taken, 1), ""
            pause += "" if self._pause_key is None else how_to_end(now)
        below.add_row(
            ProgressBar(planned, done, BAR_WIDTH),
            Text(f"{simulated}{counted}{how_to_stop(status)}{pause}", no_wrap=True, overflow="ellipsis"),
        )
        happens = self._notice or what_happens(status)
        if status is not None and status.live is not None:
            images = {} if self._images is None else self._images.now()
            return Panel(RunView(status, self._running_s, images), [(happens, False)], below)
        return Group(Text(happens, no_wrap=True, overflow="ellipsis"), below)


@contextmanager
def run_screen(late_news_s: float = LATE_NEWS_S) -> Iterator[Screen]:
    """Yield the screen of `rig run`. It draws only if `bottom_lines` may draw."""
    screen = Screen(late_news_s)
    screen.live = live = bottom_lines(screen.draw, REFRESHES_PER_S)
    if live is None:
        yield screen
        return
    live.start()
    try:
        yield screen
    finally:
        screen.leave()
        live.stop()


def _step_line(record: StepRecord) -> str:
    images = ", ".join(f"{count} {name}" for name, (_, count) in record.frames.items())
    # show four decimals, because the noise of every reading is larger than that
    shown = ", ".join(f"{round(value, 4):.6g} {unit}" for unit, value in record.reading.by_unit().items())
    # nothing settles beside a machine that this program does not command
    how = "at" if record.step.timed or record.step.kind == "acquired" else "settled at"
    return f"{record.step}: {how} {shown}; images: {images}"


def _holding(status: EngineStatus | None) -> str:
    """Return the text that names the machines that stand still while a person is asked."""
    units = {} if status is None or status.reading is None else status.reading.by_unit()
    angle = f"the stage stands at {units['deg']:.2f} deg" if "deg" in units else ""
    if status is not None and status.load_is_measured:
        stands = f"; {angle}" if angle else ""
        shows = f", and shows {units['N']:.1f} N" if "N" in units else ""
        return f"The load frame takes no commands{shows}: see for yourself that it stands{stands}."
    load = f"the load frame holds at {units['N']:.1f} N, {units['mm']:.4f} mm" if "N" in units else ""
    return f"Nothing moves: {'; '.join(filter(None, (load, angle))) or 'no reading yet'}."


def _values(reading: RigReading | None) -> str:
    if reading is None:
        return "no reading yet"
    formats = {"N": ".1f", "mm": ".4f", "deg": ".2f"}
    shown = [f"{value:{formats.get(unit, '.5g')}} {unit}" for unit, value in reading.by_unit().items()]
    return "at " + ", ".join(shown)


class HandScreen:
    """Draws one motion by hand at the bottom of a terminal, after it was confirmed.

    `live` is Rich's display that draws the two lines, or None to draw nothing.
    """

    def __init__(self) -> None:
        self.live: Live | None = None
        self._doing = ""
        self._reading: RigReading | None = None

    def on_reading(self, reading: RigReading) -> None:
        """Show a reading at the next refresh."""
        self._reading = reading

    def after(self, confirm: Confirm) -> Confirm:
        """Return a function that asks for the confirmation of a motion, and then shows the motion on the
        screen."""

        def confirm_and_show(motion: HandMotion, reading: RigReading) -> None:
            confirm(motion, reading)
            self._doing = motion.doing
            if self.live is not None:
                self.live.start()

        return confirm_and_show

    def draw(self) -> "Group":
        """Return the two lines, for Rich."""
        from rich.console import Group
        from rich.text import Text

        stops = ", ".join(effect for unit, effect in _EFFECTS if unit in self._units)
        lines = f"MOVES: {self._doing}, {_values(self._reading)}", f"Ctrl-C: {stops}"
        return Group(*(Text(line, no_wrap=True, overflow="ellipsis") for line in lines))

    @property
    def _units(self) -> dict[str, float]:
        return {} if self._reading is None else self._reading.by_unit()


@contextmanager
def hand_screen() -> Iterator[HandScreen]:
    """Yield the screen of `rig unload` and `rig jog`. It draws only if `bottom_lines` may draw."""
    screen = HandScreen()
    screen.live = live = bottom_lines(screen.draw, REFRESHES_PER_S)
    try:
        yield screen
    finally:
        if live is not None and live.is_started:
            live.stop()


def pause_lines(pauses: PauseTotals) -> list[str]:
    """Return a line that tells the pauses of a run and the images that fell into them, or no line."""
    if not pauses.count:
        return []
    times = "once" if pauses.count == 1 else f"{pauses.count} times"
    told = [
        f"{count} {'step' if count == 1 else 'steps'} {fate}"
        for count, fate in ((pauses.late_steps, "imaged late"), (pauses.missed_steps, "without images"))
        if count
    ]
    return [", ".join([f"paused {times} for {pauses.duration_s:.1f} s", *told])]
