"""Sums over a subset: of the reference alone, and of the reference with the warped deformed image.

All that IC-GN needs of a subset is a handful of such moments, so no array of subset size exists. Images are
flat arrays of float32, `pitch` elements a row (`dic.kernel.layout`); f is the reference, zero outside the
region of interest like its slopes fx and fy, and g the deformed image, whose spline has the coefficients c.
"""

import numpy as np
from numpy.typing import NDArray

from dic.kernel.jit import compiled, inlined
from dic.kernel.layout import Reference
from dic.kernel.vectors import at_least, blend, fma, load, ramp8, ramp16, select, splat, spread, total

Flat = NDArray[np.float32]
Vector = NDArray[np.float32]
Taps = tuple[float, ...]

# Moments of the reference, by place: three products of slopes times 1, x, y, x², xy, y²; slopes times f and
# slopes alone times 1, x, y, each for fx and fy; f and f².
FX_F, FY_F, FX, FY, F, FF = 18, 21, 24, 27, 30, 31
REFERENCE_MOMENTS = 32
# Moments with the deformed image: fx g and fy g times 1, x, y; g, g² and f g.
G, GG, FG = 6, 7, 8
MOMENTS = 9


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


@compiled
def _reference_strip(image: Reference, x: Vector, inside: Vector, first: int, r: int, Q: Flat) -> None:
    """Add one strip of the subset, as wide as the vector of its offsets `x`, to the reference's moments."""
    zero = splat(x, 0.0)
    a0, a1, a2, b0, b1, b2, c0, c1, c2 = zero, zero, zero, zero, zero, zero, zero, zero, zero
    d0, d1, e0, e1, g0, g1, h0, h1, f1, f2 = zero, zero, zero, zero, zero, zero, zero, zero, zero, zero
    place = first
    for j in range(-r, r + 1):
        y = splat(x, j)
        f, fx, fy = load(x, image.f, place), load(x, image.fx, place), load(x, image.fy, place)
        place += image.pitch
        xx, xy, yy, xf, yf = fx * fx, fx * fy, fy * fy, fx * f, fy * f
        a0, a1, a2 = a0 + xx, fma(xx, y, a1), fma(xx * y, y, a2)
        b0, b1, b2 = b0 + xy, fma(xy, y, b1), fma(xy * y, y, b2)
        c0, c1, c2 = c0 + yy, fma(yy, y, c1), fma(yy * y, y, c2)
        d0, d1, e0, e1 = d0 + xf, fma(xf, y, d1), e0 + yf, fma(yf, y, e1)
        g0, g1, h0, h1 = g0 + fx, fma(fx, y, g1), h0 + fy, fma(fy, y, h1)
        f1, f2 = f1 + f, fma(f, f, f2)
    # Lanes beyond the subset have read its neighbours: `inside` is 1 within and 0 there.
    k = 0
    for s0, s1, s2 in ((a0, a1, a2), (b0, b1, b2), (c0, c1, c2)):
        s0, s1, s2 = s0 * inside, s1 * inside, s2 * inside
        Q[k] += total(s0)
        Q[k + 1] += total(s0 * x)
        Q[k + 2] += total(s1)
        Q[k + 3] += total(s0 * x * x)
        Q[k + 4] += total(s1 * x)
        Q[k + 5] += total(s2)
        k += 6
    for s0, s1 in ((d0, d1), (e0, e1), (g0, g1), (h0, h1)):
        s0, s1 = s0 * inside, s1 * inside
        Q[k] += total(s0)
        Q[k + 1] += total(s0 * x)
        Q[k + 2] += total(s1)
        k += 3
    Q[F] += total(f1 * inside)
    Q[FF] += total(f2 * inside)


@compiled
def reference_moments(image: Reference, centre: int, r: int, Q: Flat) -> None:
    """Write the moments of the subset around the element `centre` of the reference."""
    Q[:] = 0.0
    left, remaining = -r, 2 * r + 1
    while remaining > 0:
        first = centre - r * image.pitch + left
        if remaining > 8:
            x = ramp16(left)
            _reference_strip(image, x, _inside(x, r), first, r, Q)
            left, remaining = left + 16, remaining - 16
        else:
            x8 = ramp8(left)
            _reference_strip(image, x8, _inside(x8, r), first, r, Q)
            left, remaining = left + 8, remaining - 8


@inlined
def _inside(x: Vector, r: int) -> Vector:
    """Return 1 where the offset `x` belongs to the subset and 0 beyond it."""
    ones: Vector = select(at_least(splat(x, r), x), splat(x, 1.0), splat(x, 0.0))
    return ones


