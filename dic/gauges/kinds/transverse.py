"""Many parallel line extensometers, whose strains are averaged."""

from dataclasses import dataclass

import numpy as np

from dic.errors import Check, is_whole
from dic.gauges.declared import LEAST_LINES, size_check
from dic.gauges.kinds.extensometer import Extensometer
from dic.typing import Float

_MOST_LINES = 10_000


@dataclass(frozen=True, kw_only=True)
class TransverseExtensometer(Extensometer):
    """Many parallel line extensometers, whose strains are averaged; for example across a specimen.

    Attributes
    ----------
    start, end : tuple of float
        Ends of the middle line.
    patch : float
        Side length of the square patch at each end of each line.
    spread : float
        Distance between the first and the last line. The middle line lies halfway between them.
    lines : int
        Number of lines, at least 32. A reading needs 32 lines with displacements at both ends.
    """

    kind = "transverse"
    is_axial = False

    spread: float
    lines: int = 40

    def _checks(self) -> list[Check]:
        good = is_whole(self.lines) and LEAST_LINES <= self.lines <= _MOST_LINES
        lines = f"a whole number from {LEAST_LINES} to {_MOST_LINES}"
        return [
            *super()._checks(),
            size_check("spread", self.spread),
            (good, "lines", lines, self.lines, "give lines = 40"),
        ]

    @property
    def offsets(self) -> Float:
        """Distances of the lines from the middle line."""
        return np.linspace(-0.5 * self.spread, 0.5 * self.spread, self.lines)

    @property
    def outline(self) -> Float:
        """Ends of the first and of the last line, in the order around the gauge."""
        (start, end), aside = self.declared_places(), self._aside()
        return np.array([start - aside, start + aside, end + aside, end - aside])

    def drawn_lines(self) -> list[Float]:
        """Return all lines."""
        ends, aside = self.declared_places(), self._aside()
        return [ends + share * aside for share in np.linspace(-1.0, 1.0, self.lines)]

    def _aside(self) -> Float:
        """Return the vector from the middle line to the last line."""
        start, end = self.declared_places()
        direction = (end - start) / np.linalg.norm(end - start)
        return np.asarray(0.5 * self.spread * np.array([-direction[1], direction[0]]))
