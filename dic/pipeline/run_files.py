"""The run files that paths name: files, and folders of run files."""

import os
from collections.abc import Iterable
from pathlib import Path

from dic.errors import RunFileError
from dic.hdf5.open import NotReadable, open_hdf5
from dic.image.pages import natural_key
from dic.runfile.schema import FORMAT
from dic.typing import PathLike

_PATTERN = "*.h5"


def list_run_files(paths: Iterable[PathLike]) -> list[Path]:
    """Return run files: the given files in their order, and of each folder its run files in natural order.

    Of a folder, HDF5 files of other kinds, such as result files, are left out. A file of a folder that cannot
    be read is returned, so that its reader gives the reason. A file that is named twice is returned
    once, with its first name.

    Raises
    ------
    RunFileError
        If a folder contains no run file.
    """
    found: dict[Path, Path] = {}
    for path in map(Path, paths):
        if not path.is_dir():
            found.setdefault(_at(path), path)
            continue
        inside = [file for file in path.glob(_PATTERN) if not file.name.startswith(".") and _may_be_run(file)]
        if not inside:
            expected, remedy = (
                f"a folder with run files ({_PATTERN})",
                "name the run files, or another folder",
            )
            raise RunFileError(str(path), "list runs", expected, "none", remedy)
        for file in sorted(inside, key=natural_key):
            found.setdefault(_at(file), file)
    return list(found.values())


def _at(path: Path) -> Path:
    """Return the place of a file. A link to a file is not followed, because it has results of its own."""
    return Path(os.path.realpath(path.parent), path.name)


def _may_be_run(path: Path) -> bool:
    try:
        with open_hdf5(path) as file:
            return bool(file.attrs.get("file_format") == FORMAT)
    except (NotReadable, OSError):
        return True
