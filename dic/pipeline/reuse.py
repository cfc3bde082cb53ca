"""Result files that a new measurement can use again: the whole results, or the fields of the first images."""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from dic.errors import OutputError, RunFileError
from dic.pipeline.result import RunResult, SeriesResult
from dic.pipeline.result_file import load_fields, load_results, require_fields
from dic.results.finished import FinishedImage
from dic.results.job import ImageOutcome, Job
from dic.results.loading import use_result
from dic.results.place import ResultPlace
from dic.results.reader import read_provenance

Outcomes = Mapping[str, Sequence[ImageOutcome]]
"""The outcomes of images by the camera's name, which is "" for a series of image files."""

SAME = "holds these results already: equal input, settings and versions; nothing is correlated"
FIELDS = "its displacement fields are used again; nothing is correlated"


@dataclass(frozen=True)
class EarlierMeasurement:
    """What an earlier measurement has left."""

    images: Mapping[str, Sequence[FinishedImage]] = field(default_factory=dict)
    """The images at the beginning of each camera's series that are finished, by the camera's name."""
    known: bool = False
    """True if these are all images."""
    same: SeriesResult | RunResult | None = None
    """The results at the place, if they are those of this measurement."""
    images_before: float = 0
    """How many images a new file must have before it replaces the one at its place; see `ResultWriter`."""
    note: str = ""
    """A sentence about the use of the result file; "" if none is used."""


def look_up(place: ResultPlace, job: Job, images: Callable[[], Outcomes]) -> EarlierMeasurement:
    """Search for a result file whose fields are those of a measurement.

    `place`: the place that names the file: the result file to be written, or the file whose fields the user
    wants to use. `job`: everything except the images that determines the results. `images`: function that
    returns the images of the measurement.

    Raises `RunFileError` if the user named a file whose fields belong to another measurement or cannot be
    used. Raises `OutputError` if there is a file at the place of the results that must not be replaced.
    """
    if place.fields_from is not None:
        found = load_fields(place.fields_from)
        different = _different_names(job_of_fields(found), job) or _different_images(found, images())
        if different:
            raise _of_other_fields(place.fields_from, different)
        if not _is_at(found, place.path):
            require_replaceable(place)
        return _used(found, images(), place, job)
    if not place.path.exists():
        return EarlierMeasurement()
    if _is_of_other_job(place.path, job):
        require_replaceable(place)
        return EarlierMeasurement()
    try:
        found = load_fields(place.path)
        wanted = images()
        other_images = found.finished and _different_images(found, wanted)
        if not (_different_names(job_of_fields(found), job) or other_images):
            return _used(found, wanted, place, job)
    except RunFileError as error:
        if place.replace:
            return EarlierMeasurement()
        got = f"one that exists and cannot be used: {error.step}: {error.got}"
        remedy = "name another place, or replace it with --force"
        raise OutputError(str(place.path), "write results", "a file of its own", got, remedy) from error
    require_replaceable(place)
    return EarlierMeasurement()


def require_replaceable(place: ResultPlace) -> None:
    """Raise an `OutputError` if the file contains other results that must not be replaced."""
    if place.path.exists() and not place.replace:
        expected, remedy = "a file of its own", "name another place, or replace it with --force"
        raise OutputError(str(place.path), "write results", expected, "one that exists", remedy)


def job_of_fields(result: SeriesResult | RunResult) -> Job:
    """Return the job of a result whose fields have all data that the computation of strain needs.

    Raises
    ------
    RunFileError
        If the file is of an earlier version. Earlier versions did not store which pixels the subsets used.
    """
    known = [camera.fields for camera in result.cameras]
    job = None if result.provenance is None else result.provenance.job
    if job is not None and all(fields is None or fields.grid is not None for fields in known):
        return job
    raise RunFileError(
        result.source,
        "take its displacement fields",
        "fields with the pixels of their subsets",
        "a result file of an earlier version, without them",
        "correlate the images again",
    )


