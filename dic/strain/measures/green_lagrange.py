"""The Green-Lagrange strain (C - I)/2, which a rigid rotation does not change."""

import numpy as np

from dic.strain.measures.measure import Measure, green

MEASURE = Measure(
    "green-lagrange",
    "Green–Lagrange",
    lambda gradient: (green(gradient), np.empty((0, 3, 3))),
    lambda stretch: 1.0 / stretch,
)
