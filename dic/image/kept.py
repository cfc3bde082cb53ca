"""The image of a series that is correlated now, and that may later be used again as a reference."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from dic.errors import ImageError, collected_warnings
from dic.files.reading import opened
from dic.image.given import grey_levels, kept, name_of
from dic.image.pages import split_page
from dic.image.stored import is_large
from dic.typing import ImageLike


def file_identity(image: str | Path) -> tuple[int, ...]:
    """Return the identity of the file that contains an image; empty if the file cannot be opened."""
    try:
        with opened(split_page(Path(image))[0]) as content:
            return content.identity
    except OSError:
        # The reader of the image will report the reason.
        return ()


class KeptImage:
    """A function that returns the same image each time, even if its array or its file is changed meanwhile.

    A camera program may write each image into the same array or file. If an image becomes a reference after
    its correlation, its array or file may already contain the next image.

    `read` returns the image, or its path. `state` returns a value by which a changed source is recognised,
    such as a digest; by default the identity of a file is used, and arrays are copied. `again` is False if
    the image will not be needed after its correlation.
    """

    def __init__(
        self, read: Callable[[], ImageLike], state: Callable[[], object] | None = None, *, again: bool = True
    ) -> None:
        self._read, self._state, self._again = read, state, again
        self._grey: NDArray[Any] | None = None
        self._known: object = None
        self._name = "deformed image"

    def __call__(self) -> NDArray[Any]:
        """Return the grey levels of the image, shape (height, width), as `grey_levels` returns them.

        Raises `ImageError` if the image must be read again, and its source contains another image than
        before, and `MeasurementError` if the image cannot be read.
        """
        if self._grey is None:
            self._grey = self._first() if self._known is None else self._second()
        return self._grey

    def correlated(self) -> None:
        """Free the memory of an image that is not needed again, and of a large image that can be read again.

        The image would otherwise be in memory during its evaluation.
        """
        if self._grey is None or (self._again and not (self._known and is_large(self._grey.shape))):
            return
        self._grey = None

    def _first(self) -> NDArray[Any]:
        # Note the state before the reading: a change during the reading is then a change, too.
        state = None if self._state is None else self._state()
        given = self._read()
        if state is None and isinstance(given, str | Path):
            state = file_identity(given)
        grey = grey_levels(given, self._name)
        self._known, self._name = state, name_of(given, self._name)
        return kept(grey, given) if self._again and state is None else grey

    def _second(self) -> NDArray[Any]:
        with collected_warnings():
            # The first reading has given these warnings already.
            given = self._read()
            grey = grey_levels(given, self._name)
        # Compare after the reading: a change during the reading is then a change, too.
        if self._state is not None:
            state = self._state()
        else:
            state = file_identity(given) if isinstance(given, str | Path) else None
        if state != self._known:
            raise ImageError(
                self._name,
                "read image again as reference",
                "the image that was correlated",
                "another one",
                "write each image to a file of its own, or give the series without new references",
            )
        return grey
