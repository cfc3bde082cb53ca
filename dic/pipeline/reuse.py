"""Result files that a new measurement can use again: the whole results, or only the displacement fields."""

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from dic.errors import OutputError, RunFileError
from dic.pipeline.run_result import RunResult
from dic.pipeline.series_result_file import SeriesResult
from dic.pipeline.strain_anew import job_of_fields
from dic.results.job import Job, Outcome
from dic.results.loading import use_result
from dic.results.place import ResultPlace
from dic.results.reader import read_provenance

Result = TypeVar("Result", SeriesResult, RunResult)

SAME = "holds these results already: equal input, settings and versions; nothing is correlated"
FIELDS = "its displacement fields are used again; nothing is correlated"


def fields_on_file(
    place: ResultPlace,
    load: Callable[[Path], Result],
    fields: Mapping[str, Any],
    images: Callable[[], Mapping[str, Sequence[Outcome]]],
    *,
    begun: bool = False,
) -> Result | None:
    """Return the result file whose fields are those of a measurement; None if there is no such file.

    Parameters
    ----------
    place : ResultPlace
        The place that names the file: the result file to be written, or the file whose fields the user wants
        to use.
    load : callable
        Function that reads a result file.
    fields : mapping
        Everything except the images that determines the fields, as values for JSON.
    images : callable
        Function that returns the images of the measurement, keyed by the camera's name ("" for a series of
        images).
    begun : bool
        True if a result of only the first images is accepted too, because images may have been appended
        since.

    Raises
    ------
    RunFileError
        If the user named a file whose fields belong to another measurement or cannot be used.
    OutputError
        If the file at the place of the results is damaged or no result file, and must not be replaced.
    """
    if place.fields_from is None:
        if _is_of_other_job(place.path, fields):
            return None
        try:
            result = load(place.path)
            return None if _difference(result, fields, images, begun) else result
        except RunFileError as error:
            if place.path.exists() and not place.replace:
                got = f"one that exists and cannot be used: {error.step}: {error.got}"
                remedy = "name another place, or replace it with --force"
                raise OutputError(
                    str(place.path), "write results", "a file of its own", got, remedy
                ) from error
            return None
    result = load(place.fields_from)
    different = _difference(result, fields, images, begun)
    if different:
        raise RunFileError(
            str(place.fields_from),
            "use its displacement fields again",
            "a result of the same images with the same settings of the correlation",
            f"one with other {different}",
            "leave out --fields-from to correlate the images",
        )
    return result


def _is_of_other_job(path: Path, fields: Mapping[str, Any]) -> bool:
    """Return True if a result file says that its fields belong to another measurement.

    To read all results of a long series or of large images only to replace them would take minutes, or much
    memory.
    """
    try:
        origin = use_result(path, read_provenance, lambda file, got: OSError(f"{file}: {got}"))
    except OSError:
        return False
    job = None if origin is None else origin.job
    return job is not None and bool(_different_names(job, fields))


def require_replaceable(place: ResultPlace) -> None:
    """Raise an error if the file contains other results that must not be replaced.

    Raises
    ------
    OutputError
    """
    if place.path.exists() and not place.replace:
        expected, remedy = "a file of its own", "name another place, or replace it with --force"
        raise OutputError(str(place.path), "write results", expected, "one that exists", remedy)


def _difference(
    result: SeriesResult | RunResult,
    fields: Mapping[str, Any],
    images: Callable[[], Mapping[str, Sequence[Outcome]]],
    begun: bool,
) -> str:
    """Return the names of all differences between a result and a measurement; "" without a difference."""
    different = _different_names(job_of_fields(result), fields)
    if different:
        return ", ".join(different)
    cameras = result.cameras if isinstance(result, RunResult) else []
    given = images()
    outcomes = {camera.camera: camera.outcomes for camera in cameras} or {"": getattr(result, "outcomes", [])}
    same = outcomes.keys() == given.keys() and all(
        (len(given[name]) == len(of_file) or (begun and 0 < len(of_file) < len(given[name])))
        and all(map(_is_same, of_file, given[name]))
        for name, of_file in outcomes.items()
    )
    return "" if same else "images"


def _different_names(job: Job, fields: Mapping[str, Any]) -> list[str]:
    found, wanted = json.loads(job.fields), json.loads(json.dumps(fields))
    return [name for name in {**wanted, **found} if found.get(name) != wanted.get(name)]


def _is_same(found: Outcome, wanted: Outcome) -> bool:
    """Return True if the outcome of an image in the file is the outcome of an image to be measured.

    The reason for a failure may name the image, so images that failed must have the same name.
    """
    same = bool(wanted.content) and found.content == wanted.content
    return same and (found.failure is None or found.label == wanted.label)
