"""Sums over a subset: of the reference alone, and of the reference with the warped deformed image.

All that IC-GN needs of a subset is a handful of such moments, so no array of subset size exists. Images are
flat arrays of float32 (`dic.correlation.kernel.layout`); f is the reference, zero outside the region of
interest like its slopes fx and fy, and g the deformed image, whose spline has the coefficients c. The
subset's centre is the element `centre` of the reference; `target` is the element of the deformed image with
the same coordinates.
"""

import numpy as np
from numpy.typing import NDArray

from dic.correlation.kernel.jit import inlined, inner
from dic.correlation.kernel.layout import Deformed, Reference
from dic.correlation.kernel.vectors import (
    add_moments,
    add_powers,
    at_least,
    blend,
    fma,
    load,
    nothing,
    ramp8,
    ramp16,
    select,
    splat,
    total,
)

Flat = NDArray[np.float32]
Vector = NDArray[np.float32]
Taps = tuple[float, ...]
Shape = tuple[float, ...]
"""A tuple whose length alone matters, so that code is compiled for it: 4 or 6 taps, 6 or 12 parameters."""

# Moments of the reference, by place: fx fx, fx fy, fy fy times the fifteen monomials up to the fourth degree;
# fx f, fy f, fx and fy times the six up to the second; f and f². Monomials are ordered 1; x, y; x², xy, y²; …
PRODUCTS, FX_F, FY_F, FX, FY, F, FF = 0, 45, 51, 57, 63, 69, 70
REFERENCE_MOMENTS = 71
# Moments with the deformed image: fx g and fy g times 1, x, y, x², xy, y²; g, g² and f g.
FX_G, FY_G, G, GG, FG = 0, 6, 12, 13, 14
MOMENTS = 15


@inlined
def _weights(taps: Taps, t: Vector) -> tuple[Vector, ...]:
    """Return the B-spline weights of the taps around a position whose fractional part is `t`.

    Each is 6 (cubic) or 120 (quintic) times the weight: the coefficients have been divided instead.
    """
    one = splat(t, 1.0)
    s = one - t
    t2, s2 = t * t, s * s
    if len(taps) == 4:
        three, four, six = splat(t, 3.0), splat(t, 4.0), splat(t, 6.0)
        return s2 * s, four + t2 * (three * t - six), four + s2 * (three * s - six), t2 * t
    five, ten, twenty, thirty = splat(t, 5.0), splat(t, 10.0), splat(t, 20.0), splat(t, 30.0)
    c26, c50, c60, c66 = splat(t, 26.0), splat(t, 50.0), splat(t, 60.0), splat(t, 66.0)
    return (
        s2 * s2 * s,
        c26 + t * (t * (twenty + t * (twenty + t * (five * t - twenty))) - c50),
        c66 + t2 * (t2 * (thirty - ten * t) - c60),
        c66 + s2 * (s2 * (thirty - ten * s) - c60),
        c26 + s * (s * (twenty + s * (twenty + s * (five * s - twenty))) - c50),
        t2 * t2 * t,
    )


@inlined
def _weights_of_two(taps: Taps, t: Vector) -> tuple[Vector, ...]:
    """Return the weights, one more than taps, where `t` in [0, 2) lies in the first pixel or in the next."""
    zero, one = splat(t, 0.0), splat(t, 1.0)
    next_pixel = at_least(t, one)
    w = _weights(taps, t - select(next_pixel, one, zero))
    if len(taps) == 4:
        return (
            select(next_pixel, zero, w[0]),
            select(next_pixel, w[0], w[1]),
            select(next_pixel, w[1], w[2]),
            select(next_pixel, w[2], w[3]),
            select(next_pixel, w[3], zero),
        )
    return (
        select(next_pixel, zero, w[0]),
        select(next_pixel, w[0], w[1]),
        select(next_pixel, w[1], w[2]),
        select(next_pixel, w[2], w[3]),
        select(next_pixel, w[3], w[4]),
        select(next_pixel, w[4], w[5]),
        select(next_pixel, w[5], zero),
    )


@inner
def _reference_strip(image: Reference, shape: Shape, x: Vector, first: int, r: int, Q: Flat) -> None:
    """Add one strip of the subset, as wide as the vector of its offsets `x`, to the reference's moments.

    Lanes beyond the subset read its neighbours, which do not count.
    """
    inside = _inside(x, r)
    if len(shape) == 12:
        fxfx, fx1 = nothing(x, 5), nothing(x, 3)
    else:
        fxfx, fx1 = nothing(x, 3), nothing(x, 2)
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
    add_moments(Q, PRODUCTS, fxfx, x, inside)
    add_moments(Q, PRODUCTS + 15, fxfy, x, inside)
    add_moments(Q, PRODUCTS + 30, fyfy, x, inside)
    add_moments(Q, FX_F, fxf, x, inside)
    add_moments(Q, FY_F, fyf, x, inside)
    add_moments(Q, FX, fx1, x, inside)
    add_moments(Q, FY, fy1, x, inside)
    Q[F] += total(f1 * inside)
    Q[FF] += total(ff * inside)


@inner
def reference_moments(image: Reference, shape: Shape, centre: int, r: int, Q: Flat) -> None:
    """Write the moments of the subset around the element `centre` of the reference."""
    for k in range(REFERENCE_MOMENTS):
        Q[k] = 0.0
    left = -r
    while left <= r:
        first = centre - r * image.pitch + left
        if r - left >= 8:
            _reference_strip(image, shape, ramp16(left), first, r, Q)
            left += 16
        else:
            _reference_strip(image, shape, ramp8(left), first, r, Q)
            left += 8


