"""The content of an export: images of a series, one at a time, with values, units and device readings."""

import re
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from dic.image.pages import split_page
from dic.image.video import is_video
from dic.results.points import CORRECTED, RAW, PointValues
from dic.results.readings import unit_of_reading
from dic.results.schema import units_of

FIXED = ("X_mm", "Y_mm")
"""Values that are the same in all images of a series: the points' positions in the reference."""
LONG_NAMES = {
    "u_px": "displacement to the right", "v_px": "displacement downwards",
    "std_u_px": "standard deviation of u_px", "std_v_px": "standard deviation of v_px",
    "zncc": "zero-normalised cross-correlation coefficient", "status": "0 converged, else the reason",
    "X_mm": "place in the grid's axes, to the right", "Y_mm": "place in the grid's axes, upwards",
    "U_mm": "displacement to the right", "V_mm": "displacement upwards",
    "valid": "1 within the calibrated area", "e1": "first principal strain", "e2": "second principal strain",
    "exx": "normal strain to the right", "eyy": "normal strain upwards", "exy": "shear strain",
    "direction_deg": "direction of e1 from x towards y",
}  # fmt: skip


@dataclass(frozen=True)
class ExportSeries:
    """Properties that all images of an export share."""

    camera: str
    """Name of the camera of a run; "" for a series of images."""
    about: Mapping[str, str | float]
    """Where the results come from and how they were made."""
    count: int
    """Number of images."""
    channels: Mapping[str, str] = field(default_factory=dict)
    """The units of the values of channels."""

    @property
    def name(self) -> str:
        """Name of a file that contains the whole series."""
        return file_name(self.camera) or "series"

    def unit_of(self, name: str) -> str:
        """Return the unit of a value, a reading, or the value of a channel."""
        return self.channels.get(name) or unit_of(name)


@dataclass(frozen=True)
class ExportImage:
    """The results of one image, to be exported."""

    number: int
    """Number of the image in the series, from 1. Images that could not be measured are also counted."""
    name: str
    """Name of the image's files, without suffix."""
    points: PointValues
    known: Mapping[str, float]
    """Known readings and values of channels at a run's step, and time_s."""
    row: Mapping[str, Any]
    """The image's row in the table of mean strains, in the form that `write_strain_table` needs. A run's row
    has the best correction of the step.
    """


class Exporter(ABC):
    """Writes a series of images in one format; of earlier images it keeps at most the mean strains.

    The folder for the files of this format must exist.
    """

    def __init__(self, folder: Path, series: ExportSeries) -> None:
        self.folder, self.series = folder, series

    @abstractmethod
    def add(self, image: ExportImage) -> None:
        """Write an image."""

    def finish(self) -> None:  # noqa: B027 - most formats have no more to write
        """Write the files that describe the whole series; called after the last image."""

    def abandon(self) -> None:  # noqa: B027 - most formats write each file whole
        """Remove files that are not complete; called after an error."""


def long_name(name: str) -> str:
    """Return the description of an exported value, in words, from its name such as "exx_std"."""
    bare = name.removeprefix(CORRECTED).removeprefix(RAW)
    text = LONG_NAMES.get(bare, bare)
    for ending, what in (("_std_images", "part that the images cause"), ("_std", "standard deviation")):
        if bare.endswith(ending):
            text = f"{what} of {bare.removesuffix(ending)}"
            break
    return text if bare == name else f"{text}, {name.removesuffix(bare).rstrip('_')}"


def units(names: Iterable[str]) -> dict[str, str]:
    """Return a dict of the units of exported values, keyed by their names."""
    return {name: unit_of(name) for name in names}


def unit_of(name: str) -> str:
    """Return the unit of a value or a reading: "px", "mm", "deg", "N", "s", or "1" for none."""
    return unit_of_reading(name) or units_of(name)


def file_name(text: str) -> str:
    """Return a text as a valid file name: other characters than letters, digits and ".+-_" become "_"."""
    return re.sub(r"[^\w.+-]+", "_", text)


def unique_names(stems: Sequence[str], taken: Iterable[str] = ()) -> list[str]:
    """Return a unique file name for each image; the image's number is put before a repeated name.

    `stems`: names of the images without their endings. `taken`: names of other files, which no image may
    have.
    """
    others = list(taken)
    counts = Counter([*stems, *others])
    numbered = [f"{number:04d}_{stem}" for number, stem in enumerate(stems, 1)]
    names = [new if counts[stem] > 1 else stem for new, stem in zip(numbered, stems, strict=True)]
    # A numbered name may be equal to the name of another image, such as 0001_a if two images are named a.
    return names if len({*names, *others}) == len(names) + len(others) else numbered


def stem_of(label: str | Path) -> str:
    """Return the name of an image without suffix; the number of a page or video frame is appended."""
    file, page = split_page(Path(label))
    kind = "frame" if is_video(file) else "page"
    return file.stem if page is None else f"{file.stem}_{kind}{page}"
