"""`rig run` that tells each step on the disk in a file beside the run file; `test_killed_pulls` kills it.

A line has the step's number, kind and time, and for each camera the row of its first image and their number.
"""

import os
import sys
from pathlib import Path

from rig.recorder import StepRecord
from rig.run import run_protocol


def told_path(path: Path) -> Path:
    """Return the path of the file with the acknowledged steps of a run."""
    return path.with_suffix(".told")


def main() -> None:
    """Execute the run of the command line, which is that of `rig run`."""
    _, _, protocol, _, rig, _, run = sys.argv
    told = os.open(told_path(Path(run)), os.O_WRONLY | os.O_CREAT | os.O_TRUNC)

    def on_step(record: StepRecord) -> None:
        step = record.step
        rows = [f"{name}:{first}:{count}" for name, (first, count) in record.frames.items()]
        line = f"{step.index} {step.kind} {record.reading.time_s!r} {' '.join(rows)}\n"
        # One write of a few bytes: the file has it whole or not at all.
        os.write(told, line.encode())

    outcome = run_protocol(protocol, rig, run, on_step=[on_step])
    sys.stderr.write(f"{outcome.status}: {outcome.reason}\n")


if __name__ == "__main__":
    main()
