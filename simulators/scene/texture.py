"""Textures as formulas: a speckle pattern and a calibration grid.

Both can be evaluated at any material position, so an image of them is exact at every sub-pixel displacement.
Reflectance runs from 0 (black) to 1 (white); positions are material coordinates in mm.
"""

from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from simulators.scene.jit import compiled

Array = NDArray[np.float64]

DARK = 0.08
BRIGHT = 0.92


class Texture(Protocol):
    """A reflectance defined at every material point.

    `quadrature_order` is the number of Gauss points per pixel and direction: enough to keep the integration
    error far below a camera's noise at 70 px/mm.
    """

    @property
    def quadrature_order(self) -> int:
        """Gauss points per pixel and direction."""

    def reflectance(self, points_mm: Array) -> Array:
        """Return the reflectance (n,) at material points (n, 2) in mm."""


@dataclass(frozen=True)
class Speckle:
    """Dark dots of smooth compact support on white, sprayed at random, about half of the surface covered.

    Dots overlap as paint does: darkness s leaves exp(-s) of the light. Dots are sorted by the cells of a
    square lattice centred on the origin, so that those near a point are found fast; beyond it the surface is
    white.

    Attributes
    ----------
    dots : ndarray, shape (m, 3)
        Position of a dot in the lattice and one over its radius squared, in cells; radii are at most 1, so
        only neighbouring cells matter.
    first : ndarray of int, shape (n * n + 1,)
        Index of each cell's first dot, row by row, and the end of the last cell's dots.
    cell_mm : float
    """

    dots: Array
    first: NDArray[np.int64]
    cell_mm: float
    quadrature_order: ClassVar[int] = 2

    # With these values the autocorrelation is 5 px wide at half height for a camera at 70 px/mm.
    CELL_MM: ClassVar[float] = 0.08
    SMALLEST_RADIUS: ClassVar[float] = 0.7
    DOTS_PER_CELL: ClassVar[float] = 1.2
    # 41 mm, more than any camera of the rig sees at once.
    CELLS: ClassVar[int] = 512

    @classmethod
    def sprayed(cls, seed: int) -> "Speckle":
        """Return the pattern that belongs to `seed`."""
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
    """Calibration grid: dark lines on a bright plate, centred on the origin, parallel to X and Y.

    Attributes
    ----------
    lines : int
        Number of lines in either direction.
    pitch_mm, line_width_mm : float
    edge_mm : float
        Width over which a line's edge goes from dark to bright.
    overhang_mm : float
        How far lines go on beyond the outermost crossing.
    plate_half_mm : float
        The plate ends here; beyond it lies a surface half as bright.
    marked : bool
        Whether three dark dots fix the origin and the axes. They lie in the middle of three of the four cells
        around intersection ``(lines // 2, lines // 2)``, which is the middle one of an odd number; the cell
        without one lies towards +X and +Y.
    """

    lines: int = 21
    pitch_mm: float = 0.5
    line_width_mm: float = 0.08
    edge_mm: float = 0.03
    overhang_mm: float = 0.1
    plate_half_mm: float = 6.0
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
            # the dots of the cells to the left and to the right stand next to this one's
            for d in range(first[cell - 1], first[cell + 2]):
                dx, dy = x - dots[d, 0], y - dots[d, 1]
                q = max(0.0, 1.0 - (dx * dx + dy * dy) * dots[d, 2])
                darkness += darkness_of_a_dot * (q * q) * (q * q)
        reflectance[k] = DARK + (BRIGHT - DARK) * np.exp(-darkness)
    return reflectance


@compiled
def _rise(t: float) -> float:
    """Rise from 0 at t = -1/2 to 1 at t = 1/2, twice continuously differentiable."""
    t = min(max(t + 0.5, 0.0), 1.0)
    return t * t * t * (10.0 + t * (6.0 * t - 15.0))


@compiled
def _line_coverage(
    across: float, along: float, lines: int, pitch: float, width: float, edge: float, end: float
) -> float:
    """Return the coverage of points by the lines of one direction, 0 to 1."""
    middle = (lines - 1) / 2
    nearest = min(max(np.round(across / pitch + middle), 0.0), lines - 1.0)
    off_centre = abs(across - (nearest - middle) * pitch)
    return _rise((width / 2 - off_centre) / edge) * _rise((end - abs(along)) / edge)


@compiled
def _mark_coverage(x: float, y: float, lines: int, pitch: float, radius: float, edge: float) -> float:
    """Return the coverage of points by the mark's three dots, 0 to 1."""
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
