"""A series of images measured against its first, over later references once the first is not recognised.

Large deformation and changing patterns make subsets unlike what they were. The image before then becomes the
reference, and what is measured from there on is added to what the points had done until then. Every update
adds its error, so updates are made only when the correlation drops.
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

_LOST = 0.98
"""Share of the converged points that must remain for a reference to be kept."""


@dataclass(frozen=True)
class _Last:
    """The last image, and its fields from the reference in use and from the first."""

    image: Grey
    part: Field
    total: Field


@dataclass(frozen=True)
class _Link:
    """The reference in use, and what is known of it.

    Attributes
    ----------
    correlator : Correlator
        Of the reference in use.
    before : Field or None
        From the first reference to the one in use; None if it is the first.
    updates : int
        How many references there were before.
    quality : (float, float) or None
        Share of converged points and median ZNCC of the first image that was compared with it.
    last : _Last or None
    """

    correlator: Correlator
    before: Field | None = None
    updates: int = 0
    quality: tuple[float, float] | None = None
    last: _Last | None = None

    def measure(self, deformed: Grey, hint: Float | None) -> Field:
        """Return the field from the reference in use."""
        previous = None if self.last is None else self.last.part
        return self.correlator.correlate(
            deformed, previous=previous, hint=hint if self.before is None else None
        )

    def dropped(self, part: Field) -> bool:
        """Tell whether many points, or half of the margin of ZNCC, were lost since the reference was new."""
        if self.quality is None:
            return False
        (share, zncc), (first_share, first_zncc) = _quality(part), self.quality
        limit = (first_zncc + self.correlator.settings.min_zncc) / 2
        return share < _LOST * first_share or zncc < limit


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
        Whether subsets are clipped at the region's edge; if not told, they are where a region is given.
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
        self._link = _Link(Correlator(reference, region, settings, clip=self._clip, threads=threads))
        self._first_region = self._link.correlator.region

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
        return self._link.correlator.settings

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the images, px."""
        height, width = self._first_region.shape
        return height, width

    @property
    def updates(self) -> int:
        """How many times the reference has been replaced so far."""
        return self._link.updates

    def correlate(self, deformed: ImageLike, *, hint: Float | None = None) -> Field:
        """Return the displacement field from the first reference to `deformed`.

        Where the reference was updated, `std_u_px` and the like are the roots of the summed variances of all
        parts: rather too large, as the noise of the images in between largely cancels.

        Parameters
        ----------
        deformed : ndarray, of the reference's shape, or path
        hint : ndarray, shape (3, 3), optional
            Expected homography from the first reference to this image; not used after an update.

        Raises
        ------
        CorrelationError
            If the image cannot be used, or shows nothing of the pattern.
        """
        deformed = grey_image(deformed, "deformed image")
        link, part = self._measured(deformed, hint)
        total = part if link.before is None else chain(link.before, part)
        self._link = replace(link, quality=link.quality or _quality(part), last=_Last(deformed, part, total))
        return total

    def _measured(self, deformed: Grey, hint: Float | None) -> tuple[_Link, Field]:
        """Return the reference that serves best and the field from it."""
        link, last = self._link, self._link.last
        if self._incremental == "never" or last is None:
            return link, link.measure(deformed, hint)
        if self._incremental == "always":
            link = self._renewed(last)
            return link, link.measure(deformed, hint)
        try:
            part = link.measure(deformed, hint)
        except CorrelationError:
            link = self._renewed(last)
            return link, link.measure(deformed, None)
        if not link.dropped(part):
            return link, part
        try:
            renewed = self._renewed(last)
            other = renewed.measure(deformed, None)
        except CorrelationError:
            return link, part
        return (renewed, other) if _quality(other) > _quality(part) else (link, part)

    def _renewed(self, last: _Last) -> _Link:
        """Return a link whose reference is the last image."""
        region = moved_region(self._first_region, last.total)
        settings = self._link.correlator.settings
        correlator = Correlator(last.image, region, settings, clip=self._clip, threads=self._threads)
        return _Link(correlator, last.total, self._link.updates + 1)


def _quality(field: Field) -> tuple[float, float]:
    """Return the share of points in view that converged, and their median ZNCC."""
    converged = field.converged
    if not converged.any():
        return 0.0, 0.0
    return float(converged.sum() / field.in_view), float(np.median(field.zncc[converged]))
