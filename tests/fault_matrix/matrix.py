"""Try every fault with every driver; tabulate the result of each call, and how the driver recovers.

python -m tests.fault_matrix.matrix            prints the table
python -m tests.fault_matrix.matrix --write    writes it into docs/fault-matrix.md
"""

import multiprocessing
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import partial

from drivers.errors import DeviceError, DeviceFault, DeviceTimeout, LinkLost
from simulators.wire.faults import CAMERA, CLOSED_MACHINE, DAQ, FAULTS, INSTRUMENT, INTERLOCK, MQTT, Fault
from tests.fault_matrix.bench import Bench, ReportedFault, UnprovenError, WrongAnswerError
from tests.fault_matrix.columns import COLUMNS, SPEED, Column
from tests.open_lines import open_lines
from tests.places import DOCS

DOCUMENT = DOCS / "fault-matrix.md"
HEADING = "## The tables\n"
IN_MOTION = {"reset", "stall", "limit", "e-stop", "broken-specimen", "frozen-counter"}
"""Faults that are switched on while the device moves; all other faults while it stands still."""
_TALK = {"read", "move", "change", "travel", "open"}
_ONCE = {*_TALK, "sample", "pulse"}
"""`sample` and `pulse` repeat a request within one call, so that a late answer to it may be used."""
MUST_FAIL = {
    "lose-request": {*_ONCE, "stop"},
    "drop": {*_ONCE, "stop", "image", "stream"},
    "drop:1": {"stream"},
    "corrupt": {*_ONCE, "stop", "image", "stream"},
    "corrupt:1": {"stream"},
    "stale": {*_TALK, "image", "stream"},
    "stale:1": {"stream"},
    "late": _TALK,
    "wrong-unit": _ONCE,
    "exception:6": {*_ONCE, "stop"},
    "reject:STATUSBUSY": {*_TALK, "stop"},
    "error:115": {"move", "open"},
    "unplug": {*_ONCE, "stop", "image", "stream", "line"},
    "broken-sensor": {"sample"},
    "overflow": {"sample"},
    "reset": {"read", "move", "change", "travel"},
    "stall": {"read", "travel", "sample", "image", "stream"},
    "limit": {"read", "change", "travel"},
    "e-stop": {"read", "move", "change", "travel"},
    "nan-load": _TALK,
    "frozen-counter": {"read", "move", "travel"},
    "stuck-speed": {"travel"},
    "watchdog-off": {"move", "change", "open"},
}
"""For each fault the calls that must not succeed. Other calls may succeed if their results are true."""
LIES = {"zero-load", "tenth-load", "reversed-load", "stuck-load", "drifting-load"}
"""Faults that no driver can notice, because the readings look good; the engine detects them."""
MUST_WORK = {"split:1", "split", "delay", "duplicate:1", "duplicate"}
"""Faults with which every call of a driver must succeed, because nothing is lost or late."""
AT_A_TIME = 7
_OWN_TABLE = (SPEED, INTERLOCK, CLOSED_MACHINE, DAQ, INSTRUMENT, MQTT, CAMERA)
DEADLINE_S = 5.0
"""A longer call counts as hanging. The longest calls take a few reply times, or a stop's deadline."""
SIGNS = {DeviceTimeout: "T", LinkLost: "L", DeviceFault: "F", DeviceError: "E"}


@dataclass
class Cell:
    """The results of one cell.

    Attributes
    ----------
    outcomes : dict of str to str
        For each use: ``ok``, T, L or F for the kind of error, or S for a good reading that reports a fault.
    messages : dict of str to str
        The error message of each use.
    way_back : str
        The action that was necessary to continue; empty if none was necessary.
    broken : list of str
        One sentence for each broken promise.
    """

    outcomes: dict[str, str] = field(default_factory=dict)
    messages: dict[str, str] = field(default_factory=dict)
    way_back: str = ""
    broken: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        told = ", ".join(f"{use} {outcome}" for use, outcome in self.outcomes.items()).replace("ok", "✓")
        return f"{told} → {self.way_back or 'goes on'}"


