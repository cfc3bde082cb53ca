"""Check output paths before the work begins, so that no result is lost and no input is overwritten."""

import filecmp
import os
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import click

from dic.errors import OutputError
from dic.files.reading import kind_of

PATH = click.Path(path_type=Path)
"""Type of the arguments and options that name files."""
FORCE = click.option("--force", is_flag=True, help="Replace output files that exist already.")

_OTHERS = (".csv", ".txt", ".json", ".xlsx", ".png", ".tif", ".pdf", ".html", ".mat", ".npz")
"""Endings that promise another kind of file than HDF5."""


def require_places(
    inputs: Iterable[Path | None],
    outputs: Iterable[Path | None],
    *,
    force: bool = False,
    replaceable: Iterable[Path] = (),
    new_folders: Iterable[Path] = (),
) -> None:
    """Raise an error if an output file cannot be created, or would replace an input, another output or
    earlier results.

    `inputs`, `outputs`: paths of the files to read and of the files to write. None means that the user did
    not give the option. `force`: True if existing files may be replaced. Folders, devices, pipes and inputs
    are never replaced. `replaceable`: existing files that may be replaced in any case, because an interrupted
    run of the same work wrote them. `new_folders`: folders that will be made before the work begins, with all
    folders above them.

    Raises `OutputError` if an output file cannot be used. The message names the first such file.
    """
    own = {_resolved(path) for path in replaceable}
    made = {_resolved(folder) for folder in new_folders}
    made.update([above for folder in made for above in folder.parents])
    taken = {_resolved(path): "one that is read" for path in inputs if path is not None}
    for path in outputs:
        if path is None:
            continue
        place = _resolved(path)
        got, remedy = taken.get(place) or _obstacle(place, made), "name another place"
        if got is None and place.exists() and not force and place not in own:
            got, remedy = "one that exists", "name another place, or replace it with --force"
        if got is not None:
            raise OutputError(
                str(path),
                "write results",
                "a file of its own in a folder that can be written to",
                got,
                remedy,
            )
        taken[place] = "one that holds other results"


def require_hdf5(path: Path | None, instead: str) -> None:
    """Raise an `OutputError` if an HDF5 file would have the ending of another kind of file, such as .csv.

    `instead`: what to do for a file of that kind.
    """
    if path is not None and path.suffix.lower() in _OTHERS:
        expected, got = "an HDF5 file, such as one that ends with .h5", f"one that ends with {path.suffix}"
        raise OutputError(str(path), "write results", expected, got, instead)


@contextmanager
def same_or_new(folder: Path, *, replace: bool) -> Iterator[Path]:
    """Give a folder for files that are then moved to `folder`, where no file with other content is lost.

    `folder`: a folder that exists. `replace`: True if files with other content may be replaced. Then the
    files are written to `folder` at once.

    Raises `OutputError` if a file with other content is there. Then no file of the folder has changed.
    """
    if replace:
        yield folder
        return
    with TemporaryDirectory(dir=folder, prefix=".") as temporary:
        yield Path(temporary)
        written = sorted(Path(temporary).iterdir())
        for file in written:
            standing = folder / file.name
            if standing.exists() and not filecmp.cmp(file, standing, shallow=False):
                expected, got = "no file, or one with the same content", "one with other content"
                remedy = "name another place, or replace it with --force"
                raise OutputError(str(standing), "write results", expected, got, remedy)
        for file in written:
            file.replace(folder / file.name)


def _resolved(path: Path) -> Path:
    # Use os.path, because Path.resolve raises an error without a reason for a link that leads to itself.
    return Path(os.path.realpath(path))


def _obstacle(place: Path, made: Collection[Path]) -> str | None:
    if place.is_symlink():
        # A resolved path is still a link only if links form a circle.
        return "a link that leads to itself"
    if place.exists() and (kind := kind_of(place.stat().st_mode)):
        return kind
    folder = place.parent
    while folder in made and not folder.exists():
        folder = folder.parent
    if not folder.is_dir():
        return "no such folder"
    if not os.access(place if place.exists() else folder, os.W_OK):
        return "one that is protected"
    return None
