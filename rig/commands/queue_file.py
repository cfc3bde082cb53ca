"""The runs of a queue: protocol files, and a small TOML file that names the specimens."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, ValidationError

from drivers.errors import ConfigurationError
from drivers.interfaces import OperatorQuestion
from drivers.settings import LONGEST_PATH, Settings, mistakes_in, read_toml, toml_table
from rig.protocol.base import KINDS
from rig.protocol.phases.ask import WORD

RUNS_MAX = 500
_PATH = Annotated[str, Field(min_length=1, max_length=LONGEST_PATH)]


class SampleChanges(Settings):
    """Keys that replace those of the table `[sample]` of a protocol, for one specimen."""

    name: str | None = None
    thickness_mm: float | None = None
    width_mm: float | None = None
    gauge_length_mm: float | None = None
    direction_deg: float | None = None


class QueuedRun(Settings):
    """A table `[[runs]]`: one run, and what the operator does before it."""

    protocol: _PATH
    output: _PATH | None = None
    sample: SampleChanges = SampleChanges()
    text: str | None = Field(default=None, min_length=1, max_length=200)
    word: str = Field(default="mounted", pattern=WORD, max_length=30)


class QueueFile(Settings):
    """A file that lists runs. Its paths are relative to its folder."""

    rig: _PATH | None = None
    folder: _PATH | None = None
    runs: list[QueuedRun] = Field(min_length=1, max_length=RUNS_MAX)


@dataclass(frozen=True)
class QueueJob:
    """One run of a queue.

    Attributes
    ----------
    number : int
        From 1.
    protocol : Path
        The protocol file that the user named.
    changed : str
        The text of the protocol with the specimen's own values, or an empty text if it has none.
    rig, output : Path
    question : OperatorQuestion
        What the operator does before the run.
    """

    number: int
    protocol: Path
    changed: str
    rig: Path
    output: Path
    question: OperatorQuestion

    @property
    def own_protocol(self) -> Path:
        """The protocol that the run reads: the user's file, or one beside the run file."""
        return self.output.with_suffix(".protocol.toml") if self.changed else self.protocol


def read_jobs(files: Sequence[Path], rig: Path | None, folder: Path | None) -> list[QueueJob]:
    """Return the runs of a queue, from protocols and queue files in their order.

    `rig` and `folder` replace those of the queue files. Raise `ConfigurationError` with all mistakes of a
    file, or if two runs have the same run file.
    """
    found: list[tuple[QueuedRun, Path, Path | None, Path]] = []
    for path in files:
        table = read_toml(path)
        if table.get("kind") in KINDS or "runs" not in table:
            found.append((QueuedRun(protocol=str(path)), Path(), rig, folder or Path()))
            continue
        queue = _checked(path, table)
        own_rig = None if queue.rig is None else path.parent / queue.rig
        own_folder = path.parent / (queue.folder or "")
        found += [(run, path.parent, rig or own_rig, folder or own_folder) for run in queue.runs]
    if len(found) > RUNS_MAX:
        raise ConfigurationError("the queue", [f"at most {RUNS_MAX} runs are expected, got {len(found)}"])
    jobs = [_job(number, *each) for number, each in enumerate(found, 1)]
    places = Counter(job.output.resolve() for job in jobs)
    if twice := sorted(str(place) for place, count in places.items() if count > 1):
        raise ConfigurationError("the queue", [f"{place} is the output of two runs" for place in twice])
    return jobs


def _checked(path: Path, table: dict[str, Any]) -> QueueFile:
    try:
        return QueueFile.model_validate(table)
    except ValidationError as error:
        raise ConfigurationError(str(path), mistakes_in(error)) from error


def _job(number: int, run: QueuedRun, base: Path, rig: Path | None, folder: Path) -> QueueJob:
    protocol = base / run.protocol
    if rig is None:
        raise ConfigurationError(str(protocol), ['no rig file is named; give --rig, or rig = "RIG.toml"'])
    output = folder / (run.output or f"{number:02d}-{protocol.stem}.h5")
    table = read_toml(protocol)
    changes = run.sample.model_dump(exclude_none=True)
    sample = {**table.get("sample", {}), **changes} if isinstance(table.get("sample", {}), dict) else {}
    changed = _text({**table, "sample": sample}, protocol) if changes else ""
    return QueueJob(
        number, protocol, changed, rig, output, OperatorQuestion(run.text or _text_for(sample), run.word)
    )


def _text(table: dict[str, Any], protocol: Path) -> str:
    """Return a protocol as TOML text, with one line for each of its tables."""
    _, *lines = toml_table((), table).splitlines()
    return "\n".join([f"# {protocol.name} with the values of one specimen, by rig queue", *lines, ""])


def _text_for(sample: dict[str, Any]) -> str:
    """Return the request to mount a specimen."""
    direction = sample.get("direction_deg")
    turned = f", {direction:g} degrees to the rolling direction" if isinstance(direction, int | float) else ""
    return f"Please mount the specimen {sample.get('name', 'of the next run')}{turned}."
