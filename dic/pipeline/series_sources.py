"""Finds the reference and the images of a series, given as files, folders, patterns, pages or arrays."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from os.path import realpath
from pathlib import Path
from typing import Any

from dic.errors import CorrelationError
from dic.image.pages import list_images, split_page
from dic.image.read import read_image
from dic.pipeline.series_order import doubts_about_order
from dic.typing import PathLike


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
