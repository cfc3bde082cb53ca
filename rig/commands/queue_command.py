"""The command `rig queue`: several runs one after the other, with the operator's word before each."""

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dic.shell.console import say
from dic.shell.output_paths import FORCE, require_places
from rig.commands.output import JSON, PATH, finish

if TYPE_CHECKING:
    from rig import Outcome
    from rig.commands.queue import Queue
    from rig.commands.queue_file import QueueJob


@click.command()
@click.argument("files", metavar="FILE...", type=PATH, nargs=-1, required=True)
@click.option("--rig", "rig_path", type=PATH, help="The rig file, for all runs.")
@click.option("-o", "--output", type=PATH, help="Folder of the run files, for all runs.")
@click.option(
    "--from", "first", type=click.IntRange(1), default=1, metavar="NUMBER", help="Begin with this run."
)
@click.option("--plan", "only_plan", is_flag=True, help="Print the plan of all runs. No device is opened.")
@click.option("--yes", is_flag=True, help="Do not ask the operator before a run.")
@JSON
@FORCE
def queue(
    files: tuple[Path, ...],
    rig_path: Path | None,
    output: Path | None,
    first: int,
    only_plan: bool,
    yes: bool,
    json_path: Path | None,
    force: bool,
) -> None:
    """Execute runs one after the other, up to the first that is not completed.

    FILE is a protocol, or a TOML file with a table [[runs]] for each run (docs/operating.md). Before each run
    the operator mounts the specimen and types a word. All files are checked before the first run.
    """
    from rig.commands.queue import ask_operator, execute, planned, require_places_of
    from rig.commands.queue_file import read_jobs
    from rig.commands.running import end_lines, run_on_screen

    jobs = read_jobs(files, rig_path, output)
    require_places([*files, *(job.rig for job in jobs)], [json_path], force=force)
    if first > len(jobs):
        raise click.UsageError(f"--from {first} is beyond the {len(jobs)} runs of the queue.")
    made = planned(jobs[first - 1 :])
    if only_plan:
        finish(_plan_lines(made), _plan_dict(made), json_path, good=not made.objections)
        return
    require_places_of(made)

    def ready(job: "QueueJob") -> None:
        say(f"run {job.number} of {len(jobs)}: {job.protocol} -> {job.output}")
        if yes:
            say(job.question.text)
        else:
            ask_operator(job, say)

    def run(job: "QueueJob") -> "Outcome":
        with ExitStack() as ending:
            outcome = run_on_screen(job.own_protocol, job.rig, job.output, ending)
            for line in end_lines(job.output, outcome):
                say(line)
        return outcome

    results = list(execute(made.jobs, ready, run))
    completed = sum(result.is_good for result in results)
    table = {"completed": completed, "runs": [result.as_dict() for result in results]}
    lines = [result.line() for result in results]
    lines.append(f"{completed} of {len(results)} runs completed")
    begun = all(result.status != "refused" for result in results)
    finish(lines, table, json_path, good=completed == len(results), done=begun)


def _plan_lines(made: "Queue") -> list[str]:
    from rig.commands.plan import format_s, images_text

    lines = []
    for job, plan in zip(made.jobs, made.plans, strict=True):
        lines.append(f"{job.number}  {plan.title} ({job.protocol}) -> {job.output}")
        lines.append(f"   {len(plan.steps)} steps, about {format_s(plan.duration_s)}; {images_text(plan)}")
        lines.append(f'   before it: "{job.question.text}", word {job.question.word}')
    lines.append(
        f"{len(made.plans)} runs, about {format_s(made.duration_s)} without the operator's time, "
        + ("size unknown" if made.size_bytes is None else f"{made.size_bytes / 1e9:.1f} GB")
    )
    return lines + [f"not on this rig: {objection}" for objection in made.objections]


def _plan_dict(made: "Queue") -> dict[str, Any]:
    from rig.commands.plan import plan_dict

    runs = [
        {
            "number": job.number,
            "protocol": str(job.protocol),
            "rig": str(job.rig),
            "run_file": str(job.output),
            "question": vars(job.question),
            "plan": plan_dict(plan),
        }
        for job, plan in zip(made.jobs, made.plans, strict=True)
    ]
    return {
        "runs": runs,
        "duration_s": made.duration_s,
        "size_bytes": made.size_bytes,
        "objections": made.objections,
    }
