"""Compile all kernels before the tests, so that not every worker compiles them.

`make test` runs this module at the same time as the type checker: `python -m tests.compile_kernel`.
"""

import numpy as np

from dic.correlation.correlator import Correlator
from dic.correlation.settings import CorrelationSettings
from dic.strain.measurement import measure
from simulators.scene.optics import PinholeCamera
from simulators.scene.render import render
from simulators.scene.scene import Surface
from simulators.scene.texture import LineGrid, Speckle


def main() -> None:
    pattern = np.random.default_rng(1).uniform(0.0, 255.0, (80, 80)).astype(np.float32)
    for shape in ("affine", "quadratic"):
        settings = CorrelationSettings(21, 10, shape=shape)
        field = Correlator(pattern, np.ones(pattern.shape, bool), settings).correlate(pattern)
        # The first local strain compiles the fits of windows.
        assert measure(field).strain.exx.shape == field.status.shape
    camera = PinholeCamera(60, 60, pan_deg=20.0, k1_per_px2=-5e-8)
    for texture in (LineGrid(), Speckle.sprayed(1)):
        render(camera, Surface(texture))


if __name__ == "__main__":
    main()
