"""Sums over a subset: of the reference alone, and of the reference with the warped deformed image.

All that IC-GN needs of a subset is a handful of such moments, so no array of subset size exists. Images are
flat arrays of float32 (`dic.kernel.layout`); f is the reference, zero outside the region of interest like its
slopes fx and fy, and g the deformed image, whose spline has the coefficients c. The subset's centre is the
element `centre` of the reference; `target` is the element of the deformed image with the same coordinates.
"""

import numpy as np
from numpy.typing import NDArray

from dic.kernel.jit import inlined, inner
from dic.kernel.layout import Deformed, Reference
from dic.kernel.vectors import at_least, blend, fma, load, ramp8, ramp16, select, splat, spread, total

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


@inlined
def _add_first(M: Flat, at: int, x: Vector, s0: Vector, s1: Vector) -> None:
    """Add the moments with 1, x and y of a strip, whose rows were summed times 1 and y."""
    M[at] += total(s0)
    M[at + 1] += total(s0 * x)
    M[at + 2] += total(s1)


@inlined
def _add_second(M: Flat, at: int, x: Vector, s0: Vector, s1: Vector, s2: Vector) -> None:
    """Add the moments with x², xy and y² of a strip, whose rows were summed times 1, y and y²."""
    M[at + 3] += total(s0 * x * x)
    M[at + 4] += total(s1 * x)
    M[at + 5] += total(s2)


@inlined
def _add_fourth(
    M: Flat, at: int, x: Vector, s0: Vector, s1: Vector, s2: Vector, s3: Vector, s4: Vector
) -> None:
    """Add the moments of the third and fourth degree of a strip, summed times y to the powers 0 to 4."""
    xx = x * x
    M[at + 6] += total(s0 * xx * x)
    M[at + 7] += total(s1 * xx)
    M[at + 8] += total(s2 * x)
    M[at + 9] += total(s3)
    M[at + 10] += total(s0 * xx * xx)
    M[at + 11] += total(s1 * xx * x)
    M[at + 12] += total(s2 * xx)
    M[at + 13] += total(s3 * x)
    M[at + 14] += total(s4)


@inner
def _reference_strip(
    image: Reference, shape: Shape, x: Vector, inside: Vector, first: int, r: int, Q: Flat
) -> None:
    """Add one strip of the subset, as wide as the vector of its offsets `x`, to the reference's moments.

    Lanes beyond the subset read its neighbours: `inside` is 1 within and 0 there.
    """
    zero = splat(x, 0.0)
    a0, a1, a2, a3, a4 = zero, zero, zero, zero, zero
    b0, b1, b2, b3, b4 = zero, zero, zero, zero, zero
    c0, c1, c2, c3, c4 = zero, zero, zero, zero, zero
    d0, d1, d2, e0, e1, e2 = zero, zero, zero, zero, zero, zero
    g0, g1, g2, h0, h1, h2, f1, f2 = zero, zero, zero, zero, zero, zero, zero, zero
    place = first
    for j in range(-r, r + 1):
        y = splat(x, j)
        f = load(x, image.f, place) * inside
        fx, fy = load(x, image.fx, place) * inside, load(x, image.fy, place) * inside
        place += image.pitch
        y2 = y * y
        xx, xy, yy, xf, yf = fx * fx, fx * fy, fy * fy, fx * f, fy * f
        a0, a1, a2 = a0 + xx, fma(xx, y, a1), fma(xx, y2, a2)
        b0, b1, b2 = b0 + xy, fma(xy, y, b1), fma(xy, y2, b2)
        c0, c1, c2 = c0 + yy, fma(yy, y, c1), fma(yy, y2, c2)
        d0, d1, e0, e1 = d0 + xf, fma(xf, y, d1), e0 + yf, fma(yf, y, e1)
        g0, g1, h0, h1 = g0 + fx, fma(fx, y, g1), h0 + fy, fma(fy, y, h1)
        f1, f2 = f1 + f, fma(f, f, f2)
        if len(shape) == 12:
            y3, y4 = y2 * y, y2 * y2
            a3, b3, c3 = fma(xx, y3, a3), fma(xy, y3, b3), fma(yy, y3, c3)
            a4, b4, c4 = fma(xx, y4, a4), fma(xy, y4, b4), fma(yy, y4, c4)
            d2, e2, g2, h2 = fma(xf, y2, d2), fma(yf, y2, e2), fma(fx, y2, g2), fma(fy, y2, h2)
    _add_first(Q, PRODUCTS, x, a0, a1)
    _add_first(Q, PRODUCTS + 15, x, b0, b1)
    _add_first(Q, PRODUCTS + 30, x, c0, c1)
    _add_second(Q, PRODUCTS, x, a0, a1, a2)
    _add_second(Q, PRODUCTS + 15, x, b0, b1, b2)
    _add_second(Q, PRODUCTS + 30, x, c0, c1, c2)
    _add_first(Q, FX_F, x, d0, d1)
    _add_first(Q, FY_F, x, e0, e1)
    _add_first(Q, FX, x, g0, g1)
    _add_first(Q, FY, x, h0, h1)
    Q[F] += total(f1)
    Q[FF] += total(f2)
    if len(shape) == 12:
        _add_fourth(Q, PRODUCTS, x, a0, a1, a2, a3, a4)
        _add_fourth(Q, PRODUCTS + 15, x, b0, b1, b2, b3, b4)
        _add_fourth(Q, PRODUCTS + 30, x, c0, c1, c2, c3, c4)
        _add_second(Q, FX_F, x, d0, d1, d2)
        _add_second(Q, FY_F, x, e0, e1, e2)
        _add_second(Q, FX, x, g0, g1, g2)
        _add_second(Q, FY, x, h0, h1, h2)


