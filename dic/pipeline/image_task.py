"""The correlation of one image, as a task for other threads, processes and computers."""

import platform
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from dic.correlation.correlator import Correlator
from dic.correlation.field import Field
from dic.correlation.reference import forget_references
from dic.correlation.series_state import Attempt
from dic.correlation.settings import CorrelationSettings
from dic.errors import CorrelationError, MeasurementError, WorkerError, collected_warnings
from dic.pipeline.series_image import SeriesImage
from dic.results.provenance import versions


@dataclass(frozen=True)
class ImageAnswer:
    """The answer of an `ImageTask`."""

    field: Field | None
    """The field from the attempt's reference to the image, without the region and the grid, which the caller
    knows. None if the image could not be correlated.
    """
    error: MeasurementError | None
    """The reason why the image could not be correlated."""
    warnings: list[tuple[str, str]]
    """Arguments of `warn_of_image`."""
    unread: bool = False
    """True if the image or the reference could not be read."""


@dataclass(frozen=True)
class ImageTask:
    """One attempt at the correlation of an image. The object is called without arguments."""

    attempt: Attempt
    image: SeriesImage
    versions: str
    """The versions of the program that needs the answer; with other versions, the bits of the result could
    differ.
    """
    together: int = 1
    """Number of series whose images are correlated at the same time; each series has a reference."""

    @classmethod
    def of(cls, attempt: Attempt, image: SeriesImage, together: int = 1) -> "ImageTask":
        """Return the task with the versions of this program."""
        return cls(attempt, image, own_versions(), together)

    def __call__(self) -> ImageAnswer:
        """Read the image and correlate it.

        Raises `WorkerError` if the computer that does the task has other versions of offaxis or of its
        libraries.
        """
        if own_versions() != self.versions:
            raise WorkerError(
                f"worker on {platform.node()}",
                "compare versions",
                self.versions,
                own_versions(),
                "install the same versions on all computers",
            )
        # Keep one more, because images are correlated with the earlier reference until a new one is accepted.
        forget_references(self.together + 1)
        with collected_warnings() as warnings:
            try:
                grey = self.image.grey()
            except MeasurementError as error:
                return ImageAnswer(None, error, warnings, unread=True)
            try:
                field = self.attempt.correlate(grey)
            except CorrelationError as error:
                return ImageAnswer(None, error, warnings)
            except MeasurementError as error:
                # The reference, which is prepared at its first use, cannot be read.
                return ImageAnswer(None, error, warnings, unread=True)
        return ImageAnswer(replace(field, region=None, grid=None), None, warnings)


def load_correlation(settings: CorrelationSettings) -> None:
    """Load everything that correlations with these settings need, by one of a small image."""
    side = 4 * settings.subset_px
    grey = np.random.default_rng(0).uniform(0.0, 255.0, (side, side)).astype(np.float32)
    whole = np.ones(grey.shape, np.bool_)
    with collected_warnings():
        few = replace(settings, smoothing_px=0.0, step_px=settings.subset_px)
        Correlator(grey, whole, few).correlate(grey)


own_versions = cache(versions)
"""Function that returns the versions of this process, computed only once."""
