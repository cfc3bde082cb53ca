"""Run files that paths name, and the regions to measure in the images of their cameras."""

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import Any

from dic.errors import CorrelationError, RunFileError, require_kind
from dic.hdf5.open import NotReadable, open_hdf5
from dic.image.given import checked_region
from dic.image.pages import natural_key
from dic.runfile.joined import open_run
from dic.runfile.reader import RunFile
from dic.runfile.schema import CONTINUES, FORMAT
from dic.runfile.values import read_object, read_text
from dic.typing import Mask, PathLike

_PATTERN = "*.h5"
Region = Mask | PathLike | Callable[[tuple[int, ...]], Mask | None]


@dataclass(frozen=True)
class RunSource:
    """A run file, and the regions to measure in the images of its cameras.

    Attributes
    ----------
    path : path
        The run file.
    regions : mapping of str to (ndarray of bool, path or callable)
        The region to measure, keyed by the camera's name: a mask, shape (height, width), or the path of a
        mask image or of a region file, or a function that returns the mask for the shape (height, width) of
        the camera's images.
        Only the calibrated part of a region is measured. A camera without a region measures the specimen,
        which is found by its speckles.
    grid_from : path, optional
        The run file with the images of the grid, if the run has none, or others are better. Its cameras must
        have stood in the same places. Default: the run itself.
    """

    path: PathLike
    regions: Mapping[str, Region] = field(default_factory=dict)
    grid_from: PathLike | None = None

    def __post_init__(self) -> None:
        require_kind("path", self.path, str | Path, "name a run file")
        require_kind(
            "grid_from", self.grid_from, str | Path | None, "name a run file with images of the grid"
        )

    @contextmanager
    def opened_grid(self, run: RunFile) -> Iterator[RunFile]:
        """Open the run with the images of the grid, which may be the run itself.

        Raises
        ------
        RunFileError
            If there is no image of the grid, or the cameras differ in name or in the size of their images.
        """
        if self.grid_from is None:
            _require_grid(run, "the run has none; name a run with the same cameras by --grid-from")
            yield run
            return
        with open_run(self.grid_from) as other:
            _require_grid(other, "name a run that has images of the grid")
            for camera in run.cameras:
                shape = other.image_shape(camera) if camera in other.cameras else None
                if shape != run.image_shape(camera):
                    height, width = run.image_shape(camera)
                    raise RunFileError(
                        str(other.path),
                        "take the grid from this run",
                        f"images of {camera} of {width} × {height} px, as in {run.path}",
                        "no such camera" if shape is None else f"{shape[1]} × {shape[0]} px",
                        "name a run that the same cameras recorded",
                    )
            yield other

    def masks(self, run: RunFile) -> dict[str, Mask]:
        """Return the regions as masks that have the shape of the cameras' images.

        Raises
        ------
        MeasurementError
            If the run has no camera of that name, or if a region cannot be read or does not fit the images.
        """
        for camera in self.regions:
            if camera not in run.cameras:
                expected, remedy = f"one of {', '.join(run.cameras)}", "name a camera of the run"
                raise CorrelationError(str(run.path), "choose the region", expected, camera, remedy)
        return {camera: _mask(region, run.image_shape(camera)) for camera, region in self.regions.items()}


def _require_grid(run: RunFile, remedy: str) -> None:
    if not any(step.kind == "grid" for step in run.steps):
        raise RunFileError(str(run.path), "calibrate", "an image of the grid", "none", remedy)


def region_digests(masks: Mapping[str, Mask]) -> dict[str, Any]:
    """Return a part of a run's job that names the regions of its cameras; empty without regions.

    Results that were measured without regions have no such part, also results of earlier versions.
    """
    digests = {camera: sha256(mask.tobytes()).hexdigest() for camera, mask in masks.items()}
    return {"regions": digests} if digests else {}


def _mask(region: Region, shape: tuple[int, int]) -> Mask:
    return checked_region(region(shape) if callable(region) else region, shape)


@dataclass(frozen=True)
class RunFiles:
    """The run files that paths name."""

    paths: list[Path]
    continued: dict[Path, Path]
    """The files of folders that are left out, because another run of the folder continues them. Each has the
    file of the run that continues it and contains its steps.
    """


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
