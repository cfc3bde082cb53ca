"""The run files that paths name: files, and folders of run files."""

import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from dic.errors import RunFileError
from dic.hdf5.open import NotReadable, open_hdf5
from dic.image.pages import natural_key
from dic.runfile.schema import CONTINUES, FORMAT
from dic.runfile.values import read_object, read_text
from dic.typing import PathLike

_PATTERN = "*.h5"


@dataclass(frozen=True)
class RunFiles:
    """The run files that paths name.

    Attributes
    ----------
    paths : list of Path
    continued : dict of Path to Path
        The files of folders that are left out, because another run of the folder continues them. Each has the
        file of the run that continues it and contains its steps.
    """

    paths: list[Path]
    continued: dict[Path, Path]


def list_run_files(paths: Iterable[PathLike]) -> RunFiles:
    """Return run files: the given files in their order, and of each folder its run files in natural order.

    Of a folder, HDF5 files of other kinds, such as result files, are left out. A run that another run of the
    folder continues is left out too, because its steps are measured with the other run. A file of a folder
    that cannot be read is returned, so that its reader gives the reason. A file that is named twice is
    returned once, with its first name.

    Raises
    ------
    RunFileError
        If a folder contains no run file.
    """
    found: dict[Path, Path] = {}
    continued: dict[Path, Path] = {}
    for path in map(Path, paths):
        if not path.is_dir():
            found.setdefault(_at(path), path)
            continue
        files = sorted(
            (file for file in path.glob(_PATTERN) if not file.name.startswith(".")), key=natural_key
        )
        earlier = {file: _earlier_of(file) for file in files}
        inside = {file: name for file, name in earlier.items() if name is not None}
        later = {path / name: file for file, name in inside.items() if name and name != file.name}
        continued |= {file: later[file] for file in inside if file in later}
        if not inside.keys() - later.keys():
            expected, remedy = (
                f"a folder with run files ({_PATTERN})",
                "name the run files, or another folder",
            )
            raise RunFileError(str(path), "list runs", expected, "none", remedy)
        for file in (each for each in inside if each not in later):
            found.setdefault(_at(file), file)
    left_out = {file: by for file, by in continued.items() if _at(file) not in found}
    return RunFiles(list(found.values()), left_out)


def _at(path: Path) -> Path:
    """Return the place of a file. A link to a file is not followed, because it has results of its own."""
    return Path(os.path.realpath(path.parent), path.name)


def _earlier_of(path: Path) -> str | None:
    """Return the name of the file that a run continues; "" if there is none, None if it is no run file."""
    try:
        with open_hdf5(path) as file:
            if file.attrs.get("file_format") != FORMAT:
                return None
            known = read_object(read_text(file["entry"][CONTINUES.name]))
            return str((known or {}).get("file", ""))
    except (NotReadable, OSError, KeyError, ValueError, TypeError):
        return ""
