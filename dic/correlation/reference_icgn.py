"""A short but slow version of the IC-GN method for one point in plain NumPy.

Read this module before the compiled kernel. The method is the same as in `dic.correlation.kernel.icgn`. The
code is written as in the papers, with one array for each symbol, and computes in double precision. Tests
compare the kernel with this module.
"""

import numpy as np

from dic.image.spline import MARGIN, SplineImage
from dic.typing import Float, Mask


def shape_functions(x: Float, y: Float, parameters: int) -> Float:
    """Return the polynomial terms of u (or of v) at n offsets (x, y) from the point, (n, 3) or (n, 6)."""
    columns = [np.ones_like(x), x, y]
    if parameters == 12:
        columns += [x**2 / 2, x * y, y**2 / 2]
    return np.stack(columns, axis=1)


def interpolate(spline: SplineImage, x: Float, y: Float) -> Float:
    """Return the grey levels of a spline image at n positions (x, y) inside the image, shape (n,)."""
    from scipy.interpolate import BSpline

    half = (spline.order + 1) // 2
    basis = BSpline.basis_element(np.arange(-half, half + 1), extrapolate=False)
    column, row = np.floor(x).astype(int), np.floor(y).astype(int)
    grey = np.zeros_like(x)
    for j in range(1 - half, half + 1):
        for i in range(1 - half, half + 1):
            weight = np.nan_to_num(basis(x - column - i)) * np.nan_to_num(basis(y - row - j))
            grey += weight * spline.coefficients[row + j + MARGIN, column + i + MARGIN]
    return grey


def split(p: Float) -> tuple[Float, Float]:
    """Split a warp into the parameters of u and the parameters of v, in the order of `shape_functions`."""
    u, v = p[0:3], p[3:6]
    return (np.r_[u, p[6:9]], np.r_[v, p[9:12]]) if len(p) == 12 else (u, v)


def icgn(
    reference: SplineImage,
    deformed: SplineImage,
    region: Mask,
    point: tuple[int, int],
    radius: int,
    start: Float,
    iterations: int = 60,
) -> tuple[Float, float]:
    """Return the warp of one point and its ZNCC after the given number of iterations.

    The default number of iterations is so large that the warp no longer changes in the last iterations.

    `region`, shape (height, width): True at pixels that the subset may use. `point`: coordinates x and y of
    the point in the reference, px. `radius`: half of the subset's width. `start`, shape (6,) or (12,): first
    guess of the warp, in the order of `dic.correlation.kernel.warps`.
    """
    dy, dx = np.mgrid[-radius : radius + 1, -radius : radius + 1]
    inside = region[point[1] + dy, point[0] + dx]
    x, y = dx[inside].astype(np.float64), dy[inside].astype(np.float64)
    row, column = point[1] + dy[inside], point[0] + dx[inside]
    f = reference.grey[row, column].astype(np.float64)
    fx, fy = (slope[row, column].astype(np.float64) for slope in reference.gradient())
    N = shape_functions(x, y, len(start))
    steepest_descent = np.hstack([fx[:, None] * N, fy[:, None] * N])
    hessian = steepest_descent.T @ steepest_descent
    f_tilde = f - f.mean()

    p, zncc = start.astype(np.float64), np.nan
    for _ in range(iterations):
        pu, pv = split(p)
        g = interpolate(deformed, point[0] + x + N @ pu, point[1] + y + N @ pv)
        g_tilde = g - g.mean()
        gain = np.linalg.norm(f_tilde) / np.linalg.norm(g_tilde)
        zncc = float(f_tilde @ g_tilde * gain / (f_tilde @ f_tilde))
        step = np.linalg.solve(hessian, steepest_descent.T @ (gain * g_tilde - f_tilde))
        p = compose_inverse(p, step, radius)
    return p, zncc


def compose_inverse(p: Float, step: Float, radius: int) -> Float:
    """Return the composition of the warp `p` with the inverse of the warp `step`.

    The array `step` holds the parameters of u, then those of v. At every offset x, the composed warp maps
    W(step)(x) to W(p)(x), where W is the warp function. The parameters of the composed warp are fitted to
    such pairs of points.
    """
    half = len(step) // 2
    side = np.linspace(-radius, radius, 7)
    x, y = (a.ravel() for a in np.meshgrid(side, side))
    N = shape_functions(x, y, len(p))
    pu, pv = split(p)
    stepped_x, stepped_y = x + N @ step[:half], y + N @ step[half:]
    basis = shape_functions(stepped_x, stepped_y, len(p))
    qu = np.linalg.lstsq(basis, x + N @ pu - stepped_x, rcond=None)[0]
    qv = np.linalg.lstsq(basis, y + N @ pv - stepped_y, rcond=None)[0]
    composed: Float = np.r_[qu[:3], qv[:3], qu[3:], qv[3:]]
    return composed
