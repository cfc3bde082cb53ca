"""Execute one run with its screen, and print how it ended: for `rig run` and `rig queue`."""

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dic.shell.console import say
from rig.commands.at_rest import at_rest_dict, at_rest_line
from rig.commands.continuing import say_where_it_stands
from rig.commands.progress import pause_lines, run_screen
from rig.threads import dying_of_signals

if TYPE_CHECKING:
    from rig import Outcome


def run_on_screen(
    protocol: Path,
    rig_path: Path,
    run_path: Path,
    ending: ExitStack,
    *,
    continues: Path | None = None,
    notify: str | None = None,
    http: int | None = None,
) -> "Outcome":
    """Execute a run and draw its progress.

    After the run, `ending` lets a signal kill the program, because all devices are closed then, and output to
    the terminal may hang.
    """
    from rig import NewsOptions, run_protocol

    with run_screen() as screen:
        news = NewsOptions(
            notify,
            http,
            lambda line: say(f"rig: {line}", err=True),
            on_continue=say_where_it_stands,
            on_begin=screen.listen,
        )
        try:
            return run_protocol(
                protocol,
                rig_path,
                run_path,
                on_status=[screen.on_status],
                on_step=[screen.on_step],
                on_question=screen.on_question,
                continues=continues,
                news=news,
            )
        finally:
            ending.enter_context(dying_of_signals())


def end_lines(run_path: Path, outcome: "Outcome") -> list[str]:
    """Return the last lines of a run, and print on standard error what was wrong."""
    whole = outcome.recorded and run_path.is_file()
    place = f"in {run_path}" if whole else "were finished; the reason above says where their data are"
    for sentence in filter(None, (outcome.reason, *outcome.lost_devices, *outcome.lost_listeners)):
        say(f"rig: {sentence}", err=True)
    kept = [] if outcome.timing is None or outcome.timing.is_late else outcome.timing.sentences()
    for sentence in (*kept, *outcome.shortfalls):
        say(f"rig: {sentence}", err=True)
    done = f"{outcome.status}: {outcome.steps_done} steps {place}"
    return [done, *pause_lines(outcome.pauses), at_rest_line(outcome.at_end)]


def run_dict(run_path: Path, outcome: "Outcome") -> dict[str, Any]:
    """Return how a run ended, as a table for JSON."""
    steps = [
        {
            "index": record.step.index,
            "kind": record.step.kind,
            "target": record.step.target if record.step.target == record.step.target else None,
            "load_n": record.reading.by_unit().get("N"),
            "displacement_mm": record.reading.by_unit().get("mm"),
            "angle_deg": record.reading.by_unit().get("deg"),
            "time_s": record.reading.time_s,
            "images": {name: count for name, (_, count) in record.frames.items()},
        }
        for record in outcome.steps
    ]
    return {
        "run_file": str(run_path),
        "status": outcome.status,
        "timing": None if outcome.timing is None else outcome.timing.as_dict(),
        "lost_samples": dict(outcome.lost_samples),
        "shortfalls": outcome.shortfalls,
        "reason": outcome.reason,
        "unsafe": list(outcome.unsafe),
        "lost_devices": list(outcome.lost_devices),
        "lost_listeners": list(outcome.lost_listeners),
        "at_end": at_rest_dict(outcome.at_end),
        "pauses": vars(outcome.pauses),
        "steps": steps,
    }
