"""Write calibrations to HDF5 files, and read them."""

from __future__ import annotations

import json
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from dic.calibration.bicubic import BicubicMap
from dic.calibration.calibration import Calibration, FittedTo, Model
from dic.calibration.grid_making import GridAccuracy
from dic.calibration.pinhole.camera import Pinhole
from dic.calibration.pinhole.prior import KnownCamera
from dic.errors import CalibrationError, require_kind
from dic.files.writing import reason, replacing
from dic.hdf5.open import NotReadable, open_hdf5
from dic.hdf5.writing import NewFile
from dic.targets.points import GridPoints

if TYPE_CHECKING:
    import h5py

_FORMAT = "offaxis-calibration"
_VERSION = 2
_READABLE = (1, 2)
_PINHOLE_UNITS = {
    "focal_px": "px",
    "principal_px": "px",
    "distortion": "px^-2, px^-4, px^-1, px^-1, then px^-6 and px^(1 - degree)",
    "rotation": "1",
    "centre_mm": "mm",
    "covariance": "products of px, px, px, px^-2, px^-4, px^-1, px^-1, rad, rad, rad, mm, mm, mm, and more",
    "noise_px": "px",
    "cross_validation_px": "px",
}
_ACCURACY_UNITS = {"scale_ratio_std": "1", "skew_std": "rad", "flatness_std_mm": "mm"}
_DEVIATION_UNITS = {
    "deviations": "1, 1, mm, mm, mm",
    "deviation_covariance": "products of 1, 1, mm, mm, mm",
    "by_deviations": "units of the covariance by 1, 1, mm, mm, mm",
}
"""Datasets of the pinhole model that files without deviations of the grid do not have."""

# Names in the file that differ from the attribute's name. Older files use the same names.
_KEYS = {"cross_validation_px": "left_out_px"}


def save_calibration(calibration: Calibration, path: str | Path) -> None:
    """Write a calibration file.

    The data are first written to a temporary file in the same folder. The temporary file is then renamed to
    `path`. So a crash leaves no incomplete file at `path`.

    Raises
    ------
    CalibrationError
        If the file cannot be written.
    """
    require_kind("calibration", calibration, Calibration, "fit it first: dic.calibrate_images(image, target)")
    path = Path(path)
    try:
        with replacing(path) as partial, closing(NewFile(partial)) as new:
            new.hdf5.attrs.update(file_format=_FORMAT, file_format_version=_VERSION)
            write_calibration(new.hdf5, calibration)
    except OSError as error:
        raise CalibrationError(
            str(path),
            "write calibration",
            "a file that can be written",
            reason(error),
            "choose another folder with -o, or free disk space",
        ) from error


def load_calibration(path: str | Path) -> Calibration:
    """Read a calibration file.

    Raises
    ------
    CalibrationError
        If the file is missing, truncated or not a calibration file.
    """
    path = Path(path)
    try:
        with open_hdf5(path) as file:
            if file.attrs.get("file_format") != _FORMAT:
                raise _refusal(path, "an HDF5 file of another kind")
            if file.attrs["file_format_version"] not in _READABLE:
                raise _refusal(path, f"version {file.attrs['file_format_version']}, newer than this program")
            return read_calibration(file)
    except NotReadable as error:
        raise _refusal(path, str(error)) from error
    except CalibrationError:
        raise
    except Exception as error:
        # A damaged file can cause any exception here. The `try` block only reads the file.
        raise _refusal(path, f"a calibration that lacks some of its data ({type(error).__name__})") from error


def write_calibration(group: h5py.Group, calibration: Calibration) -> None:
    """Write a calibration into an open HDF5 group; `docs/calibration.md` describes the layout."""
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
        "bicubic/coefficient_errors": (bicubic.coefficient_errors, "mm"),
        "bicubic/left_out_px": (calibration.bicubic_cross_validation_px, "px"),
        "residual_mm": (calibration.residual_mm, "mm"),
        "residual_px": (calibration.residual_px, "px"),
        "image_shape": (np.array(calibration.image_shape), "px"),
        "images": (calibration.images, "1"),
        "plate_mm": (calibration.plate_mm, "mm"),
    }
    if calibration.pinhole is not None:
        for name, units in {**_PINHOLE_UNITS, **_DEVIATION_UNITS}.items():
            datasets[f"pinhole/{_KEYS.get(name, name)}"] = (getattr(calibration.pinhole, name), units)
    for model, residuals in calibration.residuals.items():
        datasets[f"{model}/residual_mm"] = (residuals.mm, "mm")
        datasets[f"{model}/residual_px"] = (residuals.px, "px")
    group.attrs.update(
        source=calibration.source,
        warnings="\n".join(grid.warnings),
        orientation=grid.orientation,
        model=calibration.model,
        recommendation=calibration.recommendation,
        pinhole_problem=calibration.pinhole_problem,
    )
    if calibration.fitted_to is not None:
        datasets |= _of_fit(calibration.fitted_to)
        group.attrs["known_camera"] = json.dumps(vars(calibration.fitted_to.known or KnownCamera()))
    for name, (value, units) in datasets.items():
        group.create_dataset(name, data=value).attrs["units"] = units


