"""Textures that are defined by formulas: a speckle pattern and a calibration grid.

A texture can be evaluated at any material position, so its image is exact at every sub-pixel displacement.
Reflectance is between 0 (black) and 1 (white). Positions are material coordinates in mm.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from simulators.scene.jit import compiled

Array = NDArray[np.float64]

DARK = 0.08
BRIGHT = 0.92


class Texture(Protocol):
    """A texture: its reflectance is defined at every material point."""

    @property
    def quadrature_order(self) -> int:
        """Number of Gauss points per pixel and direction.

        For this number of points, the integration error is far below the camera noise in images at 70 px/mm.
        """

    def reflectance(self, points_mm: Array) -> Array:
        """Return the reflectance (n,) at material points (n, 2) in mm."""


@dataclass(frozen=True)
class Speckle:
    """A speckle pattern: random dark dots with smooth edges, which cover about half of a white surface.

    Where dots overlap, their darkness values add up to a sum s, and the fraction exp(-s) of the light remains
    above the darkest reflectance. The dots are sorted by the cells of a square lattice around the origin, so
    that the dots near a point are found quickly. Outside the lattice, the surface is white.
    """

    # shape (m, 3): x, y and 1 / radius² of each dot, in units of the cell size. Radii are at most 1, so a dot
    # covers points in its own cell and in the neighbouring cells only.
    dots: Array
    # shape (n * n + 1,): index of the first dot of each cell, row by row. The last element is the number of
    # all dots.
    first: NDArray[np.int64]
    cell_mm: float  # size of a cell
    quadrature_order: ClassVar[int] = 2

    # With these values, the pattern's autocorrelation is 5 px wide at half height for a camera at 70 px/mm.
    CELL_MM: ClassVar[float] = 0.08
    SMALLEST_RADIUS: ClassVar[float] = 0.7
    DOTS_PER_CELL: ClassVar[float] = 1.2
    # The lattice is 41 mm wide, which is more than the field of view of any camera of the rig.
    CELLS: ClassVar[int] = 512

    @classmethod
    @lru_cache(maxsize=1)
    def sprayed(cls, seed: int) -> "Speckle":
        """Return a random pattern; the same `seed` always gives the same pattern."""
        rng = np.random.default_rng(seed)
        count = rng.poisson(cls.DOTS_PER_CELL, cls.CELLS**2)
        row, column = np.divmod(np.repeat(np.arange(cls.CELLS**2), count), cls.CELLS)
        x, y = column + rng.random(len(column)), row + rng.random(len(row))
        radius = rng.uniform(cls.SMALLEST_RADIUS, 1.0, len(row))
        first = np.concatenate([[0], np.cumsum(count)])
        return cls(np.column_stack([x, y, radius**-2]), first, cls.CELL_MM)

    def reflectance(self, points_mm: Array) -> Array:
        """Return the reflectance (n,) at material points (n, 2) in mm."""
        return _speckle(np.ascontiguousarray(points_mm), self.dots, self.first, self.cell_mm)


@dataclass(frozen=True)
class LineGrid:
    """Calibration grid: dark lines parallel to X and Y on a bright square plate around the origin."""

    lines: int = 21  # number of lines parallel to X, and number of lines parallel to Y
    pitch_mm: float = 0.5
    line_width_mm: float = 0.08
    edge_mm: float = 0.03  # width of the transition from dark to bright at the edge of a line
    overhang_mm: float = 0.1  # length of a line beyond its outermost intersection
    # half the side length of the plate. The surface around the plate is half as bright as the plate.
    plate_half_mm: float = 6.0
    # True if three dark dots mark the origin and the axes. The dots are in three of the four cells around the
    # intersection ``(lines // 2, lines // 2)``, each in the middle of its cell. Of these four cells, the cell
    # without a dot lies towards +X and +Y. For an odd number of lines, the intersection is the middle of the
    # grid.
    marked: bool = False
    quadrature_order: ClassVar[int] = 3

    DOT_RADIUS_IN_PITCHES: ClassVar[float] = 0.15

    def reflectance(self, points_mm: Array) -> Array:
        """Return the reflectance (n,) at material points (n, 2) in mm."""
        return _line_grid(
            np.ascontiguousarray(points_mm),
            self.lines,
            self.pitch_mm,
            self.line_width_mm,
            self.edge_mm,
            self.overhang_mm,
            self.plate_half_mm,
            self.DOT_RADIUS_IN_PITCHES * self.pitch_mm if self.marked else 0.0,
        )


@compiled
def _speckle(points_mm: Array, dots: Array, first: NDArray[np.int64], cell_mm: float) -> Array:
    darkness_of_a_dot = 1.7
    cells = int(np.sqrt(len(first) - 1))
    reflectance = np.full(len(points_mm), BRIGHT)
    for k in range(len(points_mm)):
        x, y = points_mm[k, 0] / cell_mm + cells / 2, points_mm[k, 1] / cell_mm + cells / 2
        column, row = int(np.floor(x)), int(np.floor(y))
        if min(column, row) < 1 or max(column, row) > cells - 2:
            continue
        darkness = 0.0
        for cell in range((row - 1) * cells + column, (row + 2) * cells + column, cells):
            # The dots of three neighbouring cells in a row are stored one after the other in `dots`.
            for d in range(first[cell - 1], first[cell + 2]):
                dx, dy = x - dots[d, 0], y - dots[d, 1]
                q = max(0.0, 1.0 - (dx * dx + dy * dy) * dots[d, 2])
                darkness += darkness_of_a_dot * (q * q) * (q * q)
        reflectance[k] = DARK + (BRIGHT - DARK) * np.exp(-darkness)
    return reflectance


@compiled
def _rise(t: float) -> float:
    """Return a smooth step at `t` that rises from 0 at -1/2 to 1 at 1/2.

    The step is twice continuously differentiable.
    """
    t = min(max(t + 0.5, 0.0), 1.0)
    return t * t * t * (10.0 + t * (6.0 * t - 15.0))


@compiled
def _line_coverage(
    across: float, along: float, lines: int, pitch: float, width: float, edge: float, end: float
) -> float:
    """Return the fraction (0 to 1) to which the lines of one direction cover a point."""
    middle = (lines - 1) / 2
    nearest = min(max(np.round(across / pitch + middle), 0.0), lines - 1.0)
    off_centre = abs(across - (nearest - middle) * pitch)
    return _rise((width / 2 - off_centre) / edge) * _rise((end - abs(along)) / edge)


@compiled
def _mark_coverage(x: float, y: float, lines: int, pitch: float, radius: float, edge: float) -> float:
    """Return the fraction (0 to 1) to which the three dots of the mark cover a point."""
    middle = (lines // 2 - (lines - 1) / 2) * pitch
    x, y = x - middle, y - middle
    if radius == 0.0 or (x > 0.0 and y > 0.0):
        return 0.0
    return _rise((radius - np.hypot(abs(x) - pitch / 2, abs(y) - pitch / 2)) / edge)


@compiled
def _line_grid(
    points_mm: Array,
    lines: int,
    pitch: float,
    width: float,
    edge: float,
    overhang: float,
    plate_half: float,
    dot_radius: float,
) -> Array:
    end = (lines - 1) / 2 * pitch + overhang
    beyond_the_plate = BRIGHT / 2
    reflectance = np.empty(len(points_mm))
    for k in range(len(points_mm)):
        x, y = points_mm[k, 0], points_mm[k, 1]
        upright = _line_coverage(x, y, lines, pitch, width, edge, end)
        level = _line_coverage(y, x, lines, pitch, width, edge, end)
        mark = _mark_coverage(x, y, lines, pitch, dot_radius, edge)
        plate = DARK + (BRIGHT - DARK) * (1.0 - upright) * (1.0 - level) * (1.0 - mark)
        on_plate = _rise((plate_half - max(abs(x), abs(y))) / edge)
        reflectance[k] = beyond_the_plate + (plate - beyond_the_plate) * on_plate
    return reflectance