@inner
def reference_moments(image: Reference, shape: Shape, centre: int, r: int, Q: Flat) -> None:
    """Write the moments of the subset around the element `centre` of the reference."""
    Q[:] = 0.0
    left, remaining = -r, 2 * r + 1
    while remaining > 0:
        first = centre - r * image.pitch + left
        if remaining > 8:
            x = ramp16(left)
            _reference_strip(image, shape, x, _inside(x, r), first, r, Q)
            left, remaining = left + 16, remaining - 16
        else:
            x8 = ramp8(left)
            _reference_strip(image, shape, x8, _inside(x8, r), first, r, Q)
            left, remaining = left + 8, remaining - 8


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
    u, ux, uy, v, vx, vy = p[0], p[1], p[2], p[3], p[4], p[5]
    sag_x, sag_y = np.float32(0.0), np.float32(0.0)
    if len(shape) == 12:
        # A parabola leaves the chord between its ends by at most an eighth of curvature times length squared.
        sag_x = abs(p[6]) * np.float32((right - left) ** 2 / 8)
        sag_y = abs(p[9]) * np.float32((right - left) ** 2 / 8)
    for j in range(2 * r + 1):
        y = np.float32(j - r)
        row_x, row_y, slope_x, slope_y = uy * y, vy * y, ux, vx
        begin_x, begin_y, end_x, end_y = u, v, u, v
        if len(shape) == 12:
            row_x += np.float32(0.5) * p[8] * y * y
            row_y += np.float32(0.5) * p[11] * y * y
            slope_x, slope_y = ux + p[7] * y, vx + p[10] * y
            begin_x += np.float32(0.5) * p[6] * left * left
            begin_y += np.float32(0.5) * p[9] * left * left
            end_x += np.float32(0.5) * p[6] * right * right
            end_y += np.float32(0.5) * p[9] * right * right
        begin_x, begin_y = begin_x + slope_x * left + row_x, begin_y + slope_y * left + row_y
        end_x, end_y = end_x + slope_x * right + row_x, end_y + slope_y * right + row_y
        column = np.floor(min(begin_x, end_x) - sag_x)
        row = np.floor(min(begin_y, end_y) - sag_y)
        shift[0, j], shift[1, j] = row_x - column, row_y - row
        place[0, j] = np.int64(row) * pitch + np.int64(column)
        across = max(begin_x, end_x) + sag_x - column >= 1.0
        down = max(begin_y, end_y) + sag_y - row >= 1.0
        place[1, j] = np.int64(across or down)


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
    x0, x1, x2, y0, y1, y2, s1, s2, sf = zero, zero, zero, zero, zero, zero, zero, zero, zero
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
        px, py = load(x, image.fx, here) * g, load(x, image.fy, here) * g
        x0, x1, y0, y1 = x0 + px, fma(px, y, x1), y0 + py, fma(py, y, y1)
        if len(shape) == 12:
            x2, y2 = fma(px * y, y, x2), fma(py * y, y, y2)
        s1, s2, sf = s1 + g, fma(g, g, s2), fma(load(x, image.f, here), g, sf)
        here, row_there = here + image.pitch, row_there + pitch
    x0, x1, y0, y1 = x0 * inside, x1 * inside, y0 * inside, y1 * inside
    _add_first(S, FX_G, x, x0, x1)
    _add_first(S, FY_G, x, y0, y1)
    if len(shape) == 12:
        _add_second(S, FX_G, x, x0, x1, x2 * inside)
        _add_second(S, FY_G, x, y0, y1, y2 * inside)
    S[G] += total(s1 * inside)
    S[GG] += total(s2 * inside)
    S[FG] += total(sf * inside)


