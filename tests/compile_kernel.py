"""Compile all kernels before the tests, so that not every worker compiles them.

`make test` runs this module at the same time as the type checker: `python -m tests.compile_kernel`.
"""

import numpy as np

from dic.correlation.correlator import Correlator
from dic.correlation.settings import CorrelationSettings
from dic.strain.measurement import measure
from dic.strain.tensor import shared_std
from simulators.scene.optics import PinholeCamera
from simulators.scene.render import render
from simulators.scene.scene import Surface
from simulators.scene.texture import LineGrid, Speckle


def main() -> None:
    pattern = np.random.default_rng(1).uniform(0.0, 255.0, (80, 80)).astype(np.float32)
    region = np.ones(pattern.shape, bool)
    # Windows beside a crack need to know which points see each other.
    region[40:42, 20:60] = False
    for shape, order in (("affine", 5), ("quadratic", 5), ("affine", 3)):
        settings = CorrelationSettings(21, 10, shape=shape, order=order)
        field = Correlator(pattern, region, settings).correlate(pattern)
        # The first local strain compiles the fits of windows.
        assert measure(field).strain.exx.shape == field.status.shape
    assert shared_std(np.array([[2e-3, 0.0, 1e-3]]), np.eye(3)).shape == (6, 1)
    camera = PinholeCamera(60, 60, pan_deg=20.0, k1_per_px2=-5e-8)
    for texture in (LineGrid(), Speckle.sprayed(1)):
        render(camera, Surface(texture))


if __name__ == "__main__":
    main()