def _of_fit(to: FittedTo) -> dict[str, tuple[Any, str]]:
    """Return what a fit of the same images needs, beside the grid points of the first."""
    stds = zip(_ACCURACY_UNITS.items(), to.accuracy.stds, strict=True)
    datasets: dict[str, tuple[Any, str]] = {f"grid/{name}": (std, unit) for (name, unit), std in stds}
    datasets["grid/nominal_mm"] = (to.grids[0].xy_mm, "mm")
    for number, grid in enumerate(to.grids[1:], 2):
        datasets[f"more/{number}/nominal_mm"] = (grid.xy_mm, "mm")
        datasets[f"more/{number}/index"] = (grid.index, "1")
        datasets[f"more/{number}/uv_px"] = (grid.uv_px, "px")
    return datasets


def read_calibration(group: h5py.Group) -> Calibration:
    """Read a calibration from an open HDF5 group, or raise `KeyError` if data are missing."""
    shape = group["image_shape"][:]
    image_shape = (int(shape[0]), int(shape[1]))
    bicubic = group["bicubic"]
    calibration = Calibration(
        bicubic=BicubicMap(
            coefficients=bicubic["coefficients"][:],
            centre_px=bicubic["centre_px"][:],
            scale_px=float(bicubic["scale_px"][()]),
        ),
        grid=_read_grid(group),
        image_shape=image_shape,
        source=str(group.attrs["source"]),
        pinhole_problem="it comes from a file of version 1, which has none",
    )
    if "model" not in group.attrs:
        return calibration
    return replace(
        calibration,
        bicubic=replace(calibration.bicubic, coefficient_errors=bicubic["coefficient_errors"][:]),
        pinhole=_read_pinhole(group["pinhole"]) if "pinhole" in group else None,
        pinhole_problem=str(group.attrs["pinhole_problem"]),
        bicubic_cross_validation_px=float(bicubic["left_out_px"][()]),
        images=int(group["images"][()]),
        fitted_to=_read_fit(group, image_shape),
        plate_mm=float(group["plate_mm"][()]) if "plate_mm" in group else 0.0,
    ).using(cast(Model, str(group.attrs["model"])))


def _read_grid(group: h5py.Group) -> GridPoints:
    texts, lines = str(group.attrs["warnings"]), group["grid/lines"][:]
    return GridPoints(
        index=group["grid/index"][:],
        xy_mm=group["grid/xy_mm"][:],
        uv_px=group["grid/uv_px"][:],
        lines=(int(lines[0]), int(lines[1])),
        pitch_mm=float(group["grid/pitch_mm"][()]),
        warnings=tuple(texts.split("\n")) if texts else (),
        orientation=str(group.attrs.get("orientation", "assumed")),
    )


def _read_fit(group: h5py.Group, image_shape: tuple[int, int]) -> FittedTo | None:
    if "known_camera" not in group.attrs:
        return None
    stds: dict[str, Any] = {name: float(group[f"grid/{name}"][()]) for name in _ACCURACY_UNITS}
    lines = tuple(map(int, group["grid/lines"][:]))
    pitch_mm = float(group["grid/pitch_mm"][()])
    numbers = sorted(group.get("more", ()), key=int)
    images = [group["grid"], *(group[f"more/{number}"] for number in numbers)]
    grids = tuple(
        GridPoints(
            image["index"][:], image["nominal_mm"][:], image["uv_px"][:], (lines[0], lines[1]), pitch_mm
        )
        for image in images
    )
    known = KnownCamera(**json.loads(str(group.attrs["known_camera"])))
    return FittedTo(grids, image_shape, known, GridAccuracy(**stds))


def _read_pinhole(group: h5py.Group) -> Pinhole:
    later = [name for name in _DEVIATION_UNITS if name in group]
    return Pinhole(**{name: group[_KEYS.get(name, name)][()] for name in [*_PINHOLE_UNITS, *later]})


def _refusal(path: Path, got: str) -> CalibrationError:
    return CalibrationError(
        str(path),
        "read calibration",
        f"a calibration file of version {_READABLE[0]} to {_READABLE[-1]}",
        got,
        "write it again with `dic calibrate IMAGE -o FILE`",
    )
