"""Sums over a subset ("moments"): of the reference alone, and of the reference with the deformed image.

IC-GN needs only these few sums, so the kernel builds no array of the size of a subset. docs/kernel.md derives
the sums. A table in docs/kernel.md gives the symbol, the index in the arrays, the formula and the source of
each sum.

The grey level of the reference is f, and its derivatives are fx and fy. The values of f, fx and fy are 0
outside the region of interest. The grey level of the deformed image at the warped pixel is g. The offsets
from the subset's centre are x and y. Images are flat arrays of float32 (`dic.correlation.kernel.layout`).
"""

from typing import NamedTuple

import numpy as np

from dic.correlation.kernel import sums as m
from dic.correlation.kernel.bspline_weights import weights, weights_in_two_cells
from dic.correlation.kernel.jit import inlined, inner
from dic.correlation.kernel.layout import Deformed, Flat, KernelReference
from dic.correlation.kernel.method import Shape, Subset, Taps
from dic.correlation.kernel.sums import StripRows
from dic.correlation.kernel.unrolled import add_moments, add_powers, interpolate, zeros
from dic.correlation.kernel.vectors import (
    Vector,
    at_least,
    fma,
    load,
    ramp8,
    ramp16,
    select,
    splat,
    total,
)


class Strip(NamedTuple):
    """A strip: neighbouring columns of a subset that are summed together."""

    left: int
    """Offset x of the first column."""
    rows: StripRows
    """Positions of the strip's rows in the deformed image."""


@inner
def reference_moments(image: KernelReference, shape: Shape, subset: Subset, Q: Flat) -> None:
    """Compute the moments (sums over the pixels) of a subset of the reference, and write them into `Q`."""
    for k in range(m.REFERENCE_MOMENTS):
        Q[k] = 0.0
    r = subset.radius
    corner = image.origin + (subset.y - r) * image.pitch + subset.x
    left = -r
    while left <= r:
        if r - left >= 8:
            _add_reference_strip(image, shape, ramp16(left), corner + left, r, Q)
            left += 16
        else:
            _add_reference_strip(image, shape, ramp8(left), corner + left, r, Q)
            left += 8


@inner
def _add_reference_strip(
    image: KernelReference, shape: Shape, x: Vector, first: int, r: int, Q: Flat
) -> None:
    """Add a strip, a group of columns of a subset, to the moments `Q` of the reference.

    The strip of columns begins at the array element `first`, and its columns have the offsets `x`. The
    vectors also read elements beyond the subset's edge; their contribution is multiplied by 0 at the end.
    """
    inside = _inside(x, r)
    if len(shape) == 12:
        fxfx, fx1 = zeros(x, 5), zeros(x, 3)
    else:
        fxfx, fx1 = zeros(x, 3), zeros(x, 2)
    fxfy, fyfy, fxf, fyf, fy1, f1, ff = fxfx, fxfx, fx1, fx1, fx1, splat(x, 0.0), splat(x, 0.0)
    place = first
    for j in range(-r, r + 1):
        y, f, fx, fy = (
            splat(x, j),
            load(x, image.f, place),
            load(x, image.fx, place),
            load(x, image.fy, place),
        )
        place += image.pitch
        fxfx, fxfy = add_powers(fxfx, fx * fx, y), add_powers(fxfy, fx * fy, y)
        fyfy = add_powers(fyfy, fy * fy, y)
        fxf, fyf = add_powers(fxf, fx * f, y), add_powers(fyf, fy * f, y)
        fx1, fy1 = add_powers(fx1, fx, y), add_powers(fy1, fy, y)
        f1, ff = f1 + f, fma(f, f, ff)
    add_moments(Q, m.PRODUCTS, fxfx, x, inside)
    add_moments(Q, m.PRODUCTS + 15, fxfy, x, inside)
    add_moments(Q, m.PRODUCTS + 30, fyfy, x, inside)
    add_moments(Q, m.FX_F, fxf, x, inside)
    add_moments(Q, m.FY_F, fyf, x, inside)
    add_moments(Q, m.FX, fx1, x, inside)
    add_moments(Q, m.FY, fy1, x, inside)
    Q[m.F] += total(f1 * inside)
    Q[m.FF] += total(ff * inside)


@inlined
def _inside(x: Vector, r: int) -> Vector:
    """Return a vector that is 1 where the offset `x` lies in the subset, and 0 beyond the subset's edge."""
    ones: Vector = select(at_least(splat(x, r), x), splat(x, 1.0), splat(x, 0.0))
    return ones


