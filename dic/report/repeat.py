"""How to repeat a tensile test's evaluation: commands, versions, settings, and digests of all files."""

import json
from collections.abc import Sequence
from dataclasses import dataclass

from dic.errors import RunFileError
from dic.pipeline.result import RunResult
from dic.report.camera_images import Results
from dic.report.tensile_record import TensileTest
from dic.results.provenance import Provenance

_MOST_IMAGES, _AT_ENDS = 500, 10
"""Of more images than the first number, the digests of the second number at each end are shown."""
_UNKNOWN = "not known: the result file is of an earlier version"


@dataclass(frozen=True)
class Repeat:
    """The data with which another person can repeat the evaluation of a tensile test."""

    commands: list[tuple[str, str]]
    """Description and text of each command, in the order in which they must be given."""
    versions: list[tuple[str, str]]
    settings: str
    """The settings of correlation, strain and properties, as JSON."""
    files: list[tuple[str, str]]
    """Name and SHA-256 of each input file except the images."""
    images: list[tuple[str, str]]
    """Name and SHA-256 of each image of the curve; of a long series, those at both ends."""
    more_images: int
    """Number of the other images, whose digests are in the JSON file."""


def result_of(test: TensileTest, results: Sequence[Results]) -> Results:
    """Return the result that a test was computed from.

    Raises `RunFileError` if the test was computed from none of the results.
    """
    for result in results:
        names = {result.source, result.file} if isinstance(result, RunResult) else {result.source}
        if test.series.source and test.series.source in names:
            return result
    expected = f"a test in {', '.join(result.source for result in results)}"
    remedy = "give the results from which the test was computed"
    raise RunFileError("tests", "write report", expected, test.series.source or "none", remedy)


def repeat_of(test: TensileTest, result: Results) -> Repeat:
    """Return how to repeat the evaluation of a test."""
    first, last = result.provenance or Provenance(_UNKNOWN, _UNKNOWN, {}), test.provenance
    columns = [column for column in test.columns if column.read.kind == test.columns[-1].read.kind]
    images = {
        (f"{column.camera}, {label}" if column.camera else label): digest
        for column in columns
        for label, digest in zip(column.labels, column.digests, strict=True)
    }
    named = list(images.items())
    kept = named if len(named) <= _MOST_IMAGES else [*named[:_AT_ENDS], *named[-_AT_ENDS:]]
    return Repeat(
        commands=[("measured the images", first.command), ("computed the properties", last.command)],
        versions=[("Images", first.versions), ("Properties", last.versions)],
        settings=json.dumps(_settings(test, first), indent=1, ensure_ascii=False),
        files=list((dict(first.inputs) | dict(last.inputs)).items()),
        images=[(name, digest or "not known") for name, digest in kept],
        more_images=len(named) - len(kept),
    )


def _settings(test: TensileTest, first: Provenance) -> dict[str, object]:
    jobs = {} if first.job is None else {"fields": first.job.fields, "strains": first.job.strains}
    return {name: json.loads(text) for name, text in jobs.items()} | {
        "gauge": test.gauge,
        "transverse_gauge": test.transverse,
        "properties": vars(test.settings),
    }
