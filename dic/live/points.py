"""The points that the gauges of a camera need, in the order in which they are followed from frame to frame.

The points are cut out of the grid of the offline measurement, with the same subsets. Each tile has a
rectangular block of the grid. The *nodes* are the elements of all blocks, one block after the other. Most
nodes are points; nodes that no gauge needs are not correlated.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dic.correlation import kernel
from dic.correlation.cracks import limited_to
from dic.correlation.prepared_reference import PreparedReference
from dic.live.tiles import tiles_of
from dic.typing import Indices, Mask

_NEIGHBOURS = ((0, -1), (0, 1), (-1, 0), (1, 0), (-1, -1), (1, 1), (-1, 1), (1, -1))


@dataclass(frozen=True)
class CutPoint:
    """A point whose subset is cut by a crack; only the part around the point is used."""

    place: tuple[int, int]
    """Row and column in the block."""
    image: kernel.KernelReference
    """Its subset, in coordinates that count from the tile's first pixel."""
    grid: kernel.KernelGrid
    prepared: kernel.Prepared


@dataclass(frozen=True)
class Tile:
    """A block of the grid of points, and the part of the reference that its subsets use."""

    nodes: slice
    """Its nodes among those of the camera."""
    shape: tuple[int, int]
    """Rows and columns of the block."""
    points: Indices
    """Shape (n, 2). Row and column, in the block, of the points that gauges need."""
    whole: Mask
    """Shape (n,). False for points whose subset is cut by a crack."""
    part: kernel.Part
    """The part of the reference."""
    image: kernel.KernelReference
    """This part, in its own coordinates."""
    grid: kernel.KernelGrid
    """The points of the block, in the same coordinates."""
    prepared: kernel.Prepared
    """Data of the reference's subsets that all frames share."""
    cut: tuple[CutPoint, ...]

    @classmethod
    def of(cls, reference: PreparedReference, rows: Indices, columns: Indices, first: int) -> "Tile":
        """Return the tile of the points with these rows and columns, whose nodes begin at `first`."""
        grid, radius = reference.grid, reference.settings.radius_px
        down, right = np.arange(rows.min(), rows.max() + 1), np.arange(columns.min(), columns.max() + 1)
        shape = len(down), len(right)
        y, x = grid.y[down], grid.x[right]
        part = kernel.Part(
            int(y[0]) - radius, int(y[-1]) + radius + 1, int(x[0]) - radius, int(x[-1]) + radius + 1
        )
        laid = reference.image.rows(part.top, part.bottom)
        place = np.stack([rows - down[0], columns - right[0]], axis=1)
        cut = grid.cut[rows, columns]
        parameters = reference.settings.parameters

        def cut_point(row: int, column: int) -> CutPoint:
            to_x, to_y = int(x[column]), int(y[row])
            limited = limited_to(laid, to_x, to_y, grid.usable, radius)
            here = limited._replace(origin=limited.origin + part.top * limited.pitch + part.left)
            at = np.array([to_x - part.left]), np.array([to_y - part.top])
            pixels = grid.pixels[down[row] : down[row] + 1, right[column] : right[column] + 1]
            own = kernel.Prepared.empty((1, 1), parameters)
            return CutPoint((row, column), here, kernel.KernelGrid(*at, pixels.copy()), own)

        return cls(
            slice(first, first + shape[0] * shape[1]),
            shape,
            place,
            ~cut,
            part,
            kernel.part_of_reference(laid, part),
            kernel.KernelGrid(x - part.left, y - part.top, grid.pixels[np.ix_(down, right)]),
            kernel.Prepared.empty(shape, parameters),
            tuple(cut_point(int(row), int(column)) for row, column in place[cut]),
        )

    @cached_property
    def own(self) -> Indices:
        """Numbers of the points within the block, shape (n,)."""
        return np.asarray(self.points[:, 0] * self.shape[1] + self.points[:, 1])


@dataclass(frozen=True)
class GaugePoints:
    """The points of all gauges of a camera."""

    tiles: tuple[Tile, ...]
    rows: Indices
    columns: Indices
    """Shape (nodes,). Row and column of each node in the grid of the offline measurement."""
    x: Indices
    y: Indices
    """Shape (nodes,). Coordinates of the nodes in the reference, px."""
    used: Mask
    """Shape (nodes,). True for the nodes that gauges need."""

    def __repr__(self) -> str:
        return f"GaugePoints({int(self.used.sum())} points in {len(self.tiles)} tiles)"

    @classmethod
    def of(cls, reference: PreparedReference, needed: Mask, around_px: int) -> "GaugePoints":
        """Divide the `needed` points (rows, columns) into tiles.

        `around_px`: number of pixels around a point that are interpolated for it.
        """
        grid = reference.grid
        rows, columns = np.nonzero(needed)
        tiles: list[Tile] = []
        for own in tiles_of(np.stack([grid.x[columns], grid.y[rows]], axis=1), around_px):
            tiles.append(Tile.of(reference, rows[own], columns[own], tiles[-1].nodes.stop if tiles else 0))
        count = tiles[-1].nodes.stop if tiles else 0
        of_nodes, used = np.zeros((2, count), np.int64), np.zeros(count, np.bool_)
        for tile in tiles:
            right = np.searchsorted(grid.x, tile.part.left + reference.settings.radius_px)
            down = np.searchsorted(grid.y, tile.part.top + reference.settings.radius_px)
            in_block = np.indices(tile.shape).reshape(2, -1)
            of_nodes[:, tile.nodes] = in_block + np.array([[down], [right]])
            used[tile.nodes.start + tile.own] = True
        rows, columns = of_nodes
        return cls(tuple(tiles), rows, columns, grid.x[columns], grid.y[rows], used)

    @cached_property
    def points(self) -> Indices:
        """Numbers of the nodes that gauges need, shape (n,)."""
        return np.flatnonzero(self.used)

    @cached_property
    def numbers(self) -> dict[tuple[int, int], int]:
        """The number among `points` of each point, by its row and column in the offline measurement."""
        rows, columns = self.rows[self.points].tolist(), self.columns[self.points].tolist()
        return {place: k for k, place in enumerate(zip(rows, columns, strict=True))}

    @cached_property
    def neighbours(self) -> tuple[Indices, Mask]:
        """For each of `points`, the numbers (n, 8) among them of its neighbours in the grid, and which exist.

        A neighbour that does not exist has the number of the point itself. Those that exist come first.
        """
        at = self.numbers
        number = np.empty((len(at), len(_NEIGHBOURS)), np.int64)
        for (row, column), k in at.items():
            around = [at.get((row + down, column + right), k) for down, right in _NEIGHBOURS]
            number[k] = sorted(around, key=lambda each: each == k)
        return number, number != np.arange(len(at))[:, None]