def _used(
    found: SeriesResult | RunResult, wanted: Outcomes, place: ResultPlace, job: Job
) -> EarlierMeasurement:
    """Return which images of a result file with the same fields are used, and whether its results are the
    same.

    Raises `OutputError` if the file would be replaced by other results, and must not be.
    """
    equal = {camera.camera: _equal(camera.outcomes, wanted[camera.camera]) for camera in found.cameras}
    held = sum(len(camera.outcomes) for camera in found.cameras)
    count, used = sum(map(len, wanted.values())), sum(equal.values())
    at_place, strains = _is_at(found, place.path), job_of_fields(found).strains
    named = all(
        [each.label for each in camera.outcomes] == [each.label for each in wanted[camera.camera]]
        for camera in found.cameras
    )
    name, known = found.result_file, used == count
    if at_place and found.finished and known and named and strains == job.strains:
        return EarlierMeasurement(known=True, same=load_results(place.path), note=f"{name}: {SAME}")
    if at_place and found.finished and (known or strains != job.strains):
        require_replaceable(place)
    require_fields(found)
    images = {c.camera: c.finished_images[: equal[c.camera]] for c in found.cameras}
    before = 0 if not at_place else math.inf if found.finished and known else used
    if known:
        return EarlierMeasurement(images, known=True, images_before=before, note=f"{name}: {FIELDS}")
    which = "their fields are used again" if used == held else f"the fields of {used} are used again"
    what = "images" if found.finished or isinstance(found, SeriesResult) else "images of all cameras"
    note = f"{name}: holds the first {held} of {count} {what}; {which}, and {count - used} are correlated"
    return EarlierMeasurement(images, images_before=before, note=note)


def _is_at(found: SeriesResult | RunResult, path: Path) -> bool:
    return Path(found.result_file) == path


def _of_other_fields(file: Path, different: Sequence[str]) -> RunFileError:
    return RunFileError(
        str(file),
        "use its displacement fields again",
        "a result of the same images with the same settings of the correlation",
        f"one with other {', '.join(different)}",
        "leave out --fields-from to correlate the images",
    )


def _is_of_other_job(path: Path, job: Job) -> bool:
    """Return True if a result file says that its fields belong to another measurement.

    To read all results of a long series or of large images only to replace them would take minutes, or much
    memory.
    """
    try:
        origin = use_result(path, read_provenance, lambda file, got: OSError(f"{file}: {got}"))
    except OSError:
        return False
    known = None if origin is None else origin.job
    return known is not None and bool(_different_names(known, job))


def _different_names(found: Job, wanted: Job) -> list[str]:
    """Return the names of the inputs of the fields in which two jobs differ."""
    one: dict[str, Any] = json.loads(found.fields)
    other: dict[str, Any] = json.loads(wanted.fields)
    return [name for name in {**other, **one} if one.get(name) != other.get(name)]


def _different_images(found: SeriesResult | RunResult, wanted: Outcomes) -> list[str]:
    """Return "images" if a result has other images than the first ones of a measurement."""
    held = {camera.camera: camera.outcomes for camera in found.cameras}
    same = held.keys() == wanted.keys() and all(
        0 < len(own) <= len(wanted[name]) and _equal(own, wanted[name]) == len(own)
        for name, own in held.items()
    )
    return [] if same else ["images"]


def _equal(found: Sequence[ImageOutcome], wanted: Sequence[ImageOutcome]) -> int:
    """Return how many images at the beginning are the same."""
    pairs = zip(found, wanted, strict=False)
    return next((k for k, pair in enumerate(pairs) if not _is_same(*pair)), min(len(found), len(wanted)))


def _is_same(found: ImageOutcome, wanted: ImageOutcome) -> bool:
    """Return True if the outcome of an image in the file is the outcome of an image to be measured.

    The reason for a failure may name the image, so images that failed must have the same name. An image that
    cannot be read has no content.
    """
    same = found.content == wanted.content and (bool(wanted.content) or found.failure is not None)
    return same and (found.failure is None or found.label == wanted.label)
