"""Weights of B-spline coefficients for interpolation, computed for a vector of positions at once.

A cubic spline needs 4 coefficients ("taps") in each direction, and a quintic spline needs 6. The weights in
this module are multiplied by the denominator of the B-spline, 6 or 120, so that no division is needed. In
return, `dic.correlation.kernel.layout` divides the coefficients by the denominator, once for each direction.
"""

from dic.correlation.kernel.jit import inlined
from dic.correlation.kernel.method import Taps
from dic.correlation.kernel.vectors import Vector, at_least, select, splat


@inlined
def weights(taps: Taps, t: Vector) -> tuple[Vector, ...]:
    """Return the weights of the spline coefficients (taps) around positions whose fractional part is `t`."""
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
def weights_in_two_cells(taps: Taps, t: Vector) -> tuple[Vector, ...]:
    """Return weights of the spline coefficients (taps) and of one extra tap, for positions `t` in [0, 2).

    A position in [0, 1) lies in the first cell between pixels, and the last tap gets the weight 0. A position
    in [1, 2) lies in the next cell, and the first tap gets the weight 0.
    """
    zero, one = splat(t, 0.0), splat(t, 1.0)
    in_next = at_least(t, one)
    w = weights(taps, t - select(in_next, one, zero))
    if len(taps) == 4:
        return (
            select(in_next, zero, w[0]),
            select(in_next, w[0], w[1]),
            select(in_next, w[1], w[2]),
            select(in_next, w[2], w[3]),
            select(in_next, w[3], zero),
        )
    return (
        select(in_next, zero, w[0]),
        select(in_next, w[0], w[1]),
        select(in_next, w[1], w[2]),
        select(in_next, w[2], w[3]),
        select(in_next, w[3], w[4]),
        select(in_next, w[4], w[5]),
        select(in_next, w[5], zero),
    )