def forms(fault: Fault) -> list[str]:
    """Return the tried forms of a fault: once and permanently; for a delay, below and above the deadline."""
    if fault.name == "delay":
        return ["delay", "delay:0.5:1"]
    if not fault.counted:
        return [fault.name]
    value = f":{fault.default}" if fault.value else ""
    return [f"{fault.name}{value}:1", f"{fault.name}{value}"]


def rows(device: str) -> list[str]:
    """Return the forms of all faults that are tried for a kind of device."""
    shown = [fault for fault in FAULTS.values() if device in fault.devices and fault.name not in LIES]
    return [form for fault in shown for form in forms(fault)]


def try_cell(column: Column, form: str) -> Cell:
    """Switch a fault on, use the driver, clear the fault, and find out how the driver works again."""
    threads, descriptors = set(threading.enumerate()), open_lines()
    cell, bench = Cell(), column.make()
    try:
        bench.open()
        bench.prepare()
        name = form.partition(":")[0]
        if name in IN_MOTION:
            bench.set_in_motion()
        bench.faults.switch_on(form)
        for use, call in bench.uses.items():
            _use(cell, use, call)
        bench.faults.clear()
        _find_way_back(cell, bench)
        if not form.endswith(":1") and name not in IN_MOTION and (bench.talks_on_opening or name == "unplug"):
            bench.faults.switch_on(form)
            _use(cell, "open", bench.open)
            bench.faults.clear()
            _use(Cell(broken=cell.broken), "open again", bench.open)
        if name not in bench.unproven:
            cell.broken += _unfounded(cell, form)
        if twice := bench.executed_twice():
            cell.broken.append(f"executed twice: {', '.join(twice)}")
    finally:
        bench.close()
    cell.broken += [f"{held} {what} left" for what, held in bench.left_behind().items() if held]
    if left := [thread.name for thread in threading.enumerate() if thread not in threads]:
        cell.broken.append(f"threads left: {', '.join(left)}")
    if left := sorted(open_lines() - descriptors):
        cell.broken.append(f"descriptors left: {', '.join(left)}")
    return cell


def _use(cell: Cell, use: str, call: Callable[[], object]) -> None:
    start_s = time.monotonic()
    try:
        call()
        cell.outcomes[use] = "ok"
    except ReportedFault as reported:
        cell.outcomes[use], cell.messages[use] = "S", str(reported)
    except UnprovenError as wrong:
        cell.outcomes[use], cell.messages[use] = "✗", str(wrong)
    except WrongAnswerError as wrong:
        cell.outcomes[use] = "WRONG"
        cell.broken.append(f"{use}: {wrong}")
    except DeviceError as error:
        kind = next(kind for kind in SIGNS if isinstance(error, kind))
        cell.outcomes[use], cell.messages[use] = SIGNS[kind], str(error)
        cell.broken += [f"{use}: {mistake}" for mistake in _mistakes(error, use)]
    except Exception as error:
        cell.outcomes[use] = "CRASH"
        cell.broken.append(f"{use}: {type(error).__name__}: {error}")
    if (took_s := time.monotonic() - start_s) > DEADLINE_S:
        cell.broken.append(f"{use}: took {took_s:.1f} s")


def _mistakes(error: DeviceError, use: str) -> list[str]:
    """Return the parts that are missing in an error message."""
    unsaid = [part for part in ("device", "step", "expected", "got", "remedy") if not getattr(error, part)]
    if use == "stop" and "emergency stop" not in error.remedy:
        unsaid.append("the emergency stop")
    return [f"does not name {part}" for part in unsaid]


def _unfounded(cell: Cell, form: str) -> list[str]:
    """Return a sentence for each call that succeeded but must fail, or failed but must succeed."""
    mistakes = [
        f"{use}: succeeded all the same" for use in MUST_FAIL.get(form, ()) if cell.outcomes.get(use) == "ok"
    ]
    if form in MUST_WORK:
        mistakes += [f"{use}: {outcome}" for use, outcome in cell.outcomes.items() if outcome != "ok"]
    if form.endswith(":1") and cell.outcomes.get("stop", "ok") != "ok":
        mistakes.append("a single fault kept it from stopping")
    return mistakes


