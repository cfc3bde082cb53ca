"""Data of a reference that are prepared once for all deformed images."""

from dataclasses import dataclass, field

from dic.correlation import kernel
from dic.correlation.laid_rows import LaidReference
from dic.correlation.settings import CorrelationSettings
from dic.correlation.smoothing import NO_SMOOTHING, Smoothing
from dic.image.point_grid import PointGrid
from dic.image.stored import is_large

_LARGEST = 4.25
"""Largest memory for prepared subsets, as a multiple of the memory of a float32 image.

The limit is high enough for quadratic shape functions at a step of 5 px.
"""


class SubsetMemory:
    """Memory for data of the reference's subsets that IC-GN prepares and uses again for later images.

    No data are kept for the first image, because often there is no second image. No data are kept if they
    would need more than `_LARGEST` times the memory of the reference image, or if the reference is a large
    image, which is prepared in bands to save memory. The results of the correlation do not depend on the kept
    data.
    """

    def __init__(self) -> None:
        self._images = 0
        self._prepared: kernel.Prepared | None = None

    def for_next_image(self, grid: PointGrid, parameters: int) -> kernel.Prepared | None:
        """Return the memory for subset data that the next image may read and fill; None for the first image.

        The result is also None if the data would need too much memory, or if the reference is a large image.
        """
        self._images += 1
        if self._images == 2 and not is_large(grid.usable.shape):
            size = 4 * kernel.record_length(parameters) * grid.active.size
            if size <= _LARGEST * 4 * grid.usable.size:
                self._prepared = kernel.Prepared.empty(grid.active.shape, parameters)
        return self._prepared

    @property
    def kept_bytes(self) -> int:
        """Size of the kept data in bytes."""
        return 0 if self._prepared is None else sum(part.nbytes for part in self._prepared)


@dataclass(frozen=True)
class PreparedReference:
    """All data of a reference that do not depend on the deformed image."""

    image: LaidReference
    mean: float
    """Mean grey level of the reference, which the kernel subtracts from all images."""
    grid: PointGrid
    settings: CorrelationSettings
    threads: int
    smoothing: Smoothing = NO_SMOOTHING
    """The filter that was applied to the reference and must be applied to all images."""
    memory: SubsetMemory = field(default_factory=SubsetMemory)