@inner
def moments_with_image(
    image: KernelReference,
    deformed: Deformed,
    taps: Taps,
    shape: Shape,
    subset: Subset,
    p: Flat,
    smooth: bool,
    rows: StripRows,
    S: Flat,
) -> None:
    """Compute the moments of a subset with the deformed image, for the warp `p`, and write them into `S`.

    If `smooth` is True, neighbouring pixels stay neighbours in the deformed image, and strips (groups of
    columns that are summed together) are 8 or 16 pixels wide. If `smooth` is False, each strip is one column
    of pixels. `rows` is scratch memory.
    """
    for k in range(m.MOMENTS):
        S[k] = 0.0
    left = -subset.radius
    while left <= subset.radius:
        width = (16 if subset.radius - left >= 8 else 8) if smooth else 1
        strip = Strip(left, rows)
        _locate_rows(shape, deformed.pitch, strip, min(left + width - 1, subset.radius), subset.radius, p)
        if width == 16:
            _add_strip(image, deformed, taps, shape, subset, strip, ramp16(left), p, S)
        elif width == 8:
            _add_strip(image, deformed, taps, shape, subset, strip, ramp8(left), p, S)
        else:
            x: Vector = splat(p[0], left)
            _add_strip(image, deformed, taps, shape, subset, strip, x, p, S)
        left += width


@inner
def _locate_rows(shape: Shape, pitch: int, strip: Strip, right: int, r: int, p: Flat) -> None:
    """Compute where the rows of a strip of columns lie in the deformed image; `right` is the last column."""
    shift, place = strip.rows.shift, strip.rows.place
    first, last, half = np.float32(strip.left), np.float32(right), np.float32(0.5)
    length2 = (last - first) * (last - first)
    for j in range(2 * r + 1):
        place[0, j], place[1, j] = 0, 0
    for side in range(2):
        at, step = 3 * side, pitch if side else 1
        shifted, along, down = p[at], p[at + 1], p[at + 2]
        bend_x, twist, bend_y = np.float32(0.0), np.float32(0.0), np.float32(0.0)
        if len(shape) == 12:
            bend_x, twist, bend_y = half * p[at + 6], p[at + 7], half * p[at + 8]
        # The sag is the largest distance of a parabola from the straight line through its ends.
        sag = half * half * abs(bend_x) * length2
        # This loop has no branches, so that the compiler can use vectors.
        for j in range(2 * r + 1):
            y = np.float32(j - r)
            slope, added = along + twist * y, (down + bend_y * y) * y
            begin = shifted + (slope + bend_x * first) * first + added
            end = shifted + (slope + bend_x * last) * last + added
            cell = np.floor(min(begin, end) - sag)
            shift[side, j] = added - cell
            place[0, j] += np.int64(cell) * step
            place[1, j] |= np.int64(max(begin, end) + sag - cell >= 1.0)


@inner
def _add_strip(
    image: KernelReference,
    deformed: Deformed,
    taps: Taps,
    shape: Shape,
    subset: Subset,
    strip: Strip,
    x: Vector,
    p: Flat,
    S: Flat,
) -> None:
    """Add a strip of columns with the offsets `x` to the moments `S` (sums with the deformed image).

    `_locate_rows` has computed the positions of the strip's rows. All pixels of a row of the strip use
    neighbouring spline coefficients (taps). A row that reaches into the next cell between pixels uses one
    more tap in each direction.
    """
    r, shift, place = subset.radius, strip.rows.shift, strip.rows.place
    zero, inside = splat(x, 0.0), _inside(x, r)
    to_x, to_y = fma(splat(x, p[1]), x, splat(x, p[0])), fma(splat(x, p[4]), x, splat(x, p[3]))
    twist_x, twist_y = zero, zero
    if len(shape) == 12:
        half_square = splat(x, 0.5) * x * x
        to_x, to_y = fma(splat(x, p[6]), half_square, to_x), fma(splat(x, p[9]), half_square, to_y)
        twist_x, twist_y = splat(x, p[7]) * x, splat(x, p[10]) * x
    fxg = zeros(x, 3) if len(shape) == 12 else zeros(x, 2)
    fyg, g1, gg, fg = fxg, zero, zero, zero
    pitch, left = deformed.pitch, subset.x + strip.left
    here = image.origin + (subset.y - r) * image.pitch + left
    row_there = deformed.origin + (subset.y - r) * pitch + left - (len(taps) // 2 - 1) * (pitch + 1)
    clipped = subset.pixels < (2 * r + 1) * (2 * r + 1)
    for j in range(2 * r + 1):
        y = splat(x, j - r)
        tx, ty = to_x + splat(x, shift[0, j]), to_y + splat(x, shift[1, j])
        if len(shape) == 12:
            tx, ty = fma(twist_x, y, tx), fma(twist_y, y, ty)
        there = row_there + place[0, j]
        if place[1, j] == 0:
            g = interpolate(deformed.c, there, pitch, weights(taps, tx), weights(taps, ty))
        else:
            wx, wy = weights_in_two_cells(taps, tx), weights_in_two_cells(taps, ty)
            g = interpolate(deformed.c, there, pitch, wx, wy)
        if clipped:
            g = g * load(x, image.inside, here)
        fxg = add_powers(fxg, load(x, image.fx, here) * g, y)
        fyg = add_powers(fyg, load(x, image.fy, here) * g, y)
        g1, gg, fg = g1 + g, fma(g, g, gg), fma(load(x, image.f, here), g, fg)
        here, row_there = here + image.pitch, row_there + pitch
    add_moments(S, m.FX_G, fxg, x, inside)
    add_moments(S, m.FY_G, fyg, x, inside)
    S[m.G] += total(g1 * inside)
    S[m.GG] += total(gg * inside)
    S[m.FG] += total(fg * inside)
