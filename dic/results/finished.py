"""A correlated image, and the data of an earlier reference that a result file keeps for a later continuation.

The image of a series is correlated with an earlier image after a new reference was taken. The first guess of
the images after it comes from this correlation, and not from the displacements of the result, which begin at
the first reference. If a measurement is continued, its results are the same bits only with these data.
"""

from dataclasses import dataclass, field as dataclass_field
from typing import Any

import numpy as np

from dic.correlation.earlier_field import EarlierField
from dic.correlation.field import Field
from dic.correlation.series_state import SeriesFields
from dic.image.times import ImageTime
from dic.results.job import ImageOutcome

_EARLIER = "later_reference"
_COLUMNS = ("row", "points", "rows", "columns", "converged_share", "median_zncc")


@dataclass(frozen=True)
class FinishedImage:
    """The outcome of the correlation of an image."""

    label: str
    """Name of the image."""
    digest: str = ""
    """SHA-256 of the image's file, or of its frames; "" if it is not known."""
    fields: SeriesFields | None = None
    """None if the image could not be correlated."""
    failure: str | None = None
    """The reason why the image could not be correlated."""
    content: str = ""
    """The result of `dic.results.job.content_of`; "" if it is not known."""
    time: ImageTime = dataclass_field(default_factory=ImageTime)
    """When the image was taken."""

    @property
    def outcome(self) -> ImageOutcome:
        """What a result file stores about the image in addition to the image's fields."""
        return ImageOutcome(self.label, self.content, self.failure, self.time)

    @property
    def field(self) -> Field:
        """The field from the first reference to the image."""
        if self.fields is None:
            raise ValueError(f"{self.label} could not be correlated")
        return self.fields.from_first


def append_earlier(series: Any, row: int, fields: SeriesFields) -> None:
    """Append what later images begin with, for an image that was correlated with a later reference.

    `series`: group of the series in an open result file. `row`: row of the image in the datasets of the
    series.
    """
    if fields.earlier is None or fields.quality is None:
        return
    group = series.require_group(_EARLIER)
    earlier, (share, zncc) = fields.earlier, fields.quality
    values = row, len(earlier.warps), *earlier.converged.shape, share, zncc
    for name, value in zip(_COLUMNS, values, strict=True):
        _extend(group, name, np.array([value]))
    _extend(group, "warps", earlier.warps)
    _extend(group, "converged", earlier.converged.ravel().view(np.uint8))


class EarlierFields:
    """The data that `append_earlier` has written, by the row of the image.

    `series`: group of the series in an open result file.
    """

    def __init__(self, series: Any) -> None:
        self._group = series.get(_EARLIER)
        columns = {} if self._group is None else {name: self._group[name][:] for name in _COLUMNS}
        self._columns: dict[str, Any] = columns
        self._places = {int(row): k for k, row in enumerate(columns.get("row", ()))}

    def fields(self, row: int, field: Field) -> SeriesFields | None:
        """Return the fields of an image whose field is known; None if the file lacks its data."""
        if not field.updates:
            return SeriesFields(field)
        if row not in self._places or self._group is None:
            return None
        k, columns = self._places[row], self._columns
        shapes = columns["rows"], columns["columns"]
        first = int(columns["points"][:k].sum())
        warps = self._group["warps"][first : first + int(columns["points"][k])]
        first = int((shapes[0] * shapes[1])[:k].sum())
        shape = int(shapes[0][k]), int(shapes[1][k])
        converged = self._group["converged"][first : first + shape[0] * shape[1]]
        earlier = EarlierField(warps, converged.reshape(shape).astype(np.bool_))
        quality = float(columns["converged_share"][k]), float(columns["median_zncc"][k])
        return SeriesFields(field, earlier, quality)


def _extend(group: Any, name: str, values: Any) -> None:
    """Append values to a dataset of an open file; the dataset is created if it is missing."""
    if name not in group:
        dataset = group.create_dataset(
            name, (0, *values.shape[1:]), values.dtype, maxshape=(None, *values.shape[1:]), chunks=True
        )
        dataset.attrs["units"] = "px" if name == "warps" else "1"
    dataset = group[name]
    before = len(dataset)
    dataset.resize(before + len(values), axis=0)
    dataset[before:] = values
