"""Look at a rig and move it by hand, for `rig status`, `rig hold`, `rig unload` and `rig jog`."""

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from drivers.clock import SystemClock
from drivers.terminal.question import Question, Withdrawn
from rig import AtRest, Rig, RigError, RigReading, open_rig, read_rig
from rig.commands.hand_plan import Wish, plan, slowed
from rig.commands.measured import channels_of_load, takes_no_commands, with_measured
from rig.engine.calls import Calls
from rig.engine.devices import called
from rig.engine.look import look
from rig.engine.manual import Manual, Moved
from rig.engine.signals import aborting_on_signals
from rig.facts import facts_of_file
from rig.guardian.announced import guarded_rig
from rig.guardian.lock import MachineInUse, machines_locked
from rig.limits.by_hand import HandMotion
from rig.rigfile import RigFile

RELEASE_S = 60.0
"""Longest time in s for which a hold waits until a run that was asked to end has closed its file."""
RELEASE_POLL_S = 0.05


@dataclass(frozen=True)
class Seen:
    """The result of `rig status`: states of devices, failed devices, and the program that uses the rig."""

    at_rest: AtRest
    in_use: str = ""


def see(rig_path: Path) -> Seen:
    """Read the load frame and the stage once. If another program uses the rig, no device is opened."""
    rig_file = read_rig(rig_path)
    failed: dict[str, str] = {}
    try:
        with machines_locked(rig_file), open_rig(_machines_of(rig_file), failed=failed) as rig:
            calls = Calls(rig.clock, lambda: None, rig.lost)
            with rig.clock.activity():
                at_rest = with_measured(look(called(rig, calls), calls), rig, calls)
                calls.close()
    except MachineInUse as error:
        return Seen(AtRest(), f"{error.step} is in use by {error.got}")
    # The channels that are opened here are the load frame's.
    silent = {"load_frame" if name.startswith("channels.") else name: why for name, why in failed.items()}
    return Seen(replace(at_rest, silent=at_rest.silent | silent))


def hold(rig_path: Path, say: Callable[[str], None] = lambda _: None) -> Moved:
    """Hold the load frame and stop the stage, without asking the user first.

    A run or a motion by hand that has the machine is asked to end, which stops the machine at once. When it
    has released the machine, the hold is commanded and confirmed once more.

    `say` gets the sentence that another program was asked to end, or that the load frame takes no commands.
    Raise `MachineInUse` if the other program cannot be asked, or does not release the machine in time, and
    `RigError` if nothing of the rig takes commands.
    """
    rig_file = read_rig(rig_path)
    if (refusal := takes_no_commands(rig_file, "holding the load frame")) is not None:
        if rig_file.stage is None:
            raise refusal
        say(str(refusal))
    clock = SystemClock()
    asked = 0
    end_s = clock.now_s() + RELEASE_S
    while True:
        try:
            return _hold(rig_file)
        except MachineInUse as error:
            if not asked:
                asked = _ask_to_end(error)
                say(f"{error.got}: asked to end, which holds the load frame and stops the stage")
            elif clock.now_s() > end_s:
                raise MachineInUse(
                    error.step,
                    f"a machine that is released within {RELEASE_S:g} s after pid {asked} was asked to end",
                    error.got,
                    "in danger press the emergency stop; otherwise give the command again",
                ) from error
        clock.sleep(RELEASE_POLL_S)


def _ask_to_end(error: MachineInUse) -> int:
    """Ask the program that has a machine to end, and return the number of its process."""
    try:
        if not error.pid:
            raise ProcessLookupError
        os.kill(error.pid, signal.SIGTERM)
    except OSError as refused:
        raise MachineInUse(
            error.step,
            error.expected,
            error.got,
            "press Ctrl-C in that program, or end it with kill: its end holds the load frame and stops the "
            "stage; in danger press the emergency stop",
        ) from refused
    return error.pid


def _hold(rig_file: RigFile) -> Moved:
    failed: dict[str, str] = {}
    with machines_locked(rig_file), open_rig(_machines_of(rig_file), failed=failed) as rig:
        moved = Manual(rig).hold()
    if not failed:
        return moved
    reason = f"SAFE STATE NOT CONFIRMED, use the emergency stop ({'; '.join(failed.values())})."
    at_end = replace(moved.at_end, silent=moved.at_end.silent | failed)
    return Moved("failed", f"{reason} {moved.reason}".strip(), tuple(failed.values()), at_end)


def move(
    rig_path: Path,
    wish: Wish,
    confirm: Callable[[HandMotion, RigReading], None],
    on_reading: Callable[[RigReading], None] = lambda _: None,
) -> Moved:
    """Execute one motion by hand. A signal, for example by Ctrl-C, stops the motion at once.

    Raise `RigError`, `DeviceError` or `ConfigurationError` if the rig cannot be opened, or lacks the device.
    Nothing has moved before such an error.
    """
    rig_file = slowed(_without_cameras(read_rig(rig_path)), wish)
    if wish.axis != "angle" and (refusal := takes_no_commands(rig_file, f"moving the {wish.axis}")):
        raise refusal
    facts = facts_of_file(rig_file)
    log = Path(f"{rig_path.stem}.guardian.log")
    with guarded_rig(rig_file, log) as (rig, guardian):
        _require_device(rig, wish.axis)
        manual = Manual(rig, on_reading=on_reading, on_progress=guardian.progress)
        with aborting_on_signals(manual), guardian.watched(manual.abort):
            moved = manual.move(lambda reading: plan(wish, reading, rig, facts), confirm)
        if not moved.unsafe:
            guardian.done()
    return moved


@contextmanager
def confirmation(yes: bool, word: str) -> Iterator[Callable[[HandMotion, RigReading], None]]:
    """Yield a function that asks the user to confirm a motion by a word. With ``--yes``, it asks nothing."""
    asked: list[Question] = []

    def confirm(motion: HandMotion, reading: RigReading) -> None:
        if yes:
            return
        now = ", ".join(f"{value:.6g} {unit}" for unit, value in reading.by_unit().items())
        text = (
            f"Now at {now}.\nThe machine will {motion.doing}, in about {motion.duration_s:.0f} s; "
            "Ctrl-C stops it."
        )
        question = Question(text, word, "Ctrl-C to leave all as it is", request="to begin")
        asked.append(question)
        try:
            question.ask()
        except (EOFError, Withdrawn):
            raise RigError(
                motion.doing,
                f'the word "{word}"',
                "no answer",
                "answer on a terminal, or confirm beforehand with --yes",
            ) from None
        finally:
            question.close()

    try:
        yield confirm
    finally:
        for question in asked:
            question.withdraw()


def _require_device(rig: Rig, axis: str) -> None:
    device = "stage" if axis == "angle" else "load_frame"
    if getattr(rig, device) is None:
        raise RigError(
            f"moving the {axis}",
            f"a [{device}] in the rig file",
            "none",
            f"name the rig file of a rig that has a {device.replace('_', ' ')}",
        )


def _without_cameras(rig_file: RigFile) -> RigFile:
    """Return the rig without what only measures, so that a specimen can be unloaded although a camera fails.

    Output lines are left out too, because a motion by hand is no test that another program should record.
    """
    return replace(rig_file, cameras={}, channels={}, triggers={})


def _machines_of(rig_file: RigFile) -> RigFile:
    """Return the rig with only stage and load frame, so that a failed interlock does not prevent a hold.

    The channels of a load frame that is only read belong to it.
    """
    return channels_of_load(replace(rig_file, cameras={}, interlocks={}, triggers={}))
