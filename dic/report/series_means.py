"""The mean strains of a series of images: arrays for a curve, and the rows of a table."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import Any

import numpy as np

from dic.pipeline.measured_images import MeasuredImage
from dic.report.numbers import fixed, micro, micro_with_std, with_std
from dic.report.series import LONG
from dic.report.states import names_of
from dic.report.steps import MOST_ROWS
from dic.report.thinning import some_of
from dic.typing import Float

NONE = "–"
"""Text in the place of a number that does not exist."""
_NAMES = ("exx", "eyy", "exy")
_PERCENT_FROM = 0.01
"""All strains of a series are shown in % if one of them is at least this large, otherwise in µε."""
_DECIMALS = 4
"""Decimals of a strain in % without a standard deviation: the last one is 1 µε."""


@dataclass(frozen=True)
class ImageRow:
    """A row of the table: image, share of points that were measured in %, strains, and a remark."""

    number: int
    name: str
    share: str
    strains: list[str]
    remark: str


@dataclass(frozen=True)
class SeriesMeans:
    """The mean strains of all images of a series."""

    rows: list[dict[str, Any]]
    """The results of the n images, from `MeasuredImage.row`."""
    kinds: tuple[str, ...]
    """The kinds of strain, from the least to the most accurate."""
    values: dict[str, Float]
    stds: dict[str, Float]
    """Each of shape (n, 3). Mean εxx, εyy and εxy of each kind, and their standard deviations; NaN where
    there is none.
    """

    @property
    def measured(self) -> list[int]:
        """Indices of the images that were measured."""
        return [k for k, row in enumerate(self.rows) if "converged" in row]

    @property
    def best(self) -> str:
        """The most accurate kind of strain that at least one image has."""
        return next((kind for kind in reversed(self.kinds) if np.isfinite(self.values[kind]).any()), "raw")

    @property
    def unit(self) -> str:
        """Unit of the strains: "%" if one of them reaches 1 %, otherwise "µε"."""
        largest = max(float(np.nanmax(np.abs(one), initial=0.0)) for one in self.values.values())
        return "%" if largest >= _PERCENT_FROM else "µε"

    @property
    def factor(self) -> float:
        """Number of units in a strain of 1."""
        return 100.0 if self.unit == "%" else 1e6

    def name(self, index: int) -> str:
        """Return the name of an image without its folder."""
        return PurePath(self.rows[index]["file"]).name

    def find(self, wanted: str) -> list[int]:
        """Return the indices of the images that a user may mean by a name, with or without its ending."""
        return [k for k, row in enumerate(self.rows) if wanted in names_of(row["file"])]

    def kind_at(self, index: int) -> str:
        """Return the most accurate kind of strain of an image."""
        known = (kind for kind in reversed(self.kinds) if np.isfinite(self.values[kind][index]).any())
        return next(known, "raw")

    def texts(self, index: int, kind: str) -> list[str]:
        """Return εxx, εyy and εxy of an image as text, with their standard deviations."""
        unit, factor = self.unit, self.factor
        pairs = zip(factor * self.values[kind][index], factor * self.stds[kind][index], strict=True)
        return [_text(value, std, unit) for value, std in pairs]

    def table(self, shown: int) -> list[ImageRow]:
        """Return a row for each image; of a long series rows of the image `shown` and of some others."""
        count = len(self.rows)
        some = range(count) if count <= LONG else some_of(count, MOST_ROWS, [shown])
        return [self._row(k, self.rows[k]) for k in some]

    def _row(self, index: int, row: dict[str, Any]) -> ImageRow:
        strains = [text for kind in self.kinds for text in self.texts(index, kind)]
        if "converged" not in row:
            return ImageRow(index + 1, self.name(index), NONE, strains, row["error"])
        points = row["points"] + row["out_of_view"]
        share = 100 * row["converged"] // points if points else 0
        reason = row.get("corrected", {}).get("reason")
        remarks = [row["error"], f"not corrected: {reason}" if reason else "", *row["remarks"]]
        return ImageRow(index + 1, self.name(index), str(share), strains, "; ".join(filter(None, remarks)))


def means_of(images: Sequence[MeasuredImage], *, calibrated: bool) -> SeriesMeans:
    """Return the mean strains of a series; each image is read once."""
    kinds = ("raw", "calibrated", "corrected") if calibrated else ("raw",)
    rows = [image.row() for image in images]
    values, stds = {}, {}
    for kind in kinds:
        means = [_known(row.get(kind, {}), kind) for row in rows]
        values[kind] = _columns(means, _NAMES)
        # If there is a calibration, leave out the standard deviations of raw strain: they lack the part that
        # motion out of the grid's plane causes.
        stated = [{} if calibrated and kind == "raw" else mean for mean in means]
        stds[kind] = _columns(stated, [f"{name}_std" for name in _NAMES])
    return SeriesMeans(rows, kinds, values, stds)


def _known(mean: dict[str, Any], kind: str) -> dict[str, Any]:
    return mean if kind != "corrected" or mean.get("applied", False) else {}


def _columns(means: Sequence[dict[str, Any]], names: Sequence[str]) -> Float:
    rows = [[mean.get(name) for name in names] for mean in means]
    return np.array(rows, np.float64).reshape(-1, len(names))


def _text(value: float, std: float, unit: str) -> str:
    if value != value:
        return NONE
    if std != std:
        return fixed(value, _DECIMALS) if unit == "%" else micro(value)
    return with_std(value, std) if unit == "%" else micro_with_std(value, std)
