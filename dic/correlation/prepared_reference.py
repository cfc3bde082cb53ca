"""What is prepared of a reference once, for all deformed images that are correlated with it."""

from dataclasses import dataclass, field

from dic.correlation import kernel
from dic.correlation.settings import CorrelationSettings
from dic.image.point_grid import PointGrid
from dic.typing import Mask

_LARGEST = 4.25
"""Most memory for prepared subsets, in images of float32: enough for quadratic ones at a step of 5 px."""


class SubsetMemory:
    """What IC-GN has prepared of a reference's subsets, kept for the later images of a series.

    Nothing is kept of a pair, because only a second image can use it; nor if it would take more than
    `_LARGEST` times the memory of the reference image. Results are the same with and without.
    """

    def __init__(self) -> None:
        self._images = 0
        self._prepared: kernel.Prepared | None = None

    def for_next_image(self, grid: PointGrid, image_px: int, parameters: int) -> kernel.Prepared | None:
        """Return what the next image may use and shall fill; None for the first image of a reference."""
        self._images += 1
        if self._images == 2:
            size = 4 * kernel.record_length(parameters) * grid.active.size
            if size <= _LARGEST * 4 * image_px:
                self._prepared = kernel.Prepared.empty(grid.active.shape, parameters)
        return self._prepared

    @property
    def kept_bytes(self) -> int:
        """How much memory is set aside."""
        return 0 if self._prepared is None else sum(part.nbytes for part in self._prepared)


@dataclass(frozen=True)
class PreparedReference:
    """All of a reference that does not depend on the deformed image.

    Attributes
    ----------
    image : kernel.Reference
    mean : float
        Mean grey level of the reference, which the kernel subtracts from all images.
    usable : ndarray of bool, shape (height, width)
        Pixels that subsets may use.
    grid : PointGrid
    settings : CorrelationSettings
    threads : int
    memory : SubsetMemory
    """

    image: kernel.Reference
    mean: float
    usable: Mask
    grid: PointGrid
    settings: CorrelationSettings
    threads: int
    memory: SubsetMemory = field(default_factory=SubsetMemory)
