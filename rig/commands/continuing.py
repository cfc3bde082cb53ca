"""Output of `rig run --continue`, and the name of the new run file."""

import re
from pathlib import Path

from dic.shell.console import say
from rig.protocol.step import RigReading
from rig.resume import FinishedPart


def next_segment(path: Path) -> Path:
    """Return the name of the run file that continues a run: run-2.h5 after run.h5, run-3.h5 after
    run-2.h5."""
    found = re.fullmatch(r"(.*)-(\d+)", path.stem)
    stem, number = (found[1], int(found[2])) if found else (path.stem, 1)
    return path.with_name(f"{stem}-{number + 1}{path.suffix}")


def say_where_it_stands(earlier: FinishedPart, start: RigReading) -> None:
    """Before the operator is asked, print load and displacement at the end of the earlier run and now."""
    say(f"going on with {earlier.path} at {earlier.next}")
    say(f"it ended at {_shown(earlier.end)}; the machine stands at {_shown(start)}")


def _shown(reading: RigReading) -> str:
    return ", ".join(f"{value:.5g} {unit}" for unit, value in reading.by_unit().items()) or "no reading"
