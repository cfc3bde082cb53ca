"""Repetition: whether a pattern repeats, as cloth or a printed lattice does, and after which displacements.

It is measured in tiles of the reference, because the period may vary over an image, or only a part of the
specimen may repeat.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dic.correlation.tile_lattice import MixedPattern, tile_lattice
from dic.image.stored import StoredImage, everywhere
from dic.specimen.find import SpecimenNotFound
from dic.typing import Float, Grey, Indices, Mask

_TILE_PX = 256

_SMALLEST_TILE_PX = 64

_TILES = {1: 3, 2: 2}
"""Largest number of tiles along an axis, for images as they are and for images reduced to half of their size.

Reduced tiles show periods that are too long for the others.
"""

_LEAST_SHARE = 0.6
"""Smallest share of a tile's pixels that must lie in the region."""

_NEAR = 0.3
"""Vectors of two lattices correspond if they differ by less than this part of their length."""


@dataclass(frozen=True)
class Lattice:
    """The displacements after which a pattern repeats in a part of the image."""

    x_px: float
    y_px: float
    """The middle of the part."""
    vectors: Float
    """Shape (1, 2) for lines or (2, 2). The shortest displacements (x, y) that take the pattern to itself."""
    likeness: float
    """Autocorrelation of the pattern at these displacements, without noise."""
    most_alike: Float
    """Shape (3, 2). The displacements (x, y) with the greatest autocorrelation, which may be longer."""

    @property
    def twins(self) -> Float:
        """The displacements (x, y) to the nearest and the most alike places, shape (n, 2)."""
        multiples = np.array(list(product((-1, 0, 1), repeat=len(self.vectors))))
        nearest = multiples[multiples.any(axis=1)] @ self.vectors
        return np.concatenate([nearest, self.most_alike, -self.most_alike])

    def like(self, other: "Lattice") -> "Lattice | None":
        """Return this lattice with those vectors that are nearest to another's; None if there are none."""
        multiples = np.rint(other.vectors @ np.linalg.pinv(self.vectors))
        vectors = multiples @ self.vectors
        off = np.linalg.norm(vectors - other.vectors, axis=1)
        alike = bool((off < _NEAR * np.hypot(*other.vectors.T)).all())
        return replace(self, vectors=vectors) if alike else None


@dataclass(frozen=True)
class Repetition:
    """A pattern that repeats.

    Attributes
    ----------
    lattices : tuple of Lattice
        The lattices of those parts of the image that repeat, the most alike first.
    """

    lattices: tuple[Lattice, ...]

    @property
    def vectors(self) -> Float:
        """The shortest displacements (x, y) after which the pattern repeats, px, shape (1, 2) or (2, 2)."""
        return self.lattices[0].vectors

    @property
    def periods_px(self) -> Float:
        """The lengths of `vectors`, px."""
        return np.asarray(np.hypot(*self.vectors.T))

    @property
    def directions_deg(self) -> Float:
        """Directions of `vectors`, counter-clockwise from the x axis as seen in the image, from 0 to 180°."""
        return np.asarray(np.degrees(np.arctan2(-self.vectors[:, 1], self.vectors[:, 0])) % 180.0)

    @property
    def likeness(self) -> float:
        """Autocorrelation one period apart; 1 if all periods look the same."""
        return self.lattices[0].likeness

    def vectors_at(self, points: Indices) -> Float:
        """Return the vectors of the lattice nearest to each point (x, y), shape (points, 1 or 2, 2)."""
        return np.array([each.vectors for each in self.lattices])[self._nearest(points)]

    def twins_at(self, points: Indices) -> Float:
        """Return displacements (x, y) after which the pattern looks alike at points, (twins, points, 2).

        These are the nearest ones, and those after which the pattern is most alike.
        """
        return np.moveaxis(np.array([each.twins for each in self.lattices])[self._nearest(points)], 0, 1)

    def _nearest(self, points: Indices) -> Indices:
        middles = np.array([(each.x_px, each.y_px) for each in self.lattices])
        return np.asarray(np.linalg.norm(points[:, None, :] - middles[None], axis=2).argmin(axis=1))

    def __str__(self) -> str:
        each = (
            f"{period_px:.1f} px at {direction:.0f}°"
            for period_px, direction in zip(self.periods_px, self.directions_deg % 179.5, strict=True)
        )
        return "every " + " and ".join(each)

    def as_dict(self) -> dict[str, object]:
        """Return the periods with their directions, and the likeness, for JSON."""
        return {
            "periods_px": [round(float(value), 2) for value in self.periods_px],
            "directions_deg": [round(float(value), 2) for value in self.directions_deg],
            "likeness": self.likeness,
        }