@inner
def moments_of_smooth_warp(
    image: Reference,
    deformed: Deformed,
    taps: Taps,
    shape: Shape,
    centre: int,
    target: int,
    r: int,
    p: Flat,
    clipped: bool,
    shift: Flat,
    place: NDArray[np.int64],
    S: Flat,
) -> None:
    """Write the moments of the subset with the deformed image, 16 or 8 pixels of a row at a time.

    Smooth means that the warp changes by less than a pixel against the grid along 16 pixels of a row.
    """
    S[:] = 0.0
    left, remaining = -r, 2 * r + 1
    while remaining > 0:
        if remaining > 8:
            _lay_rows(shape, deformed.pitch, left, min(left + 15, r), r, p, shift, place)
            _strip(
                image,
                deformed,
                taps,
                shape,
                ramp16(left),
                left,
                centre,
                target,
                r,
                p,
                clipped,
                shift,
                place,
                S,
            )
            left, remaining = left + 16, remaining - 16
        else:
            _lay_rows(shape, deformed.pitch, left, r, r, p, shift, place)
            _strip(
                image,
                deformed,
                taps,
                shape,
                ramp8(left),
                left,
                centre,
                target,
                r,
                p,
                clipped,
                shift,
                place,
                S,
            )
            left, remaining = left + 8, remaining - 8


@inner
def moments_of_any_warp(
    image: Reference,
    deformed: Deformed,
    taps: Taps,
    shape: Shape,
    centre: int,
    target: int,
    r: int,
    p: Flat,
    S: Flat,
) -> None:
    """Write the moments of the subset with the deformed image, pixel by pixel, for large rotations."""
    S[:] = 0.0
    pitch = deformed.pitch
    first_tap = target - (len(taps) // 2 - 1) * (pitch + 1)
    zero, half = np.float32(0.0), np.float32(0.5)
    for j in range(-r, r + 1):
        y = np.float32(j)
        x0, x1, x2, y0, y1, y2 = zero, zero, zero, zero, zero, zero
        s1, s2, sf = zero, zero, zero
        for i in range(-r, r + 1):
            here = centre + j * image.pitch + i
            x = np.float32(i)
            to_x, to_y = p[0] + p[1] * x + p[2] * y, p[3] + p[4] * x + p[5] * y
            if len(shape) == 12:
                to_x += half * p[6] * x * x + p[7] * x * y + half * p[8] * y * y
                to_y += half * p[9] * x * x + p[10] * x * y + half * p[11] * y * y
            column, row = np.floor(to_x), np.floor(to_y)
            there = first_tap + (j + np.int64(row)) * pitch + i + np.int64(column)
            wx, wy = _weights(taps, to_x - column), _weights(taps, to_y - row)
            g = spread(deformed.c, there, pitch, wx, wy) * image.inside[here]
            px, py = image.fx[here] * g, image.fy[here] * g
            x0, x1, y0, y1 = x0 + px, x1 + px * x, y0 + py, y1 + py * x
            if len(shape) == 12:
                x2, y2 = x2 + px * x * x, y2 + py * x * x
            s1, s2, sf = s1 + g, s2 + g * g, sf + image.f[here] * g
        for at, m0, m1, m2 in ((FX_G, x0, x1, x2), (FY_G, y0, y1, y2)):
            S[at] += m0
            S[at + 1] += m1
            S[at + 2] += m0 * y
            S[at + 3] += m2
            S[at + 4] += m1 * y
            S[at + 5] += m0 * y * y
        S[G] += s1
        S[GG] += s2
        S[FG] += sf
