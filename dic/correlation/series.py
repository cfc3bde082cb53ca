"""A series of images measured against its first image, by way of later references if necessary.

Large deformation and changing patterns make subsets look different from those of the reference. Then the
image before becomes the reference, and the displacements from there on are chained to those before. Every
update of the reference adds its error, so it is updated only when the correlation drops.
"""

from dataclasses import dataclass, replace

import numpy as np

from dic.correlation.chaining import chain, moved_region
from dic.correlation.correlator import Correlator
from dic.correlation.field import Field
from dic.correlation.settings import CorrelationSettings
from dic.errors import CorrelationError
from dic.image.given import grey_image
from dic.typing import Float, Grey, ImageLike, Mask, PathLike

INCREMENTAL = ("auto", "never", "always")

_KEPT_SHARE = 0.98
"""Share of the converged points that must still converge for a reference to be kept."""


@dataclass(frozen=True)
class _LastImage:
    """The last image, and its fields from the current reference and from the first one."""

    image: Grey
    from_current: Field
    from_first: Field


@dataclass(frozen=True)
class _CurrentReference:
    """The current reference of a series.

    Attributes
    ----------
    correlator : Correlator
    before : Field or None
        From the first reference to this one; None if this is the first.
    updates : int
        How many references there were before.
    quality : (float, float) or None
        Share of converged points and median ZNCC of the first image that was correlated with it.
    last : _LastImage or None
    """

    correlator: Correlator
    before: Field | None = None
    updates: int = 0
    quality: tuple[float, float] | None = None
    last: _LastImage | None = None

    def correlate(self, deformed: Grey, hint: Float | None) -> Field:
        """Return the field from this reference."""
        previous = None if self.last is None else self.last.from_current
        return self.correlator.correlate(
            deformed, previous=previous, hint=hint if self.before is None else None
        )

    def has_dropped(self, field: Field) -> bool:
        """Tell whether the correlation has dropped since the reference was new.

        It has if more than 2 % of the points are lost, or half of the margin between ZNCC and its limit.
        """
        if self.quality is None:
            return False
        (share, zncc), (first_share, first_zncc) = _quality(field), self.quality
        limit = (first_zncc + self.correlator.settings.min_zncc) / 2
        return share < _KEPT_SHARE * first_share or zncc < limit


class Series:
    """Correlates images, in their order, with the first reference.

    The memory it takes does not grow with the number of images.

    Parameters
    ----------
    reference : ndarray, shape (height, width), or path
        Grey levels, or an image file.
    region : ndarray of bool, shape (height, width), or path, optional
        Where to measure. Without one, points are put wherever the reference has texture.
    settings : CorrelationSettings, optional
    incremental : str
        "never" compares every image with the reference itself; "always" with the image before; "auto" with
        the reference until correlation drops, then with the last image that was well correlated.
    clip : bool, optional
        Whether subsets use only pixels of the region. By default they do if a region is given.
    threads : int
        How many to work with; 0 for as many as there are processors.

    Raises
    ------
    CorrelationError
        If the image cannot be used, the region holds no point, or a setting is unknown.
    """

    def __init__(
        self,
        reference: ImageLike,
        region: Mask | PathLike | None = None,
        settings: CorrelationSettings | None = None,
        *,
        incremental: str = "auto",
        clip: bool | None = None,
        threads: int = 0,
    ) -> None:
        self.require_incremental(incremental)
        self._incremental, self._threads = incremental, threads
        self._clip = region is not None if clip is None else clip
        first = Correlator(reference, region, settings, clip=self._clip, threads=threads)
        self._current, self._first_region = _CurrentReference(first), first.region

    @staticmethod
    def require_incremental(incremental: str) -> None:
        """Refuse a way of taking new references that there is not.

        Raises
        ------
        CorrelationError
        """
        if incremental not in INCREMENTAL:
            raise CorrelationError(
                "settings",
                "incremental correlation",
                " or ".join(INCREMENTAL),
                str(incremental),
                "give auto to take a new reference where the correlation drops",
            )

    @property
    def settings(self) -> CorrelationSettings:
        """How the images are correlated."""
        return self._current.correlator.settings

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the images, px."""
        height, width = self._first_region.shape
        return height, width

    @property
    def updates(self) -> int:
        """How many times the reference has been replaced so far."""
        return self._current.updates

    def correlate(self, deformed: ImageLike, *, hint: Float | None = None) -> Field:
        """Return the displacement field from the first reference to `deformed`.

        After an update of the reference, standard deviations are the roots of the summed variances of all
        parts. They are rather too large, because the noise of the images in between largely cancels.

        Parameters
        ----------
        deformed : ndarray, of the reference's shape, or path
        hint : ndarray, shape (3, 3), optional
            Expected homography from the first reference to this image; not used after an update.

        Raises
        ------
        CorrelationError
            If the image cannot be used, or does not show the pattern.
        """
        deformed = grey_image(deformed, "deformed image")
        reference, field = self._best_reference(deformed, hint)
        chained = field if reference.before is None else chain(reference.before, field)
        quality, last = reference.quality or _quality(field), _LastImage(deformed, field, chained)
        self._current = replace(reference, quality=quality, last=last)
        return chained

    def _best_reference(self, deformed: Grey, hint: Float | None) -> tuple[_CurrentReference, Field]:
        """Return the reference to use for an image, and the field from it."""
        current, last = self._current, self._current.last
        if self._incremental == "never" or last is None:
            return current, current.correlate(deformed, hint)
        if self._incremental == "always":
            updated = self._updated(last)
            return updated, updated.correlate(deformed, hint)
        try:
            field = current.correlate(deformed, hint)
        except CorrelationError:
            updated = self._updated(last)
            return updated, updated.correlate(deformed, None)
        if not current.has_dropped(field):
            return current, field
        try:
            updated = self._updated(last)
            other = updated.correlate(deformed, None)
        except CorrelationError:
            return current, field
        return (updated, other) if _quality(other) > _quality(field) else (current, field)

    def _updated(self, last: _LastImage) -> _CurrentReference:
        """Return the last image as the reference."""
        region = moved_region(self._first_region, last.from_first)
        correlator = Correlator(last.image, region, self.settings, clip=self._clip, threads=self._threads)
        return _CurrentReference(correlator, last.from_first, self._current.updates + 1)


def _quality(field: Field) -> tuple[float, float]:
    """Return the share of points in view that converged, and their median ZNCC."""
    converged = field.converged
    if not converged.any():
        return 0.0, 0.0
    return float(converged.sum() / field.in_view), float(np.median(field.zncc[converged]))
