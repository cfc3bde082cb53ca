"""Plan and execute the runs of a queue, one after the other, up to the first that is not completed."""

import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from drivers.clock import SystemClock
from drivers.errors import ConfigurationError, DeviceError
from drivers.interfaces import OpenContext
from rig import Outcome, Plan, RigError, plan_protocol, read_rig
from rig.commands.queue_file import QueueJob
from rig.plan import format_bytes

_SPACE_MARGIN = 1.1


@dataclass(frozen=True)
class QueueResult:
    """What became of one run: its status, or "refused" or "not begun"."""

    job: QueueJob
    status: str = "not begun"
    reason: str = ""
    outcome: Outcome | None = None

    @property
    def is_good(self) -> bool:
        """True if the run was completed, no image was late, and no image or sample is missing."""
        return self.outcome is not None and self.outcome.is_good

    def as_dict(self) -> dict[str, Any]:
        """Return the result as a table for JSON."""
        outcome = self.outcome
        return {
            "number": self.job.number,
            "protocol": str(self.job.protocol),
            "rig": str(self.job.rig),
            "run_file": str(self.job.output),
            "status": self.status,
            "reason": self.reason,
            "steps_done": None if outcome is None else outcome.steps_done,
        }

    def line(self) -> str:
        """Return the result as a line of text."""
        return f"{self.job.number}  {self.job.output}: {self.status}" + (
            f", {self.reason}" if self.reason else ""
        )


@dataclass
class Queue:
    """The runs of a queue with their plans.

    `objections` has a sentence for each reason why a run cannot be executed.
    """

    jobs: Sequence[QueueJob]
    plans: list[Plan] = field(default_factory=list)
    objections: list[str] = field(default_factory=list)

    @property
    def duration_s(self) -> float | None:
        """Estimated duration of all runs in s, without the operator's time, or None if it is unknown."""
        known = [plan.duration_s for plan in self.plans]
        return None if None in known else sum(each for each in known if each is not None)

    @property
    def size_bytes(self) -> int | None:
        """Size of all images in bytes, or None if it is unknown."""
        known = [plan.size_bytes for plan in self.plans]
        return None if None in known else sum(each for each in known if each is not None)


def planned(jobs: Sequence[QueueJob]) -> Queue:
    """Plan all runs of a queue before anything moves. No device is opened.

    Raise `ConfigurationError` with the mistakes of all protocols and rig files.
    """
    queue, mistakes = Queue(jobs), []
    for job in jobs:
        try:
            with _protocol_of(job) as path:
                plan = plan_protocol(path, job.rig)
        except ConfigurationError as error:
            mistakes += [f"run {job.number}, {job.protocol}: {mistake}" for mistake in error.mistakes]
            continue
        queue.plans.append(plan)
        queue.objections += [f"run {job.number}, {job.protocol}: {each}" for each in plan.objections]
    if mistakes:
        raise ConfigurationError("the queue", mistakes)
    return queue


def require_places_of(queue: Queue) -> None:
    """Raise `RigError` if the queue has objections, or the files of its runs cannot be written.

    The folders of the run files are made.
    """
    if queue.objections:
        got = f"{len(queue.objections)} objections"
        raise RigError("the queue", "runs within the limits of the rig", got, "; ".join(queue.objections))
    needed: dict[Path, int] = {}
    for job, plan in zip(queue.jobs, queue.plans, strict=True):
        for path in (job.output, job.own_protocol):
            if path != job.protocol and path.exists() and not _has_text(path, job.changed):
                remedy = "move it away, name another folder with -o, or begin with a later run with --from"
                raise RigError(f"run {job.number}", f"a new file {path}", "one that exists", remedy)
        try:
            job.output.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            got, remedy = error.strerror or str(error), "name another folder with -o"
            raise RigError(str(job.output.parent), "a folder for run files", got, remedy) from error
        folder = job.output.parent.resolve()
        needed[folder] = needed.get(folder, 0) + int(_SPACE_MARGIN * (plan.size_bytes or 0))
    for folder, size in needed.items():
        if size > (free := shutil.disk_usage(folder).free):
            expected, remedy = f"{format_bytes(size)} of free space for all runs", "free disk space"
            raise RigError(str(folder), expected, format_bytes(free), remedy)


def execute(
    jobs: Sequence[QueueJob],
    ready: Callable[[QueueJob], None],
    run: Callable[[QueueJob], Outcome],
) -> Iterator[QueueResult]:
    """Execute runs one after the other, and yield what became of each, also of those that did not begin.

    `ready` is called before each run and returns when the operator has mounted the specimen. A run that is
    refused, aborted or failed, or that lacks images or samples, ends the queue.
    """
    left = list(jobs)
    while left:
        job = left.pop(0)
        try:
            ready(job)
            if job.changed:
                job.own_protocol.write_text(job.changed, encoding="utf-8")
            outcome = run(job)
        except (RigError, DeviceError, ConfigurationError, OSError) as error:
            yield QueueResult(job, "refused", str(error))
            break
        except KeyboardInterrupt:
            yield QueueResult(job, "refused", "the operator ended the queue")
            break
        reason = "; ".join(filter(None, (outcome.reason, *outcome.shortfalls)))
        yield QueueResult(job, outcome.status, reason, outcome)
        if not outcome.is_good:
            break
    yield from (QueueResult(job) for job in left)


def ask_operator(job: QueueJob, tell: Callable[[str], None]) -> None:
    """Ask the operator of a rig to mount a specimen, and wait for the word. No other device is open.

    So the machine can be moved by hand meanwhile, also with `rig unload`. On a virtual rig, whose specimen is
    a new one in each run, only tell what would be asked. Raise `RigError` if the operator cannot be asked,
    and `DeviceError` if the operator refuses.
    """
    rig_file = read_rig(job.rig)
    if rig_file.simulation is not None:
        tell(f"simulated operator: {job.question.text}")
        return
    entry = rig_file.operator
    operator = entry.spec.open(entry.settings, OpenContext(entry.name, SystemClock()))
    try:
        if not hasattr(operator, "ask"):
            remedy = 'use driver = "console-operator", or confirm beforehand with --yes'
            raise RigError("the queue", "an [operator] who can be asked", "one that cannot", remedy)
        if (notice := getattr(operator, "notice", None)) is not None:
            tell(notice(job.question))
        operator.ask(job.question)
    finally:
        with suppress(DeviceError):
            if hasattr(operator, "close"):
                operator.close()


def _has_text(path: Path, text: str) -> bool:
    """Return True if a file is the protocol that an earlier try of the same run has left."""
    return bool(text) and path.suffix == ".toml" and path.read_bytes() == text.encode()


@contextmanager
def _protocol_of(job: QueueJob) -> Iterator[Path]:
    """Yield the protocol of a run, as a temporary file if the queue changes it."""
    if not job.changed:
        yield job.protocol
        return
    with TemporaryDirectory(prefix="offaxis-queue-") as folder:
        path = Path(folder) / job.protocol.name
        path.write_text(job.changed, encoding="utf-8")
        yield path
