"""What a strain measure is: a symmetric tensor that follows from the displacement gradient.

In the formulas G is the displacement gradient, F = I + G is the deformation gradient, and C = FᵀF is the
right Cauchy-Green tensor, whose eigenvalues are the squares of the stretches λ. The strain components refer
to the x and y axes of the displacement in the undeformed state.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dic.strain.measure_kernel import GREEN
from dic.strain.principal import principal, turned
from dic.typing import Float

Tensor = tuple[Float, Float]
"""Strains exx, eyy, exy, shape (…, 3), and their derivatives with respect to the strains of the base.

The derivatives have the shape (…, 3, 3), or (0, 3, 3) if the strains are those of the base themselves.
"""


@dataclass(frozen=True)
class Measure:
    """A strain measure."""

    name: str
    """Name in settings and files."""
    title: str
    """Name in reports."""
    tensor: Callable[[Float], Tensor]
    """Function that returns the `Tensor` of displacement gradients, shape (…, 2, 2)."""
    by_engineering: Callable[[float], float]
    """Function that returns the derivative of engineering strain with respect to this measure, at a stretch
    λ.
    """
    base: int = GREEN
    """`GREEN` or `SMALL`: the strain whose derivatives the compiled functions take."""


def green(gradient: Float) -> Float:
    """Return the Green-Lagrange strains (C - I)/2 as exx, eyy, exy, shape (…, 3)."""
    gxx, gxy, gyx, gyy = components(gradient)
    fxx, fyy = 1.0 + gxx, 1.0 + gyy
    return np.stack(
        [
            (fxx * fxx + gyx * gyx) / 2 - 0.5,
            (gxy * gxy + fyy * fyy) / 2 - 0.5,
            (fxx * gxy + gyx * fyy) / 2,
        ],
        axis=-1,
    )


def components(gradient: Float) -> tuple[Float, Float, Float, Float]:
    """Return the components xx, xy, yx, yy of displacement gradients, shape (…, 2, 2)."""
    return gradient[..., 0, 0], gradient[..., 0, 1], gradient[..., 1, 0], gradient[..., 1, 1]


def of_stretch(
    name: str, title: str, value: Callable[[Float], Float], slope: Callable[[Float], Float]
) -> Measure:
    """Return the measure whose principal strains are a function of the principal stretches.

    Its principal axes are those of the Green-Lagrange strain, from which it is computed. In these axes, the
    derivative of a function of a symmetric tensor consists of divided differences of the function (G. H.
    Golub, C. F. Van Loan, Matrix Computations, 9.1.4).

    `value`, `slope`: functions of λ² that return the strain, and its derivative with respect to the
    Green-Lagrange strain.
    """

    def tensor(gradient: Float) -> Tensor:
        (e1, e2, angle), _ = principal(green(gradient))
        # A stretch of 0 has no logarithm; the strain is NaN there.
        stretched = 1.0 + 2.0 * np.stack([e1, e2])
        l1, l2 = np.where(stretched > 0.0, stretched, np.nan)
        h1, h2, by_h1, by_h2 = value(l1), value(l2), slope(l1), slope(l2)
        apart = l1 - l2 > 1e-9 * l1
        shear = np.where(apart, 2.0 * (h1 - h2) / np.where(apart, l1 - l2, 1.0), by_h1)
        diagonal = np.zeros((*np.shape(e1), 3, 3))
        diagonal[..., 0, 0], diagonal[..., 1, 1], diagonal[..., 2, 2] = by_h1, by_h2, shear
        back = turned(-angle)
        strain = np.stack([h1, h2, np.zeros_like(h1)], axis=-1)
        return (back @ strain[..., None])[..., 0], back @ diagonal @ turned(angle)

    def by_engineering(stretch: float) -> float:
        return 1.0 / (float(slope(np.array(stretch * stretch))) * stretch)

    return Measure(name, title, tensor, by_engineering)
