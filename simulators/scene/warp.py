"""Compiled loops that draw a frame from a prepared picture, one row after the other.

The prepared picture is a grid of fine points. A map gives the position in this grid of each pixel, in fine
points. The image is cut into tiles, and in each tile the map is a polynomial of second order in each
direction through nine nodes. Between the fine points the light is interpolated linearly.
"""

from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from simulators.scene.jit import compiled_fast

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Places = tuple[NDArray[np.int32], Floats, Floats, NDArray[np.uint32], NDArray[np.uint32]]


class PixelMap(NamedTuple):
    """The positions of an image's pixels in a prepared picture, at several moments of one exposure.

    Attributes
    ----------
    columns, rows : ndarray, shape (moments, 2 tiles down + 1, 2 tiles across + 1)
        Positions of the nodes, in fine points.
    weights : ndarray, shape (moments,)
        The share of each moment in the exposure.
    drawn_at : ndarray of int32, shape (moments, tiles down, tiles across)
        Number of a tile in `drawn` that takes the place of the prepared picture, or -1.
    drawn : ndarray of float32, shape (n, tile, tile)
        Light of single tiles, in the units of the prepared picture.
    """

    columns: Array
    rows: Array
    weights: Array
    drawn_at: NDArray[np.int32]
    drawn: Floats


class Shading(NamedTuple):
    """What changes the light on its way to the sensor.

    Attributes
    ----------
    of_rows : ndarray of float32, shape (height,)
        Factor of the light in each row.
    added : ndarray of float32, shape (m, n)
        Light that is added to a part of the image, in the units of the prepared picture.
    top, left : int
        Place of this part.
    """

    of_rows: Floats
    added: Floats
    top: int
    left: int


class Exposing(NamedTuple):
    """How a sensor makes grey levels from light: see `simulators.scene.sensor.Sensor`.

    Attributes
    ----------
    electrons : float
        Electrons for one unit of light.
    dark_e2 : float
        Variance of the dark noise.
    full_e : float
        Electrons at which a pixel saturates.
    grey_per_e : float
    highest_grey : float
    noise : ndarray of float32, shape (n,)
        Values of a normal distribution.
    noise_from : ndarray of int64, shape (height,)
        Where the noise of each row begins in `noise`.
    """

    electrons: float
    dark_e2: float
    full_e: float
    grey_per_e: float
    highest_grey: float
    noise: Floats
    noise_from: NDArray[np.int64]


