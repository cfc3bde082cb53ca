"""Finds the reference and the images of a series, given as files, folders, patterns, pages or arrays."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from os.path import realpath
from pathlib import Path
from typing import Any

from dic.errors import CorrelationError
from dic.image.pages import in_natural_order, list_images, natural_key, split_page
from dic.image.read import read_image
from dic.image.times import SeriesTimes
from dic.typing import PathLike

_REFERENCE = re.compile(
    r"(?i)(^|[^a-z])(ref|reference|referenz|undeformed|unloaded|unstrained|initial|nullbild|zero)([^a-z]|$)"
)
_TARGET = re.compile(
    r"(?i)(^|[^a-z])(grid|calib\w*|target|che(ss|cker)board|charuco|dots|mask|roi)([^a-z]|$)"
)
_LAST_NUMBER = re.compile(r"\d+")
_MOST_TIMES = 50
"""Number of images whose times are read; a series given in the wrong order shows it at once."""


@dataclass(frozen=True)
class SeriesSources:
    """The files of a series, in order.

    Attributes
    ----------
    reference : Path
        The reference image, or a page of a file.
    images : list of Path
        The images of the deformed specimen, or pages of files.
    notes : list of str
        Sentences about the choice of images for the user: the reference of a stack or folder, and images that
        were left out.
    """

    reference: Path
    images: list[Path]
    notes: list[str] = field(default_factory=list)

    @property
    def files(self) -> list[Path]:
        """All files of the series, including the files that contain pages."""
        return files_of([self.reference, *self.images])

    @classmethod
    def of(
        cls, reference: PathLike, images: Sequence[PathLike] | None = None, *, in_order: bool = False
    ) -> "SeriesSources":
        """Find the files of a series from the names of a reference and of images.

        Parameters
        ----------
        reference : path
            An image file, or a TIFF file of several pages, a video, a folder or a pattern. If it has several
            images, the first image is the reference.
        images : sequence of path, optional
            Files, TIFF files of several pages, videos, folders and patterns. Default: the other images of
            `reference`.
        in_order : bool
            True if the images keep the order in which they are given. By default single files are put into
            the order of the numbers in their names, because a shell sorts them differently.

        Raises
        ------
        ImageError, CorrelationError
            If a folder or a pattern has no images, or if the reference is the only image.
        """
        first, *others = list_images(reference)
        notes = [] if first == Path(reference) else [f"the reference is {first}"]
        if images is None:
            if others or not split_page(first)[0].exists():
                # If the reference does not exist, the later reading raises an error.
                return cls(first, others, notes + doubts_about_order(first, others))
            # Keep the name of a damaged stack or video. The later reading reports the reason.
            read_image(first)
            expected, remedy = "images of the deformed specimen", "name them, or a folder, stack or video"
            raise CorrelationError(str(reference), "list images", expected, "none", remedy)
        listed = list(expanded(images)) if in_order else list_images(*images)
        given = [Path(image) for image in images]
        named, place = set(given), realpath(first)
        kept = [path for path in listed if path in named or realpath(path) != place]
        if len(kept) < len(listed):
            notes.append(f"{first} is the reference, and is not measured again")
        if set(listed) == named and listed != given:
            notes.append(f"in the order of their numbers: {listed[0].name}, {listed[1].name}, …")
        if listed and not kept:
            expected, remedy = "other images than the reference", "name images of the deformed specimen"
            raise CorrelationError(str(reference), "list images", expected, "none", remedy)
        return cls(first, kept, notes + doubts_about_order(first, kept))


def files_of(images: Iterable[Path]) -> list[Path]:
    """Return the files that contain the images; some images may be pages of a file."""
    return [split_page(path)[0] for path in images]


def expanded(images: Iterable[Any]) -> Iterable[Any]:
    """Return images one by one, with all images of each folder, pattern and TIFF file of several pages."""
    for image in images:
        yield from list_images(image) if isinstance(image, str | Path) else [image]


def only_paths(images: Iterable[Any]) -> bool:
    """Return True if all images are given by paths."""
    return all(isinstance(image, str | Path) for image in images)


def doubts_about_order(reference: Path, images: Sequence[Path]) -> list[str]:
    """Return a sentence if the reference seems to be a deformed image: by its name, its number or its time.

    Strain between swapped images has the wrong sign and, at large strain, the wrong size; nothing else shows
    it.
    """
    named = [image for image in images if _REFERENCE.search(image.stem)]
    own = _REFERENCE.search(reference.stem) or _REFERENCE.fullmatch(reference.parent.name)
    if named and not own:
        return [_doubt(reference, f"{named[0].name}, which is named as a reference, is measured against it")]
    if images and _TARGET.search(reference.stem) and not _TARGET.search(images[-1].stem):
        return [f"is {reference.name} the reference? It is named as a calibration target; give another first"]
    every = [Path(path.name) for path in (*images, reference)]
    if images and _begin_alike(every) and in_natural_order(every)[-1].name == reference.name:
        return [_doubt(reference, "all other images come before it by their names")]
    if _rolls_over(every):
        why = "the numbers of the names run over from the largest to the smallest"
        return [f"is {reference.name} the reference? {why}; give the images in their order, one by one"]
    clock = SeriesTimes(reference)
    times = [clock.of(image) for image in images[:_MOST_TIMES]]
    taken = [time.time_s for time in times if time.source in ("exif", "video") and time.time_s is not None]
    if taken and max(taken) < 0.0:
        return [_doubt(reference, "all other images were taken before it")]
    return []


def _rolls_over(paths: Sequence[Path]) -> bool:
    """Return whether the counter of a camera has begun again, as in DSC_9998, DSC_9999, DSC_0001."""
    if len(paths) < 2 or not _begin_alike(paths):
        return False
    counters = [_LAST_NUMBER.findall(path.stem)[-1:] for path in paths]
    texts = [each[0] for each in counters if each]
    numbers = sorted(map(int, texts))
    digits = {len(text) for text in texts}
    if len(texts) < len(paths) or len(digits) != 1:
        return False
    most = 10 ** digits.pop()
    gap = max(after - before for before, after in pairwise(numbers))
    return numbers[0] <= len(paths) and numbers[-1] >= most - 1 - len(paths) and gap > 0.5 * most


def _begin_alike(paths: Sequence[Path]) -> bool:
    """Return whether names differ in numbers only, so that their order is that of the images."""
    shapes = {tuple(text for _, text in natural_key(path)[::2]) for path in paths}
    return len(shapes) == 1 and len(set(paths)) == len(paths)


def _doubt(reference: Path, why: str) -> str:
    return f"is {reference.name} the reference? {why}; swapped images give strain of the wrong sign"