def find_repetition(image: StoredImage, region: Mask) -> Repetition | None:
    """Return how a pattern repeats, or None for a pattern that does not.

    `image`: the reference. `region`, shape (height, width): True for the pixels of the specimen.
    """
    for shrink in _TILES:
        found = _lattices(image, region, shrink)
        if found:
            best = max(found, key=lambda lattice: (len(lattice.vectors), lattice.likeness))
            alike = [best, *(each.like(best) for each in found if each is not best)]
            return Repetition(tuple(each for each in alike if each is not None))
    return None


def _lattices(image: StoredImage, region: Mask, shrink: int) -> list[Lattice]:
    """Return the lattices that tiles of the image show."""
    import cv2

    whole = region.all()
    height, width = region.shape
    left, top, across, down = (0, 0, width, height) if whole else cv2.boundingRect(region.view(np.uint8))
    side = min(shrink * _TILE_PX, down // 2 * 2, across // 2 * 2)
    if side < shrink * _SMALLEST_TILE_PX:
        return []
    found: list[Lattice] = []
    for y, x in product(*(_starts(*each, side, _TILES[shrink]) for each in ((top, down), (left, across)))):
        rows, columns = slice(y, y + side), slice(x, x + side)
        inside = np.ascontiguousarray(region[rows, columns])
        if inside.mean() < _LEAST_SHARE:
            continue
        grey = image.part(rows, columns)
        if shrink > 1:
            size = (side // shrink,) * 2
            grey = np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA))
            inside = cv2.resize(inside.view(np.uint8), size, interpolation=cv2.INTER_NEAREST).view(np.bool_)
        found += [
            Lattice(x + shrink * middle[0], y + shrink * middle[1], shrink * vectors, likeness, shrink * most)
            for middle, (vectors, likeness, most) in _of_tile(grey, inside)
        ]
    return found


def _of_tile(grey: Grey, inside: Mask) -> Iterator[tuple[tuple[float, float], tuple[Float, float, Float]]]:
    """Yield the middles (x, y) and the lattices of a tile, or of parts of a tile of which a part repeats."""
    side = len(grey)
    try:
        lattice = tile_lattice(grey, inside)
    except MixedPattern:
        part = side // 2
        if part >= _SMALLEST_TILE_PX:
            for y, x in product(range(0, part + 1, part // 2), repeat=2):
                here = slice(y, y + part), slice(x, x + part)
                for middle, lattice in _of_tile(grey[here], np.ascontiguousarray(inside[here])):
                    yield (x + middle[0], y + middle[1]), lattice
        return
    if lattice is not None:
        yield (side / 2, side / 2), lattice


def _starts(first: int, length: int, side: int, most: int) -> Indices:
    """Return where tiles begin along an axis, from one end of the region to the other."""
    count = min(most, max(1, -(-length // side)))
    ends = (0, length - side) if count > 1 else ((length - side) / 2,)
    return first + np.rint(np.linspace(ends[0], ends[-1], count)).astype(np.int64)


@contextmanager
def naming_repetition(grey: NDArray[Any]) -> Iterator[None]:
    """Add to the error that no specimen was found how the image repeats, as a pattern of lines does."""
    try:
        yield
    except SpecimenNotFound as error:
        repetition = find_repetition(StoredImage(grey), everywhere(grey.shape))
        if repetition is None:
            raise
        got = f"{error.got}; {repeats(repetition)}"
        raise SpecimenNotFound(error.source, error.step, error.expected, got, error.remedy) from error


_FEW = 0.02
"""A smaller share of declined points is told by their status only."""
REMEDY = (
    "paint random speckle over it, take a larger subset if the lattice has irregularities or marks, or give a"
    " hint that is right within a quarter of the period"
)


def repeats(repetition: Repetition) -> str:
    """Return the beginning of a sentence about a pattern that repeats."""
    return f"the pattern repeats {repetition}"


def remark(repetition: Repetition, declined: float, *, hinted: bool) -> str:
    """Return a sentence on what has decided between the periods of a pattern.

    `declined`: share of the matching points for which nothing has. `hinted`: True if an expected motion has.
    """
    if declined > _FEW:
        share = "" if declined >= 0.995 else f" {100 * declined:.0f} % of"
        return (
            f"{repeats(repetition)}, and nothing shows by how many periods{share} the points have moved;"
            " give a hint, or paint random speckle over it"
        )
    if hinted:
        return f"{repeats(repetition)}; the hint decides by how many periods the points have moved"
    return f"{repeats(repetition)}; the rest of the pattern shows by how many periods the points have moved"