@inlined
def _inside(x: Vector, r: int) -> Vector:
    """Return 1 where the offset `x` belongs to the subset and 0 beyond it."""
    ones: Vector = select(at_least(splat(x, r), x), splat(x, 1.0), splat(x, 0.0))
    return ones


@inner
def _lay_rows(
    shape: Shape, pitch: int, left: int, right: int, r: int, p: Flat, shift: Flat, place: NDArray[np.int64]
) -> None:
    """Write for each row of a strip where it begins to read, and how the warp lies relative to that place.

    Row 0 of `place` is the offset of the first pixel's cell, row 1 tells whether the strip reaches into the
    next cell across or down. `shift` is what the row adds to the strip's warp, less the cell.
    """
    first, last, half = np.float32(left), np.float32(right), np.float32(0.5)
    length2 = (last - first) * (last - first)
    for j in range(2 * r + 1):
        place[0, j], place[1, j] = 0, 0
    for side in range(2):
        at, step = 3 * side, pitch if side else 1
        shifted, along, down = p[at], p[at + 1], p[at + 2]
        bend_x, twist, bend_y = np.float32(0.0), np.float32(0.0), np.float32(0.0)
        if len(shape) == 12:
            bend_x, twist, bend_y = half * p[at + 6], p[at + 7], half * p[at + 8]
        # A parabola leaves the chord between its ends by at most so much.
        sag = half * half * abs(bend_x) * length2
        # Without branches, so that rows are laid side by side.
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
def _strip(
    image: Reference,
    deformed: Deformed,
    taps: Taps,
    shape: Shape,
    x: Vector,
    left: int,
    centre: int,
    target: int,
    r: int,
    p: Flat,
    clipped: bool,
    shift: Flat,
    place: NDArray[np.int64],
    S: Flat,
) -> None:
    """Add one strip to the moments with the deformed image, for a smooth warp laid out by `_lay_rows`.

    All lanes of a row read neighbouring taps; where the row reaches into the next cell, one more either way.
    """
    zero, inside = splat(x, 0.0), _inside(x, r)
    to_x, to_y = fma(splat(x, p[1]), x, splat(x, p[0])), fma(splat(x, p[4]), x, splat(x, p[3]))
    twist_x, twist_y = zero, zero
    if len(shape) == 12:
        half_square = splat(x, 0.5) * x * x
        to_x, to_y = fma(splat(x, p[6]), half_square, to_x), fma(splat(x, p[9]), half_square, to_y)
        twist_x, twist_y = splat(x, p[7]) * x, splat(x, p[10]) * x
    fxg = nothing(x, 3) if len(shape) == 12 else nothing(x, 2)
    fyg, g1, gg, fg = fxg, zero, zero, zero
    here, pitch = centre - r * image.pitch + left, deformed.pitch
    row_there = target - r * pitch + left - (len(taps) // 2 - 1) * (pitch + 1)
    for j in range(2 * r + 1):
        y = splat(x, j - r)
        tx, ty = to_x + splat(x, shift[0, j]), to_y + splat(x, shift[1, j])
        if len(shape) == 12:
            tx, ty = fma(twist_x, y, tx), fma(twist_y, y, ty)
        there = row_there + place[0, j]
        if place[1, j] == 0:
            g = blend(deformed.c, there, pitch, _weights(taps, tx), _weights(taps, ty))
        else:
            g = blend(deformed.c, there, pitch, _weights_of_two(taps, tx), _weights_of_two(taps, ty))
        if clipped:
            g = g * load(x, image.inside, here)
        fxg = add_powers(fxg, load(x, image.fx, here) * g, y)
        fyg = add_powers(fyg, load(x, image.fy, here) * g, y)
        g1, gg, fg = g1 + g, fma(g, g, gg), fma(load(x, image.f, here), g, fg)
        here, row_there = here + image.pitch, row_there + pitch
    add_moments(S, FX_G, fxg, x, inside)
    add_moments(S, FY_G, fyg, x, inside)
    S[G] += total(g1 * inside)
    S[GG] += total(gg * inside)
    S[FG] += total(fg * inside)


@inner
def moments_with_image(
    image: Reference,
    deformed: Deformed,
    taps: Taps,
    shape: Shape,
    centre: int,
    target: int,
    r: int,
    p: Flat,
    smooth: bool,
    clipped: bool,
    shift: Flat,
    place: NDArray[np.int64],
    S: Flat,
) -> None:
    """Write the moments of the subset with the warped deformed image.

    Where the warp is not smooth, neighbours of a row do not stay neighbours: strips are one pixel wide.
    """
    for k in range(MOMENTS):
        S[k] = 0.0
    left = -r
    while left <= r:
        width = (16 if r - left >= 8 else 8) if smooth else 1
        _lay_rows(shape, deformed.pitch, left, min(left + width - 1, r), r, p, shift, place)
        if width == 16:
            x16 = ramp16(left)
            _strip(image, deformed, taps, shape, x16, left, centre, target, r, p, clipped, shift, place, S)
        elif width == 8:
            x8 = ramp8(left)
            _strip(image, deformed, taps, shape, x8, left, centre, target, r, p, clipped, shift, place, S)
        else:
            x: Vector = splat(p[0], left)
            _strip(image, deformed, taps, shape, x, left, centre, target, r, p, clipped, shift, place, S)
        left += width
