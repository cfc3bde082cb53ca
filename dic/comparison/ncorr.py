"""Reads the result files of Ncorr: MATLAB files of version 7.3, which Ncorr saves, or of versions 5 to 7.

Ncorr 1.2.2 (Blaber, Adair, Antoniou; on GitHub) keeps in `data_dic_save` one displacement and one strain per
image. The arrays have one element for each (spacing + 1)-th pixel of the reference, from the first pixel on:
rows go downwards, columns to the right. The displacements that Ncorr calls "formatted" are in the user's
unit; 1 px is `dispinfo.pixtounits` of these units. If the user has given a coefficient of the lens,
`dispinfo.lenscoef`, then `ncorr_gui_formatdisp.m` has added a radial correction to the displacements.
Corrected displacements are not the displacements in the image. The function in `ncorr.m` that calculates
strains computes Green-Lagrange strain in the axes of the image. Elements outside Ncorr's region are zero.
Ncorr's masks are MATLAB objects, which no other program can read.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from dic.comparison.peer import MOST_BYTES, PeerField, field_of, wrong
from dic.errors import RunFileError
from dic.files.reading import opened
from dic.hdf5.matlab import read_elements
from dic.hdf5.open import NotReadable
from dic.typing import Float

_ROOT = "data_dic_save"
_HDF5 = b"\x89HDF\r\n\x1a\n"
_USER_BLOCK_BYTES = 512
"""A MATLAB file of version 7.3 begins with a heading of this size, in front of the HDF5 content."""
_INFO, _DISPLACEMENTS = "dispinfo", "displacements"
_DISPINFO = ("spacing", "pixtounits", "lenscoef")
_UV = tuple(f"plot_{axis}_ref_formatted" for axis in "uv")
_STRAINS = {f"plot_{name}_ref_formatted": name for name in ("exx", "eyy", "exy")}
_REMEDY = "save the analysis in Ncorr again, with formatted displacements"

Value = Callable[[str, str], Float | None]
"""Function that returns a value from a group of an Ncorr file, such as "displacements"; None if it is
missing.
"""


def read_ncorr(path: Path, number: int = 1) -> PeerField:
    """Read the results of one image from a file of Ncorr; `number` counts the images of the file from 1.

    Raises `RunFileError` if the file cannot be read, lacks this image, or has no "formatted" displacements.
    """
    try:
        with opened(path) as content:
            is_hdf5 = content[_USER_BLOCK_BYTES : _USER_BLOCK_BYTES + len(_HDF5)] == _HDF5
            if not is_hdf5 and len(content) > MOST_BYTES:
                got, remedy = f"{len(content) / 2**20:.0f} MB", "save fewer images in one file"
                raise wrong(path, f"a file of at most {MOST_BYTES / 2**20:.0f} MB", got, remedy)
        return (_from_version_73 if is_hdf5 else _from_version_5)(path, number)
    except OSError as error:
        raise wrong(path, "a file that can be read", str(error.strerror or error), _REMEDY) from error


def is_matlab(path: Path) -> bool:
    """Return True if a file begins like a MATLAB file."""
    try:
        with opened(path) as content:
            return content[:6] == b"MATLAB"
    except OSError:
        return False


def _from_version_73(path: Path, number: int) -> PeerField:
    places = {(_INFO, name): 1 for name in _DISPINFO}
    places |= {(_DISPLACEMENTS, name): number for name in _UV}
    places |= {("strains", name): number for name in _STRAINS}
    try:
        wanted = {"/".join((_ROOT, *place)): element for place, element in places.items()}
        found = dict(zip(places, read_elements(path, wanted).values(), strict=True))
    except NotReadable as error:
        raise wrong(path, f"a MATLAB file with {_ROOT}", str(error), _REMEDY) from error
    _require_number(path, number, found[_DISPLACEMENTS, _UV[0]].count)
    return _field(path, lambda group, name: found[group, name].value)


def _from_version_5(path: Path, number: int) -> PeerField:
    from scipy.io import loadmat

    try:
        root = loadmat(str(path), variable_names=[_ROOT], simplify_cells=True)[_ROOT]
        images = _as_list(root[_DISPLACEMENTS])
    except Exception as error:
        # scipy raises any exception for a damaged file.
        got = f"one that lacks it ({type(error).__name__})"
        raise wrong(path, f"a MATLAB file with {_ROOT}", got, _REMEDY) from error
    _require_number(path, number, len(images))

    def value(group: str, name: str) -> Float | None:
        place = root.get(group)
        if group != _INFO:
            several = [] if place is None else _as_list(place)
            place = several[number - 1] if number <= len(several) else None
        found = None if not isinstance(place, dict) else place.get(name)
        return None if found is None else np.asarray(found, np.float64)

    return _field(path, value)


def _field(path: Path, value: Value) -> PeerField:
    spacing, scale, lens = (_number(value(_INFO, name)) for name in _DISPINFO)
    u, v = (value(_DISPLACEMENTS, name) for name in _UV)
    if u is None or v is None or u.ndim != 2 or u.size == 0 or u.shape != v.shape:
        raise _not_formatted(path)
    if spacing is None or spacing < 0.0 or scale is None or scale <= 0.0:
        raise wrong(path, "dispinfo with spacing and pixtounits", "others", _REMEDY)
    if lens:
        expected, got = "displacements in the image", f"displacements corrected for a lens ({lens:g})"
        remedy = "format the displacements in Ncorr with the lens coefficient 0, and save again"
        raise wrong(path, expected, got, remedy)
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


def _not_formatted(path: Path) -> RunFileError:
    remedy = "choose Analysis, Format Displacements in Ncorr, and save again"
    return wrong(path, "formatted displacements", "none", remedy)


def _require_number(path: Path, number: int, count: int) -> None:
    if count == 0:
        raise _not_formatted(path)
    if not 1 <= number <= count:
        expected = f"an image from 1 to {count}"
        raise wrong(path, expected, str(number), f"give --peer-image {count}")