@compiled_fast
def _find(columns: Array, rows: Array, row: int, tile: int, stride: int, places: Places) -> None:
    """Find the fine point up-left of each pixel in a row of the image, and the pixel's place beyond it.

    `columns` and `rows` are the nodes of one moment, and `stride` is the number of fine points in a row.
    `places` receives the index of the fine point and the distances to the right and down, of all tiles.
    """
    index, part_x, part_y, _, _ = places
    a, s = 2 * (row // tile), (row % tile) * (2.0 / tile)
    w0, w1, w2 = (s - 1.0) * (s - 2.0) / 2.0, s * (2.0 - s), s * (s - 1.0) / 2.0
    half, wide = 2.0 / tile, np.int32(stride)
    for across in range(len(index) // tile):
        b = 2 * across
        x0 = w0 * columns[a, b] + w1 * columns[a + 1, b] + w2 * columns[a + 2, b]
        x1 = w0 * columns[a, b + 1] + w1 * columns[a + 1, b + 1] + w2 * columns[a + 2, b + 1]
        x2 = w0 * columns[a, b + 2] + w1 * columns[a + 1, b + 2] + w2 * columns[a + 2, b + 2]
        y0 = w0 * rows[a, b] + w1 * rows[a + 1, b] + w2 * rows[a + 2, b]
        y1 = w0 * rows[a, b + 1] + w1 * rows[a + 1, b + 1] + w2 * rows[a + 2, b + 1]
        y2 = w0 * rows[a, b + 2] + w1 * rows[a + 1, b + 2] + w2 * rows[a + 2, b + 2]
        # Relative to a corner, single precision is enough, and no place is negative.
        left, top = np.floor(min(x0, x1, x2)) - 1.0, np.floor(min(y0, y1, y2)) - 1.0
        start_x, start_y = np.float32(x0 - left), np.float32(y0 - top)
        slope_x = np.float32((-3.0 * x0 + 4.0 * x1 - x2) / 2.0 * half)
        slope_y = np.float32((-3.0 * y0 + 4.0 * y1 - y2) / 2.0 * half)
        bend_x = np.float32((x0 - 2.0 * x1 + x2) / 2.0 * half * half)
        bend_y = np.float32((y0 - 2.0 * y1 + y2) / 2.0 * half * half)
        corner, first = np.int32(int(top) * stride + int(left)), np.uint64(across * tile)
        # The indices are without a sign, because the compiler then makes vector code of this loop.
        for i in range(tile):
            along, k = np.float32(np.int32(i)), first + np.uint64(i)
            x = start_x + along * (slope_x + along * bend_x)
            y = start_y + along * (slope_y + along * bend_y)
            column, line = np.int32(x), np.int32(y)
            part_x[k] = x - np.float32(column)
            part_y[k] = y - np.float32(line)
            index[k] = corner + line * wide + column


@intrinsic  # type: ignore[untyped-decorator]
def _two_from(typing: Any, flat: Any, index: Any) -> Any:
    """Return two neighbouring points of a flat picture as one number, the left one in its lower 8 bits."""

    def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        both = builder.bitcast(builder.gep(array.data, [arguments[1]]), ir.IntType(16).as_pointer())
        loaded = builder.load(both)
        loaded.align = 1
        return builder.zext(loaded, ir.IntType(32))

    return types.uint32(flat, types.uint64), build


@compiled_fast
def _collect(
    fine: NDArray[np.uint8], stride: int, places: Places, share: float, span: tuple[int, int], light: Floats
) -> None:
    """Add the light between fine points to the pixels from `span[0]` up to `span[1]`. `fine` is flat."""
    index, part_x, part_y, upper, lower = places
    below = np.uint64(stride)
    # Single loads take most of the time: two points with one load, and the arithmetic as vector code.
    for i in range(span[0], span[1]):
        k = np.uint64(index[i])
        upper[i] = _two_from(fine, k)
        lower[i] = _two_from(fine, k + below)
    factor, byte, eight = np.float32(share), np.uint32(255), np.uint32(8)
    for i in range(span[0], span[1]):
        upper_left = np.float32(np.int32(upper[i] & byte))
        lower_left = np.float32(np.int32(lower[i] & byte))
        above = upper_left + part_x[i] * (np.float32(np.int32(upper[i] >> eight)) - upper_left)
        under = lower_left + part_x[i] * (np.float32(np.int32(lower[i] >> eight)) - lower_left)
        light[i] += factor * (above + part_y[i] * (under - above))


@compiled_fast
def _places_for(pixels: int) -> Places:
    return (
        np.empty(pixels, np.int32),
        np.empty(pixels, np.float32),
        np.empty(pixels, np.float32),
        np.empty(pixels, np.uint32),
        np.empty(pixels, np.uint32),
    )


@compiled_fast
def _light_of_row(row: int, fine: NDArray[np.uint8], where: PixelMap, places: Places, light: Floats) -> None:
    """Write the light of an image's row, filled up to a whole number of tiles, to `light`."""
    tile, stride, flat = where.drawn.shape[1], fine.shape[1], fine.ravel()
    light[:] = np.float32(0.0)
    for moment in range(len(where.weights)):
        share = where.weights[moment]
        drawn_at = where.drawn_at[moment, row // tile]
        _find(where.columns[moment], where.rows[moment], row, tile, stride, places)
        if drawn_at.max() < 0:
            _collect(flat, stride, places, share, (0, len(light)), light)
            continue
        for across in range(len(drawn_at)):
            first, drawn = across * tile, drawn_at[across]
            if drawn < 0:
                _collect(flat, stride, places, share, (first, first + tile), light)
                continue
            for i in range(tile):
                light[first + i] += np.float32(share) * where.drawn[drawn, row % tile, i]


@compiled_fast
def _expose_row(row: int, light: Floats, shading: Shading, by: Exposing, grey: NDArray[np.uint8]) -> None:
    """Write the grey levels of a row to `grey`, from the light of the scene."""
    scale, scale_of_added = np.float32(shading.of_rows[row] * by.electrons), np.float32(by.electrons)
    for i in range(len(light)):
        light[i] *= scale
    if shading.top <= row < shading.top + shading.added.shape[0]:
        for i in range(shading.added.shape[1]):
            light[shading.left + i] += scale_of_added * shading.added[row - shading.top, i]
    dark, full, gain = np.float32(by.dark_e2), np.float32(by.full_e), np.float32(by.grey_per_e)
    none, half, highest = np.float32(0.0), np.float32(0.5), np.float32(by.highest_grey)
    noise = by.noise[by.noise_from[row] : by.noise_from[row] + len(light)]
    for i in range(len(light)):
        held = min(light[i] + np.sqrt(light[i] + dark) * noise[i], full)
        grey[i] = np.int32(min(max(held * gain, none), highest) + half)


@compiled_fast
def light_of(fine: NDArray[np.uint8], where: PixelMap, image: Floats) -> None:
    """Write the mean light of the moments to `image`, shape (height, width), in the units of `fine`.

    `fine` is the prepared picture, shape (rows, columns).
    """
    wide = where.drawn_at.shape[2] * where.drawn.shape[1]
    places = _places_for(wide)
    light = np.empty(wide, np.float32)
    for row in range(image.shape[0]):
        _light_of_row(row, fine, where, places, light)
        image[row] = light[: image.shape[1]]


@compiled_fast
def expose(
    fine: NDArray[np.uint8], where: PixelMap, shading: Shading, by: Exposing, image: NDArray[np.uint8]
) -> None:
    """Write the grey levels of an exposure to `image`, shape (height, width), of uint8 or uint16."""
    wide = where.drawn_at.shape[2] * where.drawn.shape[1]
    places = _places_for(wide)
    light = np.empty(wide, np.float32)
    for row in range(image.shape[0]):
        _light_of_row(row, fine, where, places, light)
        _expose_row(row, light[: image.shape[1]], shading, by, image[row])
