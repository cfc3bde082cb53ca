"""Reads the result files of Ncorr, which are MATLAB files of the format versions 5 to 7.

Files of version 7.3 are HDF5 with references, which `dic.hdf5` refuses to open. MATLAB can convert them to
version 7.

Ncorr 1.2.2 (Blaber, Adair, Antoniou; on GitHub) keeps in `data_dic_save` one displacement and one strain per
image. The arrays have one element for each (spacing + 1)-th pixel of the reference, from the first pixel on:
rows go downwards, columns to the right. The displacements that Ncorr calls "formatted" are in the user's
unit; 1 px is `dispinfo.pixtounits` of these units. The function in `ncorr.m` that calculates strains computes
Green-Lagrange strain in the axes of the image. Elements outside Ncorr's region are zero. Ncorr's masks are
MATLAB objects, which no other program can read.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from dic.comparison.peer import MOST_BYTES, PeerField, field_of, wrong
from dic.files.reading import opened
from dic.typing import Float

_ROOT = "data_dic_save"
_HDF5 = b"\x89HDF\r\n\x1a\n"
_USER_BLOCK_BYTES = 512
"""A MATLAB file of version 7.3 begins with a heading of this size, in front of the HDF5 content."""
_STRAINS = {f"plot_{name}_ref_formatted": name for name in ("exx", "eyy", "exy")}
_REMEDY = "save the analysis in Ncorr again, with formatted displacements"

Value = Callable[[str, str], Float | None]
"""Function that returns a value from a group of an Ncorr file, such as "displacements"; None if it is
missing.
"""


def read_ncorr(path: Path, number: int = 1) -> PeerField:
    """Read the results of one image from a file of Ncorr; `number` counts the images of the file from 1.

    Raises
    ------
    RunFileError
        If the file cannot be read, lacks this image, or has no "formatted" displacements.
    """
    try:
        with opened(path) as content:
            if len(content) > MOST_BYTES:
                got, remedy = f"{len(content) / 2**20:.0f} MB", "save fewer images in one file"
                raise wrong(path, f"a file of at most {MOST_BYTES / 2**20:.0f} MB", got, remedy)
            is_hdf5 = content[_USER_BLOCK_BYTES : _USER_BLOCK_BYTES + len(_HDF5)] == _HDF5
        if is_hdf5:
            expected, got = "a MATLAB file of version 5 to 7", "one of version 7.3 (HDF5)"
            remedy = "in MATLAB: load the file, then save('new.mat', 'data_dic_save', '-v7')"
            raise wrong(path, expected, got, remedy)
        return _from_version_5(path, number)
    except OSError as error:
        raise wrong(path, "a file that can be read", str(error.strerror or error), _REMEDY) from error


def is_matlab(path: Path) -> bool:
    """Return True if a file begins like a MATLAB file."""
    try:
        with opened(path) as content:
            return content[:6] == b"MATLAB"
    except OSError:
        return False


def _from_version_5(path: Path, number: int) -> PeerField:
    from scipy.io import loadmat

    try:
        root = loadmat(str(path), variable_names=[_ROOT], simplify_cells=True)[_ROOT]
        images = _as_list(root["displacements"])
    except Exception as error:
        # scipy raises any exception for a damaged file.
        got = f"one that lacks it ({type(error).__name__})"
        raise wrong(path, f"a MATLAB file with {_ROOT}", got, _REMEDY) from error
    _require_number(path, number, len(images))

    def value(group: str, name: str) -> Float | None:
        place = root.get(group)
        if group != "dispinfo":
            several = [] if place is None else _as_list(place)
            place = several[number - 1] if number <= len(several) else None
        found = None if not isinstance(place, dict) else place.get(name)
        return None if found is None else np.asarray(found, np.float64)

    return _field(path, value)


def _field(path: Path, value: Value) -> PeerField:
    spacing, scale = (_number(value("dispinfo", name)) for name in ("spacing", "pixtounits"))
    u, v = (value("displacements", f"plot_{axis}_ref_formatted") for axis in "uv")
    if u is None or v is None or u.ndim != 2 or u.size == 0 or u.shape != v.shape:
        expected, got = "formatted displacements", "none"
        raise wrong(path, expected, got, "choose Analysis, Format Displacements in Ncorr, and save again")
    if spacing is None or spacing < 0.0 or scale is None or scale <= 0.0:
        raise wrong(path, "dispinfo with spacing and pixtounits", "others", _REMEDY)
    rows, columns = np.mgrid[: u.shape[0], : u.shape[1]] * (spacing + 1.0)
    found = {"x": columns, "y": rows, "u": u / scale, "v": v / scale}
    for name, own in _STRAINS.items():
        strain = value("strains", name)
        if strain is not None and strain.shape == u.shape:
            found[own] = strain
    use = (u != 0.0) | (v != 0.0)
    flat = {name: np.asarray(values, np.float64).ravel() for name, values in found.items()}
    return field_of("Ncorr", path, flat, use.ravel(), "green-lagrange")


def _number(value: Float | None) -> float | None:
    return None if value is None or value.size != 1 or not np.isfinite(value).all() else float(value.item())


def _as_list(value: Any) -> list[Any]:
    return list(value) if isinstance(value, list | np.ndarray) else [value]


def _require_number(path: Path, number: int, count: int) -> None:
    if not 1 <= number <= count:
        expected = f"an image from 1 to {count}"
        raise wrong(path, expected, str(number), f"give --peer-image {count}")
