"""A reference image with everything that determines the correlation with it, also for other processes."""

import pickle
import zlib
from collections.abc import Callable
from functools import cached_property
from threading import Lock

import numpy as np

from dic.correlation.correlator import Correlator
from dic.correlation.earlier_field import EarlierField
from dic.correlation.field import Field
from dic.correlation.settings import CorrelationSettings
from dic.image.given import fixed
from dic.typing import Float, ImageLike, Mask, PathLike

Region = Mask | PathLike | None

_received_last: dict[bytes, "Reference"] = {}
"""The references that other processes have sent, by their content; the reference used last is at the end."""


def forget_references(kept: int) -> None:
    """Forget the references that other processes have sent, except the `kept` ones that were used last."""
    for content in list(_received_last)[: max(0, len(_received_last) - kept)]:
        del _received_last[content]


class Reference:
    """A reference image with everything that determines the correlation with it.

    The reference is prepared when it is first used. Another process gets the place of the image and not the
    prepared data, and prepares the reference for itself.

    `read`: function that returns the image, or its path. The function must be picklable if images are
    correlated in other processes. `region`: function that returns the region of interest as for `Correlator`.
    It is called at the first use. `clip`, `within`, `hint_decides`, `threads`: as for `Correlator`. In
    another process, `threads` is 0.
    """

    def __init__(
        self,
        read: Callable[[], ImageLike],
        region: Callable[[], Region],
        settings: CorrelationSettings | None,
        *,
        clip: bool,
        within: Mask | None = None,
        hint_decides: bool = True,
        threads: int = 0,
    ) -> None:
        self._read, self._find_region, self._settings = read, region, settings
        self._clip, self._within, self._threads = clip, within, threads
        self._hint_decides = hint_decides
        self._lock = Lock()

    @cached_property
    def _region(self) -> Region:
        return self._find_region()

    @cached_property
    def prepared(self) -> Correlator:
        """The correlator of the reference."""
        return Correlator(
            self._read(), self._region, self._settings,
            clip=self._clip, within=self._within, hint_decides=self._hint_decides, threads=self._threads,
            copy=False,
        )  # fmt: skip

    def correlate(self, deformed: ImageLike, earlier: EarlierField | None, hint: Float | None) -> Field:
        """Return the field from the reference to the image `deformed`; see `Correlator.correlate_after`.

        Several threads may call this method. They then correlate one image after the other, because a
        correlator keeps data for the next image.
        """
        with self._lock:
            return self.prepared.correlate_after(earlier, deformed, hint)

    @cached_property
    def _content(self) -> bytes:
        # Regions are large, but compress to a few kilobytes.
        parts = (self._read, self._region, self._settings, self._clip, self._within, self._hint_decides)
        return zlib.compress(pickle.dumps(parts), 1)

    def __reduce__(self) -> tuple[Callable[[bytes], "Reference"], tuple[bytes]]:
        return _received, (self._content,)


def _received(content: bytes) -> Reference:
    """Return the reference that another process has sent; the same reference is prepared only once."""
    reference = _received_last.pop(content, None)
    if reference is None:
        read, region, settings, clip, within, hint_decides = pickle.loads(zlib.decompress(content))
        if isinstance(region, np.ndarray):
            # Nobody else has this array, so the correlator needs no copy of it.
            fixed(region)
        reference = Reference(
            read, lambda: region, settings, clip=clip, within=within, hint_decides=hint_decides
        )
    _received_last[content] = reference
    return reference
