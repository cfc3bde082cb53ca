"""Render a surface: integrate the light over the area of each pixel."""

import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from simulators.scene.optics import PinholeCamera
from simulators.scene.scene import Surface

_ROWS_AT_ONCE = 32


def render(
    camera: PinholeCamera, surface: Surface, quadrature_order: int | None = None
) -> NDArray[np.float64]:
    """Return the mean reflectance (0 to 1) in each pixel, shape (height, width).

    For each quadrature point of a pixel, the function computes the exact intersection of the ray with the
    surface, and the material point there. The image is therefore exact at any sub-pixel displacement, without
    interpolation. `quadrature_order` is the number of Gauss points per pixel and direction. The default is
    the quadrature order of the texture.
    """
    columns = np.arange(camera.width_px)

    def band(first_row: int) -> NDArray[np.float64]:
        rows = np.arange(first_row, min(first_row + _ROWS_AT_ONCE, camera.height_px))
        return render_part(camera, surface, rows, columns, quadrature_order)

    first_rows = range(0, camera.height_px, _ROWS_AT_ONCE)
    if len(first_rows) == 1:
        return band(0)
    with ThreadPoolExecutor(os.cpu_count()) as threads:
        return np.concatenate(list(threads.map(band, first_rows)))


def render_part(
    camera: PinholeCamera,
    surface: Surface,
    rows: NDArray[np.int_],
    columns: NDArray[np.int_],
    quadrature_order: int | None = None,
) -> NDArray[np.float64]:
    """Return the mean reflectance in the pixels of some rows and columns, shape (rows, columns).

    See `render`. The function works on the calling thread.
    """
    order = quadrature_order or surface.texture.quadrature_order
    nodes, weights = np.polynomial.legendre.leggauss(order)
    offsets = nodes / 2
    x = (columns[:, None] + offsets).ravel()
    y = (rows[:, None] + offsets).ravel()
    px = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    samples = surface.texture.reflectance(surface.material(*camera.ray(px)))
    by_pixel = samples.reshape(len(rows), order, len(columns), order)
    mean: NDArray[np.float64] = np.einsum("rjci,j,i->rc", by_pixel, weights / 2, weights / 2)
    return mean
