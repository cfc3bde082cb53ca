"""Datasets of a result file that grow by one row for each image."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dic.results.schema import units_of

Array = NDArray[Any]

PENDING_MAX = 64
"""Single values of this number of rows are collected in memory, and then written together."""


class Rows:
    """The growing datasets of an open result file.

    Arrays are written to the file at once. There are about a hundred single values for each image. They are
    written for many images together, because writing each value alone would take longer than writing all
    arrays.
    """

    def __init__(self) -> None:
        self._groups: dict[str, _Group] = {}

    def append(self, group: Any, n: int, values: Mapping[str, Any], *, write: bool = True) -> None:
        """Write row `n` of the datasets of a group; create datasets that do not exist yet.

        Rows that are not written are NaN, 0 or "", and take no space in the file.
        """
        place: str = group.name
        known = self._groups.get(place)
        if known is None:
            known = self._groups[place] = _Group(group)
        known.append(n, values, write)

    def holds(self, group: Any, name: str) -> bool:
        """Return True if a row of the dataset `name` of a group has been appended."""
        known = self._groups.get(group.name)
        return known is not None and (name in known.pending or name in known.datasets)

    def flush(self, group: str | None = None) -> None:
        """Write the single values that are still in memory, of one group or of all; rows may follow."""
        for place, known in self._groups.items():
            if group is None or place == f"/{group}":
                known.write_pending()

    def finish(self) -> None:
        """Write the single values that are still in memory; no row can be appended afterwards."""
        for known in self._groups.values():
            known.write_pending(last=True)


@dataclass(frozen=True)
class _Group:
    """The datasets of one group of the file, and the values not written yet, keyed by name and row."""

    group: Any
    datasets: dict[str, Any] = field(default_factory=dict)
    types: dict[str, Any] = field(default_factory=dict)
    pending: dict[str, dict[int, Any]] = field(default_factory=dict)

    def append(self, n: int, values: Mapping[str, Any], write: bool) -> None:
        full = False
        for name, value in values.items():
            if isinstance(value, str) or np.ndim(value) == 0:
                column = self.pending.setdefault(name, {})
                column[n] = value
                full |= len(column) == PENDING_MAX
                continue
            dataset = self._dataset(name, value)
            dataset.resize(n + 1, axis=0)
            if write:
                # A row is a whole chunk without filters, so HDF5's conversions and copies are not needed.
                row = np.ascontiguousarray(value, self.types[name])
                if row.shape != dataset.shape[1:]:
                    # The chunk would be written as it is, and the file would contain foreign memory.
                    raise ValueError(f"{name}: a row has the shape {row.shape}, not {dataset.shape[1:]}")
                dataset.id.write_direct_chunk((n, *(0 for _ in row.shape)), row)
        if full:
            self.write_pending()

    def write_pending(self, *, last: bool = False) -> None:
        for name, values in self.pending.items():
            # Give the dataset a fixed size, because such a dataset is smaller and is written faster.
            if last and name not in self.datasets:
                _create(self.group, name, _column(values, 0))
                continue
            first = min(values)
            dataset = self._dataset(name, values[first])
            dataset.resize(max(values) + 1, axis=0)
            dataset[first:] = _column(values, first)
        self.pending.clear()

    def _dataset(self, name: str, row: Any) -> Any:
        """Return the dataset of this name, which is created without rows if it is missing."""
        if name not in self.datasets:
            shape = np.shape(row)
            empty = np.empty((0, *shape), np.asarray(row).dtype)
            chunks = (1 if shape else 4 * PENDING_MAX, *shape)
            self.datasets[name] = _create(self.group, name, empty, maxshape=(None, *shape), chunks=chunks)
            self.types[name] = self.datasets[name].dtype
        return self.datasets[name]


def _column(values: Mapping[int, Any], first: int) -> Array:
    """Return the values of all rows from `first` on as an array; a missing row becomes NaN, 0 or ""."""
    some = np.asarray(next(iter(values.values())))
    kind = object if some.dtype.kind == "U" else some.dtype
    column = np.full(max(values) + 1 - first, _fill(some.dtype), kind)
    for n, value in values.items():
        column[n - first] = value
    return column


def _fill(dtype: "np.dtype[Any]") -> Any:
    return {"f": np.nan, "U": ""}.get(dtype.kind, 0)


def _create(group: Any, name: str, data: Array, **growing: Any) -> Any:
    import h5py

    text = data.dtype.kind in "OU"
    dtype = h5py.string_dtype() if text else data.dtype
    fill = np.nan if data.dtype.kind == "f" else None
    dataset = group.create_dataset(
        name, data=data.astype(object) if text else data, dtype=dtype, fillvalue=fill, **growing
    )
    if not text:
        dataset.attrs["units"] = units_of(name)
    return dataset
