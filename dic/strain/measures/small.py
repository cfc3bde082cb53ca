"""The small (engineering) strain (G + Gᵀ)/2, which is accurate only for small rotations."""

import numpy as np

from dic.strain.measure_kernel import SMALL
from dic.strain.measures.measure import Measure, Tensor, components
from dic.typing import Float


def _tensor(gradient: Float) -> Tensor:
    gxx, gxy, gyx, gyy = components(gradient)
    return np.stack([gxx, gyy, (gxy + gyx) / 2], axis=-1), np.empty((0, 3, 3))


MEASURE = Measure("small", "Small (engineering)", _tensor, lambda stretch: 1.0, SMALL)