def _find_way_back(cell: Cell, bench: Bench) -> None:
    failures = []
    for way, go in bench.ways_back.items():
        try:
            go()
            bench.works()
        except (DeviceError, ReportedFault) as error:
            failures.append(f"{way or 'goes on'}: {error}")
        except WrongAnswerError as error:
            cell.broken.append(f"after {way or 'nothing'}: {error}")
        else:
            cell.way_back = way
            return
    cell.broken.append(f"no way back: {'; '.join(failures)}")


def sampled(place: int, every: int = 1) -> list[str]:
    """Return every n-th fault of a column, beginning at another one in each column."""
    return rows(COLUMNS[place].device)[place % every :: every]


def try_all(every: int = 1, at_a_time: int = AT_A_TIME) -> dict[str, dict[str, Cell]]:
    """Try faults with every driver, several drivers at the same time, because most calls only wait."""
    places = [place for place, column in enumerate(COLUMNS) if not column.missing]
    with ProcessPoolExecutor(at_a_time, multiprocessing.get_context("spawn")) as pool:
        found = pool.map(partial(_try_column, every=every), places)
        return {COLUMNS[place].name: cells for place, cells in zip(places, found, strict=True)}


def _try_column(place: int, every: int) -> dict[str, Cell]:
    return {form: try_cell(COLUMNS[place], form) for form in sampled(place, every)}


def table(columns: dict[str, dict[str, str]]) -> str:
    """Return a Markdown table with a row for each fault that any of the columns has."""
    names = list(columns)
    forms_of_all = list(dict.fromkeys(form for fault in FAULTS.values() for form in forms(fault)))
    lines = ["| fault | " + " | ".join(names) + " |", "| --- " * (len(names) + 1) + "|"]
    for form in forms_of_all:
        cells = [columns[name].get(form, "") for name in names]
        if any(cells):
            lines.append(f"| `{form}` | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def tables(found: dict[str, dict[str, Cell]]) -> str:
    """Return a table of the machines, and one for each other kind of device."""
    tables = {column.name: column.table or column.device for column in COLUMNS}
    kinds = {name: kind if kind in _OWN_TABLE else "" for name, kind in tables.items()}
    told = {name: {form: str(cell) for form, cell in cells.items()} for name, cells in found.items()}
    return "\n\n".join(
        table({name: cells for name, cells in told.items() if kinds[name] == kind})
        for kind in ("", *_OWN_TABLE)
    )


def documented() -> dict[str, dict[str, str]]:
    """Return all columns of the tables in docs/fault-matrix.md."""
    _, _, below = DOCUMENT.read_text(encoding="utf-8").partition(HEADING)
    columns: dict[str, dict[str, str]] = {}
    for text in below.strip().split("\n\n"):
        head, _, *lines = (
            [cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines()
        )
        for place, name in enumerate(head[1:], 1):
            columns[name] = {line[0].strip("`"): line[place] for line in lines if line[place]}
    return columns


def main() -> None:
    """Try all faults with all drivers, and print or write the tables."""
    found = try_all()
    text = tables(found)
    if "--write" in sys.argv:
        before, heading, _ = DOCUMENT.read_text(encoding="utf-8").partition(HEADING)
        DOCUMENT.write_text(f"{before}{heading}\n{text}\n", "utf-8")
    else:
        print(text)
    for name, cells in found.items():
        for form, cell in cells.items():
            for mistake in cell.broken:
                print(f"{name}: {form}: {mistake}", file=sys.stderr)
            if "--messages" in sys.argv:
                for use, message in cell.messages.items():
                    print(f"{name}: {form}: {use}: {message}", file=sys.stderr)
    sys.exit(any(cell.broken for cells in found.values() for cell in cells.values()))


if __name__ == "__main__":
    main()
