"""An image of a series: where it is, its name and its digest, and the expected motion of the specimen."""

import os
import platform
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from dic.errors import ImageError, WorkerError
from dic.files.digest import file_sha256
from dic.files.reading import opened
from dic.image.given import grey_levels
from dic.image.kept import file_identity
from dic.image.pages import split_page
from dic.image.times import ImageTime
from dic.results.job import content_of
from dic.typing import Float, ImageLike

UNREADABLE = "unreadable"
"""This text replaces the digest of an image that cannot be read."""


@dataclass(frozen=True)
class SeriesImage:
    """An image of a series, with its name and the expected motion of the specimen in the image.

    Attributes
    ----------
    image : ndarray, shape (height, width), or path, or callable
        A function without arguments returns the image when it is needed.
    label : str
        Name of the image in results.
    hint : ndarray, shape (3, 3), optional
        Expected homography from the reference image to this image, for example from `rigid_motion`.
    digest : str
        SHA-256 of the image's file or frames; "" if it is not known.
    time : ImageTime
        When the image was taken.
    identity : tuple of int
        Identity of the image's file when its digest was computed; empty if it is not known. Another process
        on the same computer need not read a file of this identity again for its digest.
    made_in : (str, int)
        The computer and the process in which the object was made.
    """

    image: ImageLike | Callable[[], ImageLike]
    label: str
    hint: Float | None = None
    digest: str = ""
    time: ImageTime = field(default_factory=ImageTime)
    identity: tuple[int, ...] = ()
    made_in: tuple[str, int] = field(default_factory=lambda: (platform.node(), os.getpid()))

    @property
    def content(self) -> str:
        """Text that identifies the content of the image, and the expected motion; see `content_of`."""
        known = self.digest if self.digest != UNREADABLE else ""
        if known and isinstance(self.image, str | Path):
            known = of_page(known, Path(self.image))
        return content_of(known, () if self.hint is None else self.hint.ravel())

    def read(self) -> ImageLike:
        """Return the image or its path; if the image is given by a function, call the function.

        Raises
        ------
        WorkerError
            If another process made this object, and this process finds another image in the same place.
        ImageError
            If the process that made this object could not read the image's file, or if the file contains
            another image by now.
        """
        here = platform.node(), os.getpid()
        if here != self.made_in and self.digest == UNREADABLE:
            expected, remedy = "a file that the command can read", "give the command a file that it can read"
            raise ImageError(self.label, "read image", expected, "none", remedy)
        if here != self.made_in and self.digest and self._digest_here() != self.digest:
            raise WorkerError(
                f"{self.label}, read on {here[0]}",
                "read image",
                "the image that the command reads",
                "none that can be read" if self._digest_here() == UNREADABLE else "another one",
                "give all workers the same files under the same paths",
            )
        if here == self.made_in and self._is_replaced():
            expected, remedy = "the image whose digest was computed", "write each image to a file of its own"
            raise ImageError(self.label, "read image", expected, "another one", remedy)
        return self.image() if callable(self.image) else self.image

    def _is_replaced(self) -> bool:
        """Return True if the image's file has been changed since its digest was computed."""
        if not self.identity or not isinstance(self.image, str | Path):
            return False
        # A file that cannot be read any more is reported by the reader.
        return self._digest_here() not in (self.digest, UNREADABLE)

    @property
    def state(self) -> Callable[[], object] | None:
        """Function that returns the state of the image's source, for `KeptImage`; None if it has none."""
        if isinstance(self.image, str | Path):
            return partial(file_identity, self.image)
        return getattr(self.image, "digest", None)

    def grey(self) -> NDArray[Any]:
        """Return the grey levels of the image, shape (height, width), as `grey_levels` returns them."""
        return grey_levels(self.read(), "deformed image")

    def __getstate__(self) -> dict[str, Any]:
        # Another process may work in another folder.
        path = self.image.absolute() if isinstance(self.image, Path) else self.image
        return vars(self) | {"image": path}

    def _digest_here(self) -> str:
        if isinstance(self.image, str | Path):
            if self.made_in[0] == platform.node() and _is_unchanged(Path(self.image), self.identity):
                return self.digest
            return _DIGESTS.of(Path(self.image))
        found = getattr(self.image, "digest", None)
        return self.digest if found is None else str(found())


class KnownImage:
    """A function that returns an image that this process has read; another process reads the image itself.

    Parameters
    ----------
    image : SeriesImage
    grey : ndarray, shape (height, width)
        The grey levels of the image, as `grey_levels` or `read_image` return them.
    """

    def __init__(self, image: SeriesImage, grey: NDArray[Any]) -> None:
        self._image, self._grey = image, grey

    def __call__(self) -> ImageLike:
        """Return the grey levels."""
        return self._grey

    def __reduce__(self) -> tuple[Callable[[SeriesImage], Callable[[], ImageLike]], tuple[SeriesImage]]:
        return _reader, (self._image,)


def _reader(image: SeriesImage) -> Callable[[], ImageLike]:
    return image.read


def _is_unchanged(image: Path, identity: tuple[int, ...]) -> bool:
    """Return True if the file that contains an image has the given identity."""
    return bool(identity) and file_identity(image) == identity


def of_page(digest: str, image: Path) -> str:
    """Return a text that identifies an image by the digest of its file, and by its page if it has one."""
    page = split_page(image)[1]
    return digest if page is None else f"{digest}#{page}"


_MOST_BYTES = 2**36
"""Largest file (64 GiB) that is read as a whole to compute a digest, even if it is a stack of images."""


class FileDigests:
    """SHA-256 digests of files. Each file is read once, and again only if it has changed."""

    def __init__(self) -> None:
        self._known: dict[tuple[int, ...], str] = {}

    def of(self, image: Path) -> str:
        """Return the digest of the file that contains an image; `UNREADABLE` if the file cannot be read."""
        return self.identified(image)[0]

    def identified(self, image: Path) -> tuple[str, tuple[int, ...]]:
        """Return the result of `of`, and the identity of the file that has this digest."""
        try:
            return self._of_file(split_page(image)[0])
        except OSError:
            # The reader of the image will report the reason.
            return UNREADABLE, ()

    def of_file(self, file: Path) -> str:
        """Return the digest of a file.

        Raises
        ------
        OSError
            If the file cannot be read.
        """
        return self._of_file(file)[0]

    def _of_file(self, file: Path) -> tuple[str, tuple[int, ...]]:
        with opened(file) as content:
            identity = content.identity
        if identity not in self._known:
            self._known[identity] = file_sha256(file, _MOST_BYTES)
        return self._known[identity], identity


_DIGESTS = FileDigests()
"""Digests of files that contain images which other processes have sent."""
