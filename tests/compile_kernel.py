"""Compile the correlation kernel before the tests; otherwise each of their workers compiles it for itself.

The test command runs this module beside the type checker: `python -m tests.compile_kernel`.
"""

import numpy as np

from dic.correlation.correlator import Correlator
from dic.correlation.settings import CorrelationSettings


def main() -> None:
    pattern = np.random.default_rng(1).uniform(0.0, 255.0, (80, 80)).astype(np.float32)
    for shape in ("affine", "quadratic"):
        settings = CorrelationSettings(21, 10, shape=shape)
        Correlator(pattern, np.ones(pattern.shape, bool), settings).correlate(pattern)


if __name__ == "__main__":
    main()
