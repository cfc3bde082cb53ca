"""The arrangement of the dots of a plate: a square grid, or rows of which every second one is shifted.

In an asymmetric grid every second row is shifted by half a pitch. The dots of an asymmetric grid also form a
square lattice, but this lattice is turned by 45°. Each lattice vector goes half a pitch along the row and
half a pitch across the row. So the two arrangements differ in their outline only. The sides of the
rectangular outline are parallel to the squares of the lattice, or to the diagonals of the squares.
"""

from dataclasses import dataclass

import numpy as np

from dic.typing import Float, Indices

# For an asymmetric grid, index @ _DIAGONALS converts a lattice index to numbers of half pitches along and
# across the rows.
_DIAGONALS = np.array([[1, -1], [1, 1]], np.int64)


@dataclass(frozen=True)
class Arrangement:
    """The rectangle that the dots fill."""

    asymmetric: bool
    """True if the sides of the rectangle are diagonals of the lattice's squares."""
    box: tuple[int, int]
    """Number of places along each of the two sides. A place is one lattice point, or half a pitch if
    `asymmetric`.
    """
    counts: tuple[int, int]
    """Numbers of dots along both directions. For an asymmetric grid: number of dots in a row, and number of
    rows.
    """
    filled: float
    """Share of the places in the rectangle that have dots."""

    @classmethod
    def of(cls, index: Indices, marked: bool = False) -> "Arrangement":
        """Return the arrangement whose places the dots with the given lattice indices (n, 2) fill best.

        In the image, the second direction of the lattice is anticlockwise from the first. If the plate is
        `marked`, it has hollow dots as marks; the rows of such a plate are always rows of the lattice.
        """
        plain, steps = _box(index), half_pitches(index)
        width, height = _box(steps)
        square = cls(False, plain, plain, len(index) / (plain[0] * plain[1]))
        filled = len(index) / ((width * height + 1) // 2)
        if marked or filled <= square.filled:
            return square
        # An asymmetric grid with an even number of rows can also be read as a grid whose columns are the
        # rows. Take the reading in which the top row begins at the left.
        begins_left = bool((steps[0] - steps.min(axis=0)).sum() % 2 == 0) == (height % 2 == 1)
        across = height % 2 == 1 if (width + height) % 2 else begins_left
        counts = ((width + 1) // 2, height) if across else ((height + 1) // 2, width)
        return cls(True, (width, height), counts, filled)

    @property
    def in_turn(self) -> bool:
        """True if every second row of an asymmetric grid has one dot less than the other rows."""
        return self.asymmetric and self.box[0] % 2 == 1 and self.box[1] % 2 == 1

    @property
    def options(self) -> str:
        """The option of the commands that describes the arrangement."""
        return f"--{'asymmetric-' if self.asymmetric else ''}dots {self.counts[0]}x{self.counts[1]}"

    def __str__(self) -> str:
        first, second = self.counts
        if self.in_turn:
            return f"{second} rows of {first} and {first - 1} dots in turn"
        return f"{'an asymmetric grid' if self.asymmetric else 'a lattice'} of {first} × {second} dots"


def half_pitches(index: Indices) -> Indices:
    """Return lattice indices (n, 2) as numbers of half pitches along and across the rows of a grid."""
    steps: Indices = index @ _DIAGONALS
    return steps


def half_pitch_vectors(vectors_px: Float) -> Float:
    """Return the vectors (2, 2), px, of half a pitch along and across the rows, from the lattice vectors."""
    # The inverse of the diagonals is half of their transpose.
    vectors: Float = _DIAGONALS.T @ vectors_px / 2
    return vectors


def _box(index: Indices) -> tuple[int, int]:
    """Return how many lattice points the indices (n, 2) span along each of the two directions."""
    width, height = (int(extent) + 1 for extent in np.ptp(index, axis=0))
    return width, height
