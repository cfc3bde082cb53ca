"""The texts that determine a result: equal texts and equal images give bit-identical results."""

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from hashlib import sha256
from typing import Any

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
class ImageOutcome:
    """The outcome of the correlation for one image of a series."""

    label: str
    """Name of the image."""
    content: str
    """The result of `content_of`; "" if the image could not be read."""
    failure: str | None = None
    """The reason why the image could not be correlated; None if it was correlated."""
    time: ImageTime = field(default_factory=ImageTime)
    """When the image was taken. Not set for a step of a run, because the run file contains the time."""


def content_of(digest: str, guess: Iterable[float] = ()) -> str:
    """Return a text that identifies an image's content and its first guess; "" without a digest."""
    if not digest:
        return ""
    return sha256(" ".join([digest, *(float(value).hex() for value in guess)]).encode()).hexdigest()


def outcome_rows(outcome: ImageOutcome) -> dict[str, Any]:
    """Return the row of an image in the group `images` of its camera."""
    rows: dict[str, Any] = {"label": outcome.label, "content": outcome.content}
    rows |= {"failure": outcome.failure or "", "failed": np.uint8(outcome.failure is not None)}
    time_s = outcome.time.time_s
    return rows | {"time_s": np.nan if time_s is None else time_s, "time_source": outcome.time.source}


def read_outcomes(group: Any) -> list[ImageOutcome]:
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
        ImageOutcome(str(label), str(content), str(failure) if failed else None, time)
        for label, content, failure, failed, time in zip(*columns, images["failed"][:], times, strict=True)
    ]
