"""Read exports with other authors' libraries, and the result file with h5py by `docs/results.md`."""

import base64
import csv
import json
from functools import cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import h5py
import numpy as np
import pytest

Values = dict[str, tuple[np.ndarray, str]]
"""By the name of a quantity: its values at the points, shape (rows, columns), and its unit."""
NOT_EXPORTED = {"noise_std_px", "bias_u_px", "bias_v_px", "iterations"}
PLACES = ("X_mm", "Y_mm")


def truth(path: Path, camera: str, k: int) -> Values:
    """Return the values of the result file for the image with the index `k` of a series or of a camera."""
    with h5py.File(path) as file:
        series = file[f"cameras/{camera}/series" if camera else "series"]
        values = _of_group(series, k, "")
        place, row = series.get("corrected"), k
        both = file.get("both")
        if both is not None and camera in both.attrs["cameras"]:
            step = file[f"cameras/{camera}/steps/index"][k]
            (rows,) = np.flatnonzero(both["step"][:] == step) if step in both["step"][:] else (-1,)
            if rows >= 0 and both["applied"][rows]:
                place, row = both[f"{camera}/corrected"], rows
        applied = place is not None and bool(np.isfinite(place["exx"][row]).any())
        if applied:
            values |= _of_group(place, row, "corrected_")
        active = series["active"][:].astype(bool)
        values["active"] = active, "1"
    return values


def _of_group(group: Any, k: int, before: str) -> Values:
    found = {}
    for name, dataset in group.items():
        if isinstance(dataset, h5py.Dataset) and name not in NOT_EXPORTED:
            if name in PLACES:
                found[before + name] = dataset[:], dataset.attrs["units"]
            elif dataset.ndim == 3 and dataset.dtype.kind in "fu" and dataset.shape[2] > 2:
                found[before + name] = dataset[k], dataset.attrs["units"]
    return found


def read_npz(folder: Path, camera: str, number: int, name: str, shape: tuple[int, int]) -> Values:
    with np.load(folder / "npz" / f"{name}.npz", allow_pickle=False) as file:
        units = json.loads(str(file["units"]))
        return {name: (file[name], units[name]) for name in units}


def read_mat(folder: Path, camera: str, number: int, name: str, shape: tuple[int, int]) -> Values:
    from scipy.io import loadmat

    file = loadmat(folder / "mat" / f"{name}.mat", simplify_cells=True)
    return {name: (file[name], unit) for name, unit in file["units"].items()}


def read_tiff(folder: Path, camera: str, number: int, name: str, shape: tuple[int, int]) -> Values:
    tifffile = pytest.importorskip("tifffile", reason="tifffile is not installed")
    found = {}
    for place in (folder / "tiff" / camera).iterdir():
        fixed = place / f"{place.name}.tif"
        path = fixed if fixed.exists() else place / f"{number:04d}_{name}.tif"
        if path.exists():
            with tifffile.TiffFile(path) as file:
                about = json.loads(file.pages[0].description)
                assert about["quantity"] == place.name
                assert file.asarray().dtype == np.float32
                found[place.name] = file.asarray(), about["unit"]
    return found


def read_csv(folder: Path, camera: str, number: int, name: str, shape: tuple[int, int]) -> Values:
    with (folder / "csv" / f"{name}.csv").open(encoding="utf-8", newline="") as file:
        lines = list(csv.DictReader(file))
    x, y = (np.array([int(line[axis]) for line in lines]) for axis in ("x_px", "y_px"))
    row, column = np.searchsorted(np.unique(y), y), np.searchsorted(np.unique(x), x)
    found = {}
    for key in lines[0].keys() - {"status", "calibration", "local_strain"}:
        values = np.full((row.max() + 1, column.max() + 1), np.nan)
        values[row, column] = [float(line[key] or "nan") for line in lines]
        unit = next((unit for unit in ("px", "mm", "deg") if f"_{unit}" in key), "1")
        found[key] = values, unit
    return found


def read_vtk(folder: Path, camera: str, number: int, name: str, shape: tuple[int, int]) -> Values:
    """Read a ParaView file without VTK: XML and base64 as in the manual "VTK File Formats"."""
    tree = ElementTree.parse(folder / "vtk" / f"{name}.vts")
    found = {}
    for array in tree.iterfind(".//PointData/DataArray"):
        key = array.find("InformationKey")
        data = base64.b64decode(array.text or "")
        assert int.from_bytes(data[:8], "little") == len(data) - 8
        values = np.frombuffer(data[8:], {"Float64": "<f8", "UInt8": "u1"}[array.attrib["type"]])
        parts = int(array.get("NumberOfComponents", 1))
        unit = "1" if key is None else str(key.text)
        found[array.attrib["Name"]] = values.reshape(*shape, *([parts] if parts > 1 else [])), unit
    return found


def read_netcdf(folder: Path, camera: str, number: int, name: str, shape: tuple[int, int]) -> Values:
    return of_dataset(_dataset(folder / "netcdf" / f"{camera or 'series'}.nc"), number)


@cache
def _dataset(path: Path) -> Any:
    xarray = pytest.importorskip("xarray", reason="xarray is not installed")
    pytest.importorskip("h5netcdf", reason="h5netcdf is not installed")
    with xarray.open_dataset(path, engine="h5netcdf") as dataset:
        return dataset.load()


def of_dataset(dataset: Any, number: int) -> Values:
    """Return the values of one image from a dataset of xarray."""
    found = {}
    for name, values in dataset.data_vars.items():
        if "x_px" in values.dims and name != "active":
            here = values.sel(image=number) if "image" in values.dims else values
            found[name] = here.values, here.attrs["units"]
    return found


READERS = {
    "npz": read_npz,
    "mat": read_mat,
    "tiff": read_tiff,
    "csv": read_csv,
    "vtk": read_vtk,
    "netcdf": read_netcdf,
}
