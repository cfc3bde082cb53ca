"""Correlation of a series of images with a first reference, and with later references if necessary.

After a large deformation or a change of the pattern, subsets look different from those of the reference. For
this reason, an earlier image of the series then becomes the new reference. The displacements from the first
to the new reference are added to the displacements from the new reference. Every new reference adds an error,
so the reference changes only when the correlation drops.

The first guess of an image comes from an image that lies `GUESS_DISTANCE` images before. So that many images
can be correlated at the same time. The results do not depend on how many really are.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, TypeVar

import numpy as np

from dic.correlation.chaining import chain, moved_region
from dic.correlation.earlier_field import EarlierField
from dic.correlation.field import Field
from dic.correlation.initial_guess import checked_homography
from dic.correlation.reference import Reference
from dic.correlation.series_state import (
    GUESS_DISTANCE,
    Attempt,
    CurrentReference,
    LastImage,
    SeriesFields,
    quality_of,
)
from dic.correlation.settings import CorrelationSettings, ReferenceSettings
from dic.errors import CorrelationError
from dic.image.kept import KeptImage
from dic.specimen.find import Specimen
from dic.typing import Float, ImageLike, Mask, PathLike

_Value = TypeVar("_Value")


class Series:
    """Correlate the images of a series, in their order, with a first reference.

    The required memory does not grow with the number of images.

    Parameters
    ----------
    reference : ndarray, shape (height, width), or path, or callable
        Grey levels, or an image file. A function without arguments returns the image when it is needed.
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
        Limits the points of interest to a part of the region or of the specimen.
    hint_decides : bool
        As for `Correlator`.
    threads : int
        Number of threads. 0 means one thread for each processor.

    Raises
    ------
    CorrelationError
        If the image cannot be used, if no point fits in the region, or if a setting is unknown.
    """

    def __init__(
        self,
        reference: ImageLike | Callable[[], ImageLike],
        region: Mask | PathLike | None = None,
        settings: CorrelationSettings | None = None,
        *,
        incremental: str = "auto",
        clip: bool | None = None,
        within: Mask | None = None,
        hint_decides: bool = True,
        threads: int = 0,
    ) -> None:
        self.require_incremental(incremental)
        self._incremental, self._threads, self._images = incremental, threads, 0
        if isinstance(reference, np.ndarray) and reference.ndim == 2:
            # Parts of an image are prepared when they are used, and the caller may change the array before.
            reference = reference.copy()
        read = reference if callable(reference) else partial(_given, reference)
        image = Reference(
            read, partial(_given, region), settings,
            clip=clip is not False, within=within, hint_decides=hint_decides, threads=threads,
        )  # fmt: skip
        self._first_image, first = image, image.prepared
        specimen = first.specimen
        self._clip = (specimen is None or not specimen.mask.all()) if clip is None else clip
        self._current, self._first_region = CurrentReference(image), first.region
        self._settings, self._specimen, self._grid = first.settings, first.specimen, first.grid
        # Smooth later references like the first one, because a different filter would shift the
        # displacements.
        self._later_settings = replace(first.settings, smoothing_px=first.smoothing.width_px)
        self._shown = repr(first)

    def __repr__(self) -> str:
        return f"Series({self._shown}, incremental {self._incremental})"

    @staticmethod
    def require_incremental(incremental: str) -> None:
        """Raise an error if `incremental` is not "auto", "never" or "always".

        Raises
        ------
        CorrelationError
        """
        ReferenceSettings(incremental)

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
        """Return the field of `correlate`, together with the data with which later images begin.

        The method `accept` of a second `Series` takes these fields. The second series can then go on after
        the image `deformed` without correlating it.
        """
        hint = None if hint is None else checked_homography(hint)
        return self.correlate_image(partial(_given, deformed), hint)

    def correlate_image(
        self, read: Callable[[], ImageLike], hint: Float | None, state: Callable[[], object] | None = None
    ) -> SeriesFields:
        """Return the fields of `correlate_fields` of the image that the function `read` returns.

        Parameters
        ----------
        read : callable
            Function that returns the image, or its path.
        hint : ndarray, shape (3, 3), or None
            As for `correlate`.
        state : callable, optional
            Function that returns the state of the image's source; see `KeptImage`.
        """
        image = KeptImage(read, state, again=self._incremental != "never")
        try:
            return self.follow(lambda attempt: attempt.correlate(image()), image, hint)
        finally:
            image.correlated()

    def correlate_still(self, image: ImageLike) -> Field:
        """Return the field from the first reference to an image that does not belong to the series.

        Raises `CorrelationError` if the image cannot be used, or does not show the reference's pattern.
        """
        attempt = CurrentReference(self._first_image).attempt(0, None)
        return self.completed(attempt, attempt.correlate(image))

    @property
    def at_once(self) -> int:
        """Largest number of images that can be correlated at the same time."""
        return 1 if self._incremental == "always" else GUESS_DISTANCE

    def expected_attempt(self, ahead: int, hint: Float | None) -> Attempt:
        """Return the first attempt at an image, if no earlier image becomes a reference.

        Parameters
        ----------
        ahead : int
            Number of images before this image that have not been correlated, less than `at_once`.
        hint : ndarray, shape (3, 3), or None
            As for `correlate`.
        """
        return self._current.attempt(self._images + ahead, hint)

    def follow(
        self, correlate: Callable[[Attempt], Field], read: Callable[[], ImageLike], hint: Float | None
    ) -> SeriesFields:
        """Return the fields of `correlate_fields`, of the next image, which `correlate` correlates.

        Parameters
        ----------
        correlate : callable
            Function that returns the field from an attempt's reference to the image. It is mostly called
            once. It raises a `CorrelationError` if the image cannot be correlated.
        read : callable
            Function that returns the image. The function is called only if the image becomes a reference.
        hint : ndarray, shape (3, 3), or None
            As for `correlate`.
        """
        number = self._images
        self._images += 1
        reference, field = self._best_reference(correlate, number, hint)
        fields = SeriesFields(field)
        if reference.before is not None:
            fields = SeriesFields(chain(reference.before, field), EarlierField.of(field), quality_of(field))
        self._current = reference.after(number, LastImage(read, partial(_given, fields)), fields)
        return fields

    def completed(self, attempt: Attempt, field: Field) -> Field:
        """Return a field with the region and the grid that all fields from the first reference share.

        Only the displacements of a field from a later reference are used, so it stays as it is.
        """
        return replace(field, **self.shared) if attempt.reference is self._first_image else field

    def accept(self, read: Callable[[], ImageLike], fields: SeriesFields | None) -> None:
        """Go on after an image that a first `Series` has correlated, without correlating the image again.

        Both series must have equal settings, references and images. All later results then equal those of the
        first series, bit for bit.

        Parameters
        ----------
        read : callable
            Function that returns the image. The function is called only if the image becomes a reference.
        fields : SeriesFields or None
            The result of `correlate_fields` of the first series for the image. None if the image could not be
            correlated.
        """
        number, reference = self._images, self._current
        self._images += 1
        if fields is None:
            return
        if reference.last is not None and fields.from_first.updates > reference.updates:
            reference = self._updated(reference.last)
        self._current = reference.after(number, LastImage(read, partial(_given, fields)), fields)

    def keep_last_elsewhere(self, fields: Callable[[], SeriesFields]) -> None:
        """Forget the fields of the last image; the function `fields` reads them again.

        Parameters
        ----------
        fields : callable
            Function that returns the fields; it is called only if the image becomes a reference.
        """
        last = self._current.last
        if last is not None:
            self._current = replace(self._current, last=replace(last, fields=fields))

    def _best_reference(
        self, correlate: Callable[[Attempt], Field], number: int, hint: Float | None
    ) -> tuple[CurrentReference, Field]:
        """Return the reference to use for an image, and the field from this reference to the image."""
        current, last = self._current, self._current.last
        if self._incremental == "always" and last is not None:
            updated = self._updated(last)
            return updated, correlate(updated.attempt(number, hint))
        if self._incremental == "never" or last is None:
            return current, self._field(correlate, number, hint)
        try:
            field = self._field(correlate, number, hint)
        except CorrelationError as error:
            try:
                updated = self._updated(last)
            except CorrelationError:
                raise error from None
            return updated, correlate(updated.attempt(number, None))
        if not current.has_dropped(field):
            return current, field
        try:
            updated = self._updated(last)
            other = correlate(updated.attempt(number, None))
        except CorrelationError:
            return current, field
        return (updated, other) if quality_of(other) > quality_of(field) else (current, field)

    def _field(self, correlate: Callable[[Attempt], Field], number: int, hint: Float | None) -> Field:
        """Return the field from the current reference; if necessary, begin from the last image's field."""
        first, nearest = self._current.attempt(number, hint), self._current.nearest_attempt(hint)
        if nearest.equals(first):
            return correlate(first)
        try:
            field = correlate(first)
        except CorrelationError:
            return correlate(nearest)
        if self._incremental == "never" or not self._current.has_dropped(field):
            return field
        try:
            other = correlate(nearest)
        except CorrelationError:
            return field
        return other if quality_of(other) > quality_of(field) else field

    def _updated(self, last: LastImage) -> CurrentReference:
        """Return the last image as a new reference."""
        before = last.fields().from_first
        if not before.converged.any():
            raise CorrelationError(
                "last image",
                "take it as the new reference",
                "points with a displacement",
                "none",
                "see why the last image was not measured",
            )
        region = partial(moved_region, self._first_region, before)
        reference = Reference(last.read, region, self._later_settings, clip=self._clip, threads=self._threads)
        return CurrentReference(reference, before, self._current.updates + 1)


def _given(value: _Value) -> _Value:
    """Return the argument; in contrast to a lambda, other processes can be given this function."""
    return value
