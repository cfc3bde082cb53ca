"""Try every fault at every moment of a run, and tabulate how each run ends.

python -m tests.engine_matrix.matrix            prints the table
python -m tests.engine_matrix.matrix --write    writes the table into docs/engine-matrix.md
"""

import multiprocessing
import random
import sys
from concurrent.futures import ProcessPoolExecutor

from tests.engine_matrix.cells import NEVER_STRUCK, Cell, try_cell
from tests.engine_matrix.faults import FAULTS
from tests.engine_matrix.runs import MOMENTS
from tests.places import DOCS

DOCUMENT = DOCS / "engine-matrix.md"
HEADING = "## The table\n"
AT_A_TIME = 8
"""Number of simultaneous runs. A run with a silent line mostly waits for answers in real time.

With more runs on two processors, answers may come too late.
"""

Place = tuple[int, int]
"""A cell of the matrix: the index of a fault and the index of a moment."""


def places() -> list[Place]:
    """Return all cells: every fault at every moment at which the rig can have it."""
    return [
        (row, column)
        for row, fault in enumerate(FAULTS)
        for column, moment in enumerate(MOMENTS)
        if fault.can_strike(moment)
    ]


def try_all(cells: list[Place]) -> dict[Place, Cell]:
    """Try the given cells, several at the same time, and return the results in the given order."""
    # Neighbouring cells wait at the same times. In random order, some cells compute while others wait for
    # answers.
    order = random.Random(0).sample(cells, len(cells))
    # The cells that take longest begin first, so that no other cell waits for their end.
    order.sort(key=lambda place: not FAULTS[place[0]].only)
    context = multiprocessing.get_context("forkserver")
    # the server imports everything once, and each process begins as a copy of it
    context.set_forkserver_preload(["tests.engine_matrix.preloaded"])
    with ProcessPoolExecutor(AT_A_TIME, context) as pool:
        tried = dict(zip(order, pool.map(_try, order), strict=True))
    # An answer that a busy computer gave too late ended the run before its fault: it says nothing yet.
    for place in (place for place in cells if NEVER_STRUCK in tried[place].broken):
        tried[place] = _try(place)
    return {place: tried[place] for place in cells}


def _try(place: Place) -> Cell:
    return try_cell(MOMENTS[place[1]], FAULTS[place[0]])


def table(cells: dict[Place, Cell]) -> str:
    """Return the Markdown table, with a row for each fault and a column for each moment."""
    heads = [f"{moment.kind}: {moment.state}" for moment in MOMENTS]
    lines = ["| fault | " + " | ".join(heads) + " |", "| --- " * (len(heads) + 1) + "|"]
    for row, fault in enumerate(FAULTS):
        found = [cells.get((row, column), "") for column in range(len(MOMENTS))]
        lines.append(f"| `{fault.name}` | " + " | ".join(map(str, found)) + " |")
    return "\n".join(lines)


def documented() -> str:
    """Return the table in docs/engine-matrix.md."""
    return DOCUMENT.read_text(encoding="utf-8").partition(HEADING)[2].strip()


def broken(cells: dict[Place, Cell]) -> list[str]:
    """Return one sentence for each promise that was not kept."""
    return [
        f"{FAULTS[row].name} while {MOMENTS[column].state} ({MOMENTS[column].kind}): {mistake}"
        for (row, column), cell in cells.items()
        for mistake in cell.broken
    ]


def main() -> None:
    """Try all cells, and print or write the table."""
    cells = try_all(places())
    if "--write" in sys.argv:
        before, heading, _ = DOCUMENT.read_text(encoding="utf-8").partition(HEADING)
        DOCUMENT.write_text(f"{before}{heading}\n{table(cells)}\n", "utf-8")
    else:
        print(table(cells))
    for sentence in broken(cells):
        print(sentence, file=sys.stderr)
    sys.exit(bool(broken(cells)))


if __name__ == "__main__":
    main()
