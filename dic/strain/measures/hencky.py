"""The Hencky (logarithmic) strain ½ ln C, which a rigid rotation does not change."""

import numpy as np

from dic.strain.measures.measure import of_stretch

MEASURE = of_stretch(
    "hencky", "Hencky (logarithmic)", lambda squared: 0.5 * np.log(squared), lambda squared: 1.0 / squared
)
