"""Warps, which give the position of a subset's pixels in the deformed image.

A warp is the vector p = (u, u_x, u_y, v, v_x, v_y) of the displacements u and v and their first derivatives.
A quadratic shape function adds the second derivatives (u_xx, u_xy, u_yy, v_xx, v_xy, v_yy). A pixel at the
offset (x, y) from the subset's centre moves to the right by
u + u_x x + u_y y + u_xx x²/2 + u_xy xy + u_yy y²/2, and downwards by the same polynomial of v. The
docstring of `dic.correlation.kernel.icgn` names the papers from which these warps are taken.
"""

import math

import numpy as np

from dic.correlation.kernel.jit import inner
from dic.correlation.kernel.layout import Deformed
from dic.correlation.kernel.method import Subset
from dic.typing import Float

EDGE_PX = 2
"""Smallest distance of a subset from the deformed image's edge. The spline mirrors pixels at the edge."""

# These arrays hold, for each warp parameter, its direction (0 for x, 1 for y), the powers of x and y in its
# monomial, and the factor of this monomial.
SIDE = np.array([0, 0, 0, 1, 1, 1, 0, 0, 0, 1, 1, 1])
POWER_X = np.array([0, 1, 0, 0, 1, 0, 2, 1, 0, 2, 1, 0])
POWER_Y = np.array([0, 0, 1, 0, 0, 1, 0, 1, 2, 0, 1, 2])
FACTOR = np.array([1, 1, 1, 1, 1, 1, 0.5, 1, 0.5, 0.5, 1, 0.5])


@inner
def monomial(power_x: int, power_y: int) -> int:
    """Return the index of the monomial x^power_x y^power_y in the order 1; x, y; x², xy, y²; …"""
    degree = power_x + power_y
    return degree * (degree + 1) // 2 + power_y


@inner
def compose_inverse(p: Float, d: Float) -> None:
    """Replace the affine warp p by p ∘ d⁻¹, the composition of p with the inverse of the step d."""
    a, b, c, e = 1.0 + d[1], d[2], d[4], 1.0 + d[5]
    det = a * e - b * c
    ia, ib, ic, ie = e / det, -b / det, -c / det, a / det
    ix, iy = -(ia * d[0] + ib * d[3]), -(ic * d[0] + ie * d[3])
    A, B, C, E = 1.0 + p[1], p[2], p[4], 1.0 + p[5]
    p[0] += A * ix + B * iy
    p[3] += C * ix + E * iy
    p[1], p[2] = A * ia + B * ic - 1.0, A * ib + B * ie
    p[4], p[5] = C * ia + E * ic, C * ib + E * ie - 1.0


@inner
def compose_inverse_quadratic(p: Float, d: Float, D: Float, rows: Float) -> None:
    """Replace the quadratic warp p by p ∘ d⁻¹, the composition of p with the inverse of the small step d.

    The inverse matrix is the series (I + D)⁻¹ = I - D + D² - …, up to the term D². The omitted terms become 0
    when the step becomes 0, so they do not change the converged result. The matrices D (6, 6) and rows (3, 6)
    are scratch memory; `rows` holds a row of the warp's matrix times 1, D and D².
    """
    _second_degree_matrix(d, D)
    for k in range(6):
        D[k, k] -= 1.0
    for side in range(2):
        at = 3 * side
        rows[0, 0], rows[0, 1], rows[0, 2] = p[at + 6] / 2, p[at + 7], p[at + 8] / 2
        rows[0, 3], rows[0, 4], rows[0, 5] = p[at + 1], p[at + 2], p[at]
        rows[0, 3 + side] += 1.0
        for power in range(1, 3):
            for j in range(6):
                rows[power, j] = 0.0
                for k in range(6):
                    rows[power, j] += rows[power - 1, k] * D[k, j]
        for k in range(6):
            rows[0, k] += rows[2, k] - rows[1, k]
        rows[0, 3 + side] -= 1.0
        p[at + 6], p[at + 7], p[at + 8] = 2.0 * rows[0, 0], rows[0, 1], 2.0 * rows[0, 2]
        p[at + 1], p[at + 2], p[at] = rows[0, 3], rows[0, 4], rows[0, 5]


