"""Writes and reads the displacement fields of a series in a result file, with all data that strain needs."""

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from dic.correlation.field import Field
from dic.correlation.series_state import SeriesFields
from dic.correlation.settings import CorrelationSettings
from dic.files.lazy import Computed
from dic.image.given import fixed
from dic.image.point_grid import PointGrid
from dic.image.threads import bands_of
from dic.results.columns import Columns
from dic.results.finished import EarlierFields, FinishedImage
from dic.results.job import ImageOutcome
from dic.results.schema import units_of
from dic.typing import Float, Grey, Mask

NOT_SMOOTHED: dict[str, Any] = {"smoothing_px": 0.0}
"""Values of settings that files of earlier versions lack."""


def read_settings(group: Any, settings: type[Any], prefix: str = "") -> dict[str, Any]:
    """Return the settings of a series by their names, from the attributes of the series' group."""
    names = [field.name for field in fields(settings)]
    older = {name: NOT_SMOOTHED[name] for name in names if name in NOT_SMOOTHED}
    stored = [name for name in names if name not in older or prefix + name in group.attrs]
    return older | {name: plain(group.attrs[prefix + name]) for name in stored}


def plain(value: Any) -> Any:
    """Return a NumPy scalar from an HDF5 file as a Python number; return other values unchanged."""
    return value.item() if isinstance(value, np.generic) else value


def read_reference(group: Any) -> Grey:
    """Return the grey levels of the reference image in a group of the file, shape (height, width).

    Raises `ValueError` if the group has no image of this shape.
    """
    grey: Grey = group["reference"][:]
    if grey.ndim != 2 or not grey.size:
        raise ValueError(f"a reference image of the shape {grey.shape}")
    return grey


class StoredFields:
    """The fields of a series, each of which is read from the open result file when it is used.

    `series`: group of the file that `ResultWriter.add_field` wrote. `shared`: region and grid, if they are
    known; they are read from the file by default.

    `region`, shape (height, width): the region of interest; None in files of earlier versions. `grid`: the
    points, and the pixels that their subsets used; None in files of earlier versions.
    """

    def __init__(self, series: Any, shared: Mapping[str, Any] | None = None) -> None:
        self._columns, self._count, self._earlier = (
            Columns(series),
            len(series["label"]),
            EarlierFields(series),
        )
        self.settings = CorrelationSettings(**read_settings(series, CorrelationSettings))
        self._x_px, self._y_px = series["x_px"][:], series["y_px"][:]
        self._active: Mask = series["active"][:].astype(np.bool_)
        known = shared or {}
        self.region: Mask | None = known.get("region")
        if self.region is None and "region" in series:
            self.region = _read_mask(series, "region")
        self.grid: PointGrid | None = known.get("grid")
        if self.grid is None and "usable" in series:
            self.grid = _read_grid(series, self._x_px, self._y_px, self._active)

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, k: int) -> Field:
        return self.field(k)

    def field(self, k: int, *, gradients: bool = True) -> Field:
        """Return a field. If `gradients` is False, the gradients are not read and are NaN."""
        series = self._columns
        # Files of earlier versions lack the interpolation bias, and their images were not smoothed.
        known = "bias_u_px" in series
        bias = np.stack([series["bias_u_px"][k], series["bias_v_px"][k]], axis=-1) if known else None
        std = self._joined(k, "std_u_px", "std_v_px", "std_gradient", gradients=gradients)
        if "noise_std_px" in series:
            std[..., [0, 3]] = series["noise_std_px"][k]
        elif bias is not None:
            # The stored standard deviations of displacements contain the bias, so subtract its square.
            std[..., [0, 3]] = np.sqrt(np.maximum(std[..., [0, 3]] ** 2 - bias**2, 0.0))
        # Files of earlier versions lack this value, because those versions could not take new references.
        updates = int(series["updates"][k]) if "updates" in series else 0
        return Field(
            x_px=self._x_px,
            y_px=self._y_px,
            warps=self._joined(k, "u_px", "v_px", "gradient", gradients=gradients),
            std=std,
            zncc=series["zncc"][k],
            iterations=series["iterations"][k].astype(np.int16),
            status=series["status"][k].astype(np.int8),
            active=self._active,
            start=str(series["start"][k]),
            repetition=str(series["repetition"][k]) if "repetition" in series else "",
            settings=self.settings,
            updates=updates,
            smoothing_px=float(series["smoothing_px"][k]) if known else 0.0,
            greatest_bias_px=_pair(series["greatest_bias_px"][k]) if known else (0.0, 0.0),
            # If there was no new reference, both biases are computed from the displacements and their
            # gradients.
            stored_bias_px=bias if updates or not gradients else None,
            region=self.region,
            grid=self.grid,
        )

    def of_row(self, row: int) -> SeriesFields:
        """Return the field of an image, and what later images begin with, as far as the file contains it."""
        field = self.field(row)
        return self._earlier.fields(row, field) or SeriesFields(field)

    def images(self, outcomes: Sequence[ImageOutcome]) -> Sequence[FinishedImage]:
        """Return the correlated images of the series in their order, with the fields of this file.

        `outcomes`: the outcomes of all images of the series, from `read_outcomes`.
        """
        rows = np.cumsum([each.failure is None for each in outcomes]) - 1

        def image(k: int) -> FinishedImage:
            each = outcomes[k]
            if each.failure is not None:
                return FinishedImage(each.label, failure=each.failure, content=each.content, time=each.time)
            digest, fields = str(self._columns["sha256"][rows[k]]), self.of_row(int(rows[k]))
            return FinishedImage(each.label, digest, fields, content=each.content, time=each.time)

        return Computed(len(outcomes), image)

    def _joined(self, k: int, u: str, v: str, gradient: str, *, gradients: bool) -> Float:
        series = self._columns
        unread = np.full((4, *self._active.shape), np.nan)
        slopes = np.moveaxis(series[gradient][k], -1, 0) if gradients else unread
        return np.stack([series[u][k], *slopes[:2], series[v][k], *slopes[2:]], axis=-1)


def write_points(group: Any, field: Field) -> None:
    """Write the points of a series, their region, and the pixels that their subsets use."""
    plain = {"x_px": field.x_px, "y_px": field.y_px, "active": field.active.astype(np.uint8)}
    masks: Mapping[str, Any] = {} if field.region is None else {"region": field.region}
    if field.grid is not None:
        plain["subset_pixels"] = field.grid.pixels
        masks = {**masks, "usable": field.grid.usable, "subset_cut": field.grid.cut}
    for name, values in plain.items():
        group[name] = values
    for name, mask in masks.items():
        _write_mask(group, name, mask)
    for name in (*plain, *masks):
        group[name].attrs["units"] = units_of(name)


def _write_mask(group: Any, name: str, mask: Mask) -> None:
    """Write a mask in rows of chunks, because HDF5 would need a copy of a mask that repeats one element."""
    stored = group.create_dataset(name, mask.shape, np.uint8, compression="gzip")
    for rows in bands_of(len(mask), stored.chunks[0]):
        stored[rows] = mask[rows].view(np.uint8)


def _read_mask(group: Any, name: str) -> Mask:
    return fixed(group[name][:].view(np.bool_))


def _read_grid(series: Any, x: Any, y: Any, active: Mask) -> PointGrid:
    cut, usable = (_read_mask(series, name) for name in ("subset_cut", "usable"))
    return PointGrid(x, y, active, series["subset_pixels"][:], cut, usable)


def _pair(values: Float) -> tuple[float, float]:
    return float(values[0]), float(values[1])
