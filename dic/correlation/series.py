"""Correlation of a series of images with a first reference, and with later references if necessary.

After a large deformation or a change of the pattern, subsets look different from those of the reference. For
this reason, an earlier image of the series then becomes the new reference. The displacements from the first
to the new reference are added to the displacements from the new reference. Every new reference adds an error,
so the reference changes only when the correlation drops.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from dic.correlation.chaining import chain, moved_region
from dic.correlation.correlator import Correlator
from dic.correlation.field import Field
from dic.correlation.settings import CorrelationSettings
from dic.errors import CorrelationError
from dic.image.given import grey_image
from dic.specimen.find import Specimen
from dic.typing import Float, Grey, ImageLike, Mask, PathLike

INCREMENTAL = ("auto", "never", "always")

_KEPT_SHARE = 0.98
"""A reference is replaced if the fraction of converged points falls below this multiple of a first value.

The first value is the fraction in the first image that was correlated with the reference.
"""


@dataclass(frozen=True)
class SeriesFields:
    """The fields of an image of a series.

    Attributes
    ----------
    from_first : Field
        The field from the first reference to the image, which is the result.
    from_current : Field
        The field from the reference with which the image was correlated. Until the first new reference, both
        fields are the same.
    """

    from_first: Field
    from_current: Field


@dataclass(frozen=True)
class _LastImage:
    """The last image, which is read only if it becomes a reference, and its fields."""

    read: Callable[[], ImageLike]
    fields: SeriesFields


@dataclass(frozen=True)
class _CurrentReference:
    """The current reference of a series.

    Attributes
    ----------
    prepare : callable
        Function that returns the reference's correlator. The function prepares the correlator when it is
        first called.
    before : Field or None
        The field from the first reference to the current reference. None for the first reference.
    updates : int
        Number of earlier references.
    quality : (float, float) or None
        Fraction of converged points and median ZNCC of the first image that was correlated with the current
        reference.
    last : _LastImage or None
    """

    prepare: Callable[[], Correlator]
    before: Field | None = None
    updates: int = 0
    quality: tuple[float, float] | None = None
    last: _LastImage | None = None

    @property
    def correlator(self) -> Correlator:
        """The prepared reference."""
        return self.prepare()

    def correlate(self, deformed: Grey, hint: Float | None) -> Field:
        """Return the field from the current reference to the image `deformed`."""
        previous = None if self.last is None else self.last.fields.from_current
        return self.correlator.correlate(
            deformed, previous=previous, hint=hint if self.before is None else None
        )

    def has_dropped(self, field: Field) -> bool:
        """Return True if the correlation has dropped since the first image with the current reference.

        The correlation has dropped if the fraction of converged points has fallen by more than 2 %, or if the
        median ZNCC has lost more than half of its margin above `min_zncc`.
        """
        if self.quality is None:
            return False
        (share, zncc), (first_share, first_zncc) = _quality(field), self.quality
        limit = (first_zncc + self.correlator.settings.min_zncc) / 2
        return share < _KEPT_SHARE * first_share or zncc < limit


class Series:
    """Correlate the images of a series, in their order, with a first reference.

    The required memory does not grow with the number of images.

    Parameters
    ----------
    reference : ndarray, shape (height, width), or path
        Grey levels, or an image file.
    region : ndarray of bool, shape (height, width), or path, optional
        The region to measure. The default is the specimen, which is found by its speckles.
    settings : CorrelationSettings, optional
    incremental : str
        Rule for new references. With "never", every image is correlated with the first reference. With
        "always", every image is correlated with the image before it. With "auto", a new reference is taken
        when the correlation drops; the new reference is the last image before the drop.
    clip : bool, optional
        True if subsets use only pixels of the region. The default is True, except if the found specimen fills
        the image.
    within : ndarray of bool, shape (height, width), optional
        Limits the points of interest to a part of the specimen. `within` is used only if no region is given.
    threads : int
        Number of threads. 0 means one thread for each processor.

    Raises
    ------
    CorrelationError
        If the image cannot be used, if no point fits in the region, or if a setting is unknown.
    """

    def __init__(
        self,
        reference: ImageLike,
        region: Mask | PathLike | None = None,
        settings: CorrelationSettings | None = None,
        *,
        incremental: str = "auto",
        clip: bool | None = None,
        within: Mask | None = None,
        threads: int = 0,
    ) -> None:
        self.require_incremental(incremental)
        self._incremental, self._threads = incremental, threads
        first = Correlator(
            reference, region, settings, clip=clip is not False, within=within, threads=threads
        )
        specimen = first.specimen
        self._clip = (specimen is None or not specimen.mask.all()) if clip is None else clip
        self._current, self._first_region = _CurrentReference(lambda: first), first.region
        self._settings, self._specimen, self._grid = first.settings, first.specimen, first.grid
        # Smooth later references like the first one, because a different filter would shift the
        # displacements.
        self._later_settings = replace(first.settings, smoothing_px=first.smoothing.width_px)

    def __repr__(self) -> str:
        return f"Series({self._current.correlator!r}, incremental {self._incremental})"

    @staticmethod
    def require_incremental(incremental: str) -> None:
        """Raise an error if `incremental` is not "auto", "never" or "always".

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
        """Settings of the correlation."""
        return self._settings

    @property
    def specimen(self) -> Specimen | None:
        """The specimen that was found in the first reference; None if a region was given."""
        return self._specimen

    @property
    def region(self) -> Mask:
        """The region in which points of the first reference lie, shape (height, width)."""
        return self._first_region

    @property
    def shared(self) -> dict[str, Any]:
        """The attributes that all fields from the first reference share, by their names in `Field`."""
        return {"settings": self._settings, "region": self._first_region, "grid": self._grid}

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the images, px."""
        height, width = self._first_region.shape
        return height, width

    @property
    def updates(self) -> int:
        """Number of times that the reference has been replaced so far."""
        return self._current.updates

    def correlate(self, deformed: ImageLike, *, hint: Float | None = None) -> Field:
        """Return the displacement field from the first reference to the image `deformed`.

        If the reference has been replaced, the variances of all partial displacements are added. The
        resulting standard deviations are somewhat too large, because the noise of the intermediate images
        largely cancels.

        Parameters
        ----------
        deformed : ndarray, of the reference's shape, or path
        hint : ndarray, shape (3, 3), optional
            Expected homography from the first reference to this image. The hint is ignored after the
            reference has been replaced.

        Raises
        ------
        CorrelationError
            If the image cannot be used, or if it does not show the reference's pattern.
        """
        return self.correlate_fields(deformed, hint=hint).from_first

    def correlate_fields(self, deformed: ImageLike, *, hint: Float | None = None) -> SeriesFields:
        """Return the field of `correlate`, together with the field from the current reference.

        The method `accept` of a second `Series` takes these fields. The second series can then go on after
        the image `deformed` without correlating it.
        """
        grey = grey_image(deformed, "deformed image")
        reference, field = self._best_reference(grey, hint)
        fields = SeriesFields(field if reference.before is None else chain(reference.before, field), field)
        self._go_on(reference, lambda: grey, fields)
        return fields

    def accept(self, read: Callable[[], ImageLike], fields: SeriesFields) -> None:
        """Go on after an image that a first `Series` has correlated, without correlating the image again.

        Both series must have equal settings, references and images. All later results then equal those of the
        first series, bit for bit.

        Parameters
        ----------
        read : callable
            Function that returns the image. The function is called only if the image becomes a reference.
        fields : SeriesFields
            The result of `correlate_fields` of the first series for the image.
        """
        reference = self._current
        if reference.last is not None and fields.from_first.updates > reference.updates:
            reference = self._updated(reference.last)
        self._go_on(reference, read, fields)

    def _go_on(
        self, reference: _CurrentReference, read: Callable[[], ImageLike], fields: SeriesFields
    ) -> None:
        quality = reference.quality or _quality(fields.from_current)
        self._current = replace(reference, quality=quality, last=_LastImage(read, fields))

    def _best_reference(self, deformed: Grey, hint: Float | None) -> tuple[_CurrentReference, Field]:
        """Return the reference to use for an image, and the field from this reference to the image."""
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
        """Return the last image as a new reference."""

        @cache
        def prepare() -> Correlator:
            region = moved_region(self._first_region, last.fields.from_first)
            return Correlator(
                last.read(), region, self._later_settings, clip=self._clip, threads=self._threads
            )

        return _CurrentReference(prepare, last.fields.from_first, self._current.updates + 1)


def _quality(field: Field) -> tuple[float, float]:
    """Return the fraction of points in view that converged, and the median ZNCC of the converged points."""
    converged = field.converged
    if not converged.any():
        return 0.0, 0.0
    return float(converged.sum() / field.in_view), float(np.median(field.zncc[converged]))