@inner
def _second_degree_matrix(d: Float, D: Float) -> None:
    """Write the matrix that maps the monomials (x², xy, y², x, y, 1) of a pixel to those of the warped pixel.

    The matrix is equation 12 of Gao et al. (2015). Terms above the second degree are omitted.
    """
    for side in range(2):
        row, at = 3 + side, 3 * side
        D[row, 0], D[row, 1], D[row, 2] = d[at + 6] / 2, d[at + 7], d[at + 8] / 2
        D[row, 3], D[row, 4], D[row, 5] = d[at + 1], d[at + 2], d[at]
        D[row, row] += 1.0
    for row in range(3):
        # These rows belong to x'x', x'y' and y'y', which are products of the two polynomials above.
        i, j = 3 + row // 2, 3 + (row + 1) // 2
        for k in range(5):
            D[row, k] = D[i, k] * D[j, 5] + D[i, 5] * D[j, k]
        D[row, 0] += D[i, 3] * D[j, 3]
        D[row, 1] += D[i, 3] * D[j, 4] + D[i, 4] * D[j, 3]
        D[row, 2] += D[i, 4] * D[j, 4]
        D[row, 5] = D[i, 5] * D[j, 5]
    for k in range(6):
        D[5, k] = 1.0 if k == 5 else 0.0


@inner
def extrapolate(p: Float, dx: float, dy: float, q: Float) -> None:
    """Write into q the warp that the warp p predicts for a point at the distance (dx, dy)."""
    for k in range(len(p)):
        q[k] = p[k]
    for at in (0, 3):
        q[at] += p[at + 1] * dx + p[at + 2] * dy
        if len(p) > 6:
            xx, xy, yy = p[at + 6], p[at + 7], p[at + 8]
            q[at] += xx * dx * dx / 2 + xy * dx * dy + yy * dy * dy / 2
            q[at + 1] += xx * dx + xy * dy
            q[at + 2] += xy * dx + yy * dy


@inner
def step_length_px(d: Float, r: int) -> float:
    """Return the approximate distance by which a step moves the pixels at the subset's edge, px."""
    square = 0.0
    for i in range(len(d)):
        move = FACTOR[i] * d[i]
        for _ in range(POWER_X[i] + POWER_Y[i]):
            move *= r
        square += move * move
    return math.sqrt(square)


@inner
def in_view(image: Deformed, subset: Subset, p: Float) -> bool:
    """Return True if the warped subset stays in the image, with a margin for second derivatives."""
    reach_x, reach_y = _reach(subset.radius, p)
    to_x, to_y = subset.x + p[0], subset.y + p[3]
    across = to_x - reach_x >= EDGE_PX and to_x + reach_x < image.width - EDGE_PX - 1
    down = to_y - reach_y >= EDGE_PX and to_y + reach_y < image.height - EDGE_PX - 1
    return bool(across and down)


@inner
def is_laid(image: Deformed, subset: Subset, p: Float, room_px: int) -> bool:
    """Return True if the rows of the warped subset are laid, and `room_px` more rows on either side."""
    _, reach_y = _reach(subset.radius, p)
    to_y, room = subset.y + p[3], EDGE_PX + room_px
    return bool(to_y - reach_y >= image.top + room and to_y + reach_y < image.bottom - room - 1)


@inner
def _reach(r: int, p: Float) -> tuple[float, float]:
    """Return how far a warped subset of radius `r` reaches from its centre along x and along y, px."""
    reach_x = r * (abs(1.0 + p[1]) + abs(p[2]))
    reach_y = r * (abs(p[4]) + abs(1.0 + p[5]))
    for i in range(6, len(p)):
        bulge = FACTOR[i] * r * r * abs(p[i])
        if SIDE[i] == 0:
            reach_x += bulge
        else:
            reach_y += bulge
    return reach_x, reach_y


@inner
def is_smooth(p: Float, r: int) -> bool:
    """Return True if displacements differ by less than 1 px within any 16 pixels of a row of the subset."""
    steepest_x, steepest_y = abs(p[1]), abs(p[4])
    if len(p) > 6:
        steepest_x += r * (abs(p[6]) + abs(p[7]))
        steepest_y += r * (abs(p[9]) + abs(p[10]))
    return bool(16.0 * max(steepest_x, steepest_y) < 1.0)