@compiled
def _strip(
    image: Reference,
    c: Flat,
    taps: Taps,
    x: Vector,
    left: int,
    right: int,
    centre: int,
    r: int,
    p: Flat,
    clipped: bool,
    shift: Flat,
    place: NDArray[np.int64],
    S: Flat,
) -> None:
    """Add one strip to the moments with the deformed image, for a smooth warp.

    Smooth means that along the strip's row, from offset `left` to `right`, the warp changes by less than one
    pixel against the grid: all lanes then read neighbouring taps, or, for two pixels at most, one tap more.
    """
    n = 2 * r + 1
    u, ux, uy, v, vx, vy = p[0], p[1], p[2], p[3], p[4], p[5]
    low_x, high_x = u + min(ux * left, ux * right), u + max(ux * left, ux * right)
    low_y, high_y = v + min(vx * left, vx * right), v + max(vx * left, vx * right)
    for j in range(n):
        y = np.float32(j - r)
        column, row = np.floor(low_x + uy * y), np.floor(low_y + vy * y)
        shift[0, j], shift[1, j] = uy * y - column, vy * y - row
        place[0, j] = np.int64(row) * image.pitch + np.int64(column)
        two_x, two_y = high_x + uy * y - column >= 1.0, high_y + vy * y - row >= 1.0
        place[1, j] = np.int64(two_x) + 2 * np.int64(two_y)
    zero = splat(x, 0.0)
    to_x, to_y = fma(splat(x, ux), x, splat(x, u)), fma(splat(x, vx), x, splat(x, v))
    x0, x1, y0, y1, s1, s2, sf = zero, zero, zero, zero, zero, zero, zero
    here = centre - r * image.pitch + left
    first_tap = (len(taps) // 2 - 1) * (image.pitch + 1)
    for j in range(n):
        tx, ty = to_x + splat(x, shift[0, j]), to_y + splat(x, shift[1, j])
        there = here + place[0, j] - first_tap
        two = place[1, j]
        if two == 0:
            g = blend(c, there, image.pitch, _weights(taps, tx), _weights(taps, ty))
        elif two == 1:
            g = blend(c, there, image.pitch, _weights_of_two(taps, tx), _weights(taps, ty))
        elif two == 2:
            g = blend(c, there, image.pitch, _weights(taps, tx), _weights_of_two(taps, ty))
        else:
            g = blend(c, there, image.pitch, _weights_of_two(taps, tx), _weights_of_two(taps, ty))
        if clipped:
            g = g * load(x, image.inside, here)
        y_vector = splat(x, j - r)
        px, py = load(x, image.fx, here) * g, load(x, image.fy, here) * g
        x0, x1, y0, y1 = x0 + px, fma(px, y_vector, x1), y0 + py, fma(py, y_vector, y1)
        s1, s2, sf = s1 + g, fma(g, g, s2), fma(load(x, image.f, here), g, sf)
        here += image.pitch
    inside = _inside(x, r)
    x0, y0 = x0 * inside, y0 * inside
    S[0] += total(x0)
    S[1] += total(x0 * x)
    S[2] += total(x1 * inside)
    S[3] += total(y0)
    S[4] += total(y0 * x)
    S[5] += total(y1 * inside)
    S[G] += total(s1 * inside)
    S[GG] += total(s2 * inside)
    S[FG] += total(sf * inside)


@compiled
def moments_of_smooth_warp(
    image: Reference,
    c: Flat,
    taps: Taps,
    centre: int,
    r: int,
    p: Flat,
    clipped: bool,
    shift: Flat,
    place: NDArray[np.int64],
    S: Flat,
) -> None:
    """Write the moments of the subset with the deformed image, 16 or 8 pixels of a row at a time."""
    S[:] = 0.0
    left, remaining = -r, 2 * r + 1
    while remaining > 0:
        if remaining > 8:
            right = min(left + 15, r)
            _strip(image, c, taps, ramp16(left), left, right, centre, r, p, clipped, shift, place, S)
            left, remaining = left + 16, remaining - 16
        else:
            _strip(image, c, taps, ramp8(left), left, r, centre, r, p, clipped, shift, place, S)
            left, remaining = left + 8, remaining - 8


@compiled
def moments_of_any_warp(image: Reference, c: Flat, taps: Taps, centre: int, r: int, p: Flat, S: Flat) -> None:
    """Write the moments of the subset with the deformed image, pixel by pixel, for large rotations."""
    S[:] = 0.0
    u, ux, uy, v, vx, vy = p[0], p[1], p[2], p[3], p[4], p[5]
    first_tap = (len(taps) // 2 - 1) * (image.pitch + 1)
    zero = np.float32(0.0)
    for j in range(-r, r + 1):
        y = np.float32(j)
        x0, x1, y0, y1, s1, s2, sf = zero, zero, zero, zero, zero, zero, zero
        for i in range(-r, r + 1):
            here = centre + j * image.pitch + i
            weight = image.inside[here]
            x = np.float32(i)
            to_x, to_y = u + ux * x + uy * y, v + vx * x + vy * y
            column, row = np.floor(to_x), np.floor(to_y)
            there = here + np.int64(row) * image.pitch + np.int64(column) - first_tap
            wx, wy = _weights(taps, to_x - column), _weights(taps, to_y - row)
            g = spread(c, there, image.pitch, wx, wy) * weight
            px, py = image.fx[here] * g, image.fy[here] * g
            x0 += px
            x1 += px * x
            y0 += py
            y1 += py * x
            s1 += g
            s2 += g * g
            sf += image.f[here] * g
        S[0] += x0
        S[1] += x1
        S[2] += x0 * y
        S[3] += y0
        S[4] += y1
        S[5] += y0 * y
        S[G] += s1
        S[GG] += s2
        S[FG] += sf
