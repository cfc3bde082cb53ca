"""The state of a series of images: its current reference, and the fields from which first guesses come."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from dic.correlation.earlier_field import EarlierField
from dic.correlation.field import Field
from dic.correlation.reference import Reference
from dic.typing import Float, ImageLike

GUESS_DISTANCE = 8
"""Distance in images from which the first guess of an image comes.

A larger distance lets more processors work at the same time. A smaller distance makes the guess better if the
specimen moves far from image to image.
"""

_KEPT_SHARE = 0.98
"""A reference is replaced if the fraction of converged points falls below this multiple of a first value.

The first value is the fraction in the first image that was correlated with the reference.
"""


@dataclass(frozen=True)
class SeriesFields:
    """The fields of an image of a series."""

    from_first: Field
    """The field from the first reference to the image, which is the result."""
    earlier: EarlierField | None = None
    """The parts of the field from the image's own reference with which later images begin. None if this
    reference is the first one; then the parts are those of `from_first`.
    """
    quality: tuple[float, float] | None = None
    """The quality of the field from the image's own reference, or None in the same way; see `quality_of`."""


@dataclass(frozen=True)
class LastImage:
    """Functions that return the last image and its fields, for the case that it becomes a reference."""

    read: Callable[[], ImageLike]
    fields: Callable[[], SeriesFields]


@dataclass(frozen=True)
class Attempt:
    """One correlation of an image: with which reference, and from which first guess."""

    reference: Reference
    earlier: EarlierField | None
    """The field of an earlier image."""
    hint: Float | None
    """Shape (3, 3). Expected homography from the reference to the image."""

    def correlate(self, deformed: ImageLike) -> Field:
        """Return the field from the reference to the image `deformed`."""
        return self.reference.correlate(deformed, self.earlier, self.hint)

    def equals(self, other: "Attempt") -> bool:
        """Return True if both attempts have the same result."""
        mine, others = (self.reference, self.earlier, self.hint), (other.reference, other.earlier, other.hint)
        return all(a is b for a, b in zip(mine, others, strict=True))


@dataclass(frozen=True)
class CurrentReference:
    """The current reference of a series."""

    image: Reference
    before: Field | None = None
    """The field from the first reference to the current reference. None for the first reference."""
    updates: int = 0
    """Number of earlier references."""
    quality: tuple[float, float] | None = None
    """Fraction of converged points and median ZNCC of the first image that was correlated with the current
    reference.
    """
    last: LastImage | None = None
    guesses: tuple[tuple[int, EarlierField], ...] = ()
    """The number in the series, and the field, of the images from which first guesses come."""

    def attempt(self, number: int, hint: Float | None) -> Attempt:
        """Return the first attempt at the image with this number in the series."""
        far = [field for own, field in self.guesses if own <= number - GUESS_DISTANCE]
        return self._attempt(far[-1] if far else None, hint)

    def nearest_attempt(self, hint: Float | None) -> Attempt:
        """Return the attempt from the field of the last image."""
        return self._attempt(self.guesses[-1][1] if self.guesses else None, hint)

    def _attempt(self, earlier: EarlierField | None, hint: Float | None) -> Attempt:
        return Attempt(self.image, earlier, hint if self.before is None else None)

    def has_dropped(self, field: Field) -> bool:
        """Return True if the correlation has dropped since the first image with the current reference.

        The correlation has dropped if the fraction of converged points has fallen by more than 2 %, or if the
        median ZNCC has lost more than half of its margin above `min_zncc`.
        """
        if self.quality is None:
            return False
        (share, zncc), (first_share, first_zncc) = quality_of(field), self.quality
        limit = (first_zncc + field.settings.min_zncc) / 2
        return share < _KEPT_SHARE * first_share or zncc < limit

    def after(self, number: int, last: LastImage, fields: SeriesFields) -> "CurrentReference":
        """Return the reference after the image with this number, which is the last one, and its fields."""
        guesses = [*self.guesses, (number, fields.earlier or EarlierField.of(fields.from_first))]
        while len(guesses) > 1 and guesses[1][0] <= number + 1 - GUESS_DISTANCE:
            guesses.pop(0)
        quality = self.quality or fields.quality or quality_of(fields.from_first)
        return replace(self, quality=quality, last=last, guesses=tuple(guesses))


def quality_of(field: Field) -> tuple[float, float]:
    """Return the fraction of points in view that converged, and the median ZNCC of the converged points."""
    converged = field.converged
    if not converged.any():
        return 0.0, 0.0
    return float(converged.sum() / field.in_view), float(np.median(field.zncc[converged]))
