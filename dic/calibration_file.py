"""Calibrations as HDF5 files."""

import os
from pathlib import Path

import h5py
import numpy as np

from dic.bicubic import BicubicMap
from dic.calibration import Calibration
from dic.errors import CalibrationError
from dic.grid_points import GridPoints

_FORMAT = "offaxis-calibration"
_VERSION = 1


def save_calibration(calibration: Calibration, path: Path) -> None:
    """Write `calibration` beside `path` first and then move it there, so that a crash leaves no half file.

    Raises
    ------
    CalibrationError
        If the file cannot be written.
    """
    part = path.with_name(path.name + ".part")
    try:
        with h5py.File(part, "w") as file:
            file.attrs.update(file_format=_FORMAT, file_format_version=_VERSION)
            write_calibration(file, calibration)
        part.replace(path)
    except OSError as error:
        raise CalibrationError(
            str(path),
            "write calibration",
            expected="a file that can be written",
            got=os.strerror(error.errno) if error.errno else "an error of the file system",
            remedy="choose another folder or make room",
        ) from error


def load_calibration(path: Path) -> Calibration:
    """Read a calibration file.

    Raises
    ------
    CalibrationError
        If the file is missing, cut off, or no calibration.
    """
    if not path.is_file():
        raise _refusal(path, "no such file")
    try:
        with h5py.File(path, "r") as file:
            if file.attrs.get("file_format") != _FORMAT:
                raise _refusal(path, "an HDF5 file of another kind")
            if file.attrs["file_format_version"] != _VERSION:
                raise _refusal(path, f"version {file.attrs['file_format_version']}, newer than this program")
            return read_calibration(file)
    except KeyError as error:
        raise _refusal(path, "a calibration that lacks some of its data") from error
    except OSError as error:
        raise _refusal(path, "a file that was cut off or is no HDF5") from error


def write_calibration(group: h5py.Group, calibration: Calibration) -> None:
    """Write a calibration into an open HDF5 group."""
    grid, bicubic = calibration.grid, calibration.bicubic
    datasets = {
        "grid/index": (grid.index, "1"),
        "grid/xy_mm": (grid.xy_mm, "mm"),
        "grid/uv_px": (grid.uv_px, "px"),
        "grid/lines": (np.array(grid.lines), "1"),
        "grid/pitch_mm": (grid.pitch_mm, "mm"),
        "bicubic/coefficients": (bicubic.coefficients, "mm"),
        "bicubic/centre_px": (bicubic.centre_px, "px"),
        "bicubic/scale_px": (bicubic.scale_px, "px"),
        "residual_mm": (calibration.residual_mm, "mm"),
        "residual_px": (calibration.residual_px, "px"),
        "image_shape": (np.array(calibration.image_shape), "px"),
    }
    group.attrs.update(source=calibration.source, warnings="\n".join(grid.warnings))
    for name, (value, units) in datasets.items():
        group.create_dataset(name, data=value).attrs["units"] = units


def read_calibration(group: h5py.Group) -> Calibration:
    """Read a calibration from an open HDF5 group; `KeyError` if it lacks something."""
    texts = str(group.attrs["warnings"])
    lines, shape = group["grid/lines"][:], group["image_shape"][:]
    grid = GridPoints(
        index=group["grid/index"][:],
        xy_mm=group["grid/xy_mm"][:],
        uv_px=group["grid/uv_px"][:],
        lines=(int(lines[0]), int(lines[1])),
        pitch_mm=float(group["grid/pitch_mm"][()]),
        warnings=tuple(texts.split("\n")) if texts else (),
    )
    bicubic = BicubicMap(
        coefficients=group["bicubic/coefficients"][:],
        centre_px=group["bicubic/centre_px"][:],
        scale_px=float(group["bicubic/scale_px"][()]),
    )
    return Calibration(bicubic, grid, (int(shape[0]), int(shape[1])), str(group.attrs["source"]))


def _refusal(path: Path, got: str) -> CalibrationError:
    return CalibrationError(
        str(path),
        "read calibration",
        expected=f"a calibration file of version {_VERSION}",
        got=got,
        remedy="make it anew with `dic calibrate`",
    )
