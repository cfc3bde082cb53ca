"""The texts that determine a result: equal texts and equal images give bit-identical results."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from hashlib import sha256
from typing import Any

import h5py
import numpy as np

from dic.image.times import ImageTime


@dataclass(frozen=True)
class Job:
    """Everything except the images that determines a result, as JSON texts with sorted keys.

    Attributes
    ----------
    fields : str
        The inputs of the displacement fields: reference, region, settings of the correlation, versions.
    strains : str
        The inputs from which strains and corrections are computed, in addition to the fields.
    """

    fields: str
    strains: str

    @classmethod
    def of(cls, fields: Mapping[str, Any], strains: Mapping[str, Any]) -> "Job":
        """Return the job with the given inputs of fields and strains, which must be values for JSON."""
        return cls(as_text(fields), as_text(strains))


def as_text(values: Mapping[str, Any]) -> str:
    """Return values as a JSON text that is the same for equal values."""
    return json.dumps(values, indent=1, sort_keys=True)


@dataclass(frozen=True)
class Outcome:
    """The outcome of the correlation for one image of a series.

    Attributes
    ----------
    label : str
        Name of the image.
    content : str
        The result of `content_of`; "" if the image could not be read.
    failure : str or None
        The reason why the image could not be correlated; None if it was correlated.
    time : ImageTime
        When the image was taken. Not set for a step of a run, because the run file contains the time.
    """

    label: str
    content: str
    failure: str | None = None
    time: ImageTime = field(default_factory=ImageTime)


def content_of(digest: str, guess: Iterable[float] = ()) -> str:
    """Return a text that identifies an image's content and its first guess; "" without a digest."""
    if not digest:
        return ""
    return sha256(" ".join([digest, *(float(value).hex() for value in guess)]).encode()).hexdigest()


def write_outcomes(group: Any, outcomes: Sequence[Outcome]) -> None:
    """Write the outcomes of all images of a series, in order, into a new group `images`."""
    images, text = group.create_group("images"), h5py.string_dtype()
    for name in ("label", "content"):
        images.create_dataset(name, data=[getattr(each, name) for each in outcomes], dtype=text)
    images.create_dataset("failure", data=[each.failure or "" for each in outcomes], dtype=text)
    failed = np.array([each.failure is not None for each in outcomes], np.uint8)
    images.create_dataset("failed", data=failed).attrs["units"] = "1"
    times = [each.time for each in outcomes]
    if any(time.source for time in times):
        times_s = [np.nan if time.time_s is None else time.time_s for time in times]
        images.create_dataset("time_s", data=times_s).attrs["units"] = "s"
        images.create_dataset("time_source", data=[time.source for time in times], dtype=text)


def read_outcomes(group: Any) -> list[Outcome]:
    """Return the outcomes of all images of a series; an empty list for files of earlier versions."""
    if "images" not in group:
        return []
    images = group["images"]
    columns = [images[name].asstr()[:] for name in ("label", "content", "failure")]
    times = [ImageTime()] * len(columns[0])
    if "time_s" in images:
        sources = images["time_source"].asstr()[:]
        known = zip(images["time_s"][:], sources, strict=True)
        times = [ImageTime(float(s), str(by)) if np.isfinite(s) else ImageTime() for s, by in known]
    return [
        Outcome(str(label), str(content), str(failure) if failed else None, time)
        for label, content, failure, failed, time in zip(*columns, images["failed"][:], times, strict=True)
    ]
