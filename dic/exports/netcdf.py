"""Export as netCDF-4: one file for a series, with dimensions image, y_px and x_px.

A netCDF-4 file is an HDF5 file whose dimensions are stored as HDF5 dimension scales (netCDF User's Guide,
appendix on the netCDF-4 file format). So h5py can write the file image by image, without a netCDF library.
"""

from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from dic.exports.image import FIXED, Exporter, ExportImage, ExportSeries, long_name
from dic.files.writing import replacing
from dic.hdf5.writing import NewFile

_GRID = ("y_px", "x_px")


class NetcdfExporter(Exporter):
    """Writes one netCDF-4 file, which xarray, netCDF4, MATLAB (`ncread`) and Panoply can read.

    If an image lacks a quantity, for example because its strain was not corrected, the values are NaN.
    """

    def __init__(self, folder: Path, series: ExportSeries) -> None:
        super().__init__(folder, series)
        self._place, self._count = ExitStack(), 0
        self._new: NewFile | None = None

    def add(self, image: ExportImage) -> None:
        """Append an image."""
        if self._new is None:
            self._create(image)
        file, n, points = self._file, self._count, image.points
        self._count = n + 1
        file["image"].resize(n + 1, axis=0)
        file["image"][n] = image.number
        rows: dict[str, Any] = {"label": points.label, **image.known}
        rows |= {name: value for name, value in points.values.items() if name not in FIXED}
        for name, value in rows.items():
            dataset = file[name] if name in file else self._new_rows(name, value)
            dataset.resize(n + 1, axis=0)
            dataset[n] = np.where(points.active, value, np.nan) if _is_field(value) else value
        for name in FIXED:
            if name in points.values and name not in file:
                self._described(name, points.values[name], _GRID)
        if self._new is not None:
            self._new.require_written()

    def finish(self) -> None:
        """Extend all variables to the number of images, and give the file its final name."""
        if self._new is not None:
            for dataset in self._file.values():
                if dataset.maxshape[0] is None:
                    dataset.resize(self._count, axis=0)
            self._new.close()
        self._place.close()

    def abandon(self) -> None:
        """Close and delete the unfinished file."""
        if self._new is not None:
            # The first error of writing has been raised already.
            with suppress(OSError):
                self._new.close()
        error = OSError("the export has ended early")
        self._place.__exit__(type(error), error, None)

    @property
    def _file(self) -> Any:
        """The open file; None before the first image."""
        return None if self._new is None else self._new.hdf5

    def _create(self, image: ExportImage) -> None:
        path = self.folder / f"{self.series.name}.nc"
        partial = self._place.enter_context(replacing(path))
        self._new = NewFile(partial, path, track_order=True)
        file = self._file
        file.attrs.update({"Conventions": "CF-1.11", **self.series.about})
        numbers = file.create_dataset("image", (0,), np.int32, maxshape=(None,), chunks=(256,))
        numbers.make_scale("image")
        numbers.attrs["long_name"] = "number of the image in the series"
        for name in _GRID:
            scale = file.create_dataset(name, data=getattr(image.points, name).astype(np.int32))
            scale.make_scale(name)
            scale.attrs.update({"units": "px", "long_name": f"place in the reference, {name[0]}"})
        self._described("active", image.points.active.astype(np.uint8), _GRID)

    def _new_rows(self, name: str, value: Any) -> Any:
        """Create a variable with one row per image; a row that is never written contains NaN, 0 or ""."""
        text, shape = isinstance(value, str), np.shape(value)
        dtype = h5py.string_dtype() if text else np.asarray(value).dtype
        packed = {"compression": "gzip", "compression_opts": 1, "shuffle": True} if shape else {}
        dataset = self._file.create_dataset(
            name,
            (0, *shape),
            dtype,
            maxshape=(None, *shape),
            chunks=(1 if shape else 256, *shape),
            fillvalue=np.nan if not text and dtype.kind == "f" else None,
            **packed,
        )
        return self._finished(dataset, name, ("image", *_GRID) if shape else ("image",))

    def _described(self, name: str, value: Any, dimensions: tuple[str, ...]) -> None:
        self._finished(self._file.create_dataset(name, data=value), name, dimensions)

    def _finished(self, dataset: Any, name: str, dimensions: tuple[str, ...]) -> Any:
        for k, dimension in enumerate(dimensions):
            dataset.dims[k].attach_scale(self._file[dimension])
        if name != "label":
            dataset.attrs.update({"units": self.series.unit_of(name), "long_name": long_name(name)})
        if dataset.dtype.kind == "f":
            dataset.attrs["_FillValue"] = np.array([np.nan], dataset.dtype)
        return dataset


def _is_field(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.dtype.kind == "f"
