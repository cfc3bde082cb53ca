"""One cell of the matrix: a run with a fault at a given moment, and checks of the run's promises."""

import resource
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from dic.runfile.reader import RunFile
from rig.engine.status import Outcome
from tests.engine_matrix.faults import RunFault
from tests.engine_matrix.runs import Moment, Run, run_at

WATCHDOG_S = 3.0
"""Time in s, with a margin, after which the watchdog holds a load frame that is not read any more."""
NEVER_STRUCK = "the fault never struck"
LONGEST_S = 240.0
"""Longest simulated time of a run in s, which is eight times that of a run without a fault."""


@dataclass
class Cell:
    """The result of a run: its status and reason, and one sentence for each broken promise."""

    status: str = ""
    reason: str = ""
    unsafe: tuple[str, ...] = ()
    broken: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        sign = {"completed": "✓", "failed": "F", "aborted": "A", "raised": "R"}[self.status]
        return sign + ("!" if self.unsafe else "")


def try_cell(moment: Moment, fault: RunFault) -> Cell:
    """Run a protocol with one fault at one moment, and return the result."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    cell = Cell()
    with tempfile.TemporaryDirectory() as folder:
        try:
            with run_at(moment, Path(folder), fault.strike) as (run, execute):
                outcome = _outcome(execute, cell)
                resource.setrlimit(resource.RLIMIT_FSIZE, limits)
                run.virtual.faults.clear()
                _check_machine(run, cell)
                _check_end(run, fault, outcome, cell)
                run.interfere.clear()
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        _check_file(run, outcome, cell)
    return cell


def _outcome(execute: Callable[[], Outcome], cell: Cell) -> Outcome | None:
    try:
        outcome = execute()
    except ValueError as error:
        # a mistake in a driver is raised again when the rig is safe, with the unsafe devices as a note
        cell.status, cell.reason = "raised", str(error)
        cell.unsafe = tuple(getattr(error, "__notes__", ()))
        return None
    cell.status, cell.reason, cell.unsafe = outcome.status, outcome.reason, outcome.unsafe
    return outcome


def _check_machine(run: Run, cell: Cell) -> None:
    """Check by the true state of the simulated devices that nothing moves, and check the run's duration."""
    clock, frame, stage = run.virtual.clock, run.virtual.load_frame, run.virtual.stage
    if cell.unsafe:
        clock.sleep(WATCHDOG_S)
    before = frame.displacement_mm(), stage.angle_deg()
    clock.sleep(0.5)
    after = frame.displacement_mm(), stage.angle_deg()
    names = ("load_frame", "stage")
    for name, was, now in zip(names, before, after, strict=True):
        # A stage has no watchdog. If it could not be stopped, the outcome must say so.
        told = name == "stage" and any("stage" in sentence for sentence in cell.unsafe)
        if abs(now - was) > 1e-6 and not told:
            cell.broken.append(f"{name} still moves after the run")
    if clock.now_s() > LONGEST_S:
        cell.broken.append(f"took {clock.now_s():.0f} s")


def _check_end(run: Run, fault: RunFault, outcome: Outcome | None, cell: Cell) -> None:
    if not run.struck:
        cell.broken.append(NEVER_STRUCK)
    if fault.ends and cell.status == "completed":
        cell.broken.append("completed in spite of the fault")
    if fault.borne and cell.status != ("aborted" if run.moment.aborted else "completed"):
        cell.broken.append(f"{cell.status} because of a fault that loses nothing: {cell.reason}")
    if outcome is None:
        return
    if (cell.status == "completed") == bool(cell.reason):
        cell.broken.append(f"{cell.status} with the reason {cell.reason!r}")
    if cell.status != "completed" and ("expected" not in cell.reason or "\n" in cell.reason):
        cell.broken.append(f"no sentence: {cell.reason!r}")
    if cell.unsafe and "emergency stop" not in cell.reason:
        cell.broken.append(f"unsafe without a call for the emergency stop: {cell.reason!r}")


def _check_file(run: Run, outcome: Outcome | None, cell: Cell) -> None:
    """Check that every acknowledged step is in the run file with all its images."""
    with RunFile(run.path) as file:
        steps = file.steps
        if outcome is not None and len(steps) != outcome.steps_done:
            cell.broken.append(f"{len(steps)} steps on file, {outcome.steps_done} acknowledged")
        for step in steps:
            for camera in run.rig.cameras:
                if file.image(camera, step).shape != (32, 32):
                    cell.broken.append(f"{step}: no image of {camera}")
