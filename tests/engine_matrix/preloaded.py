"""What each process of the matrix begins with: the modules of a run, and numba ready to call functions."""

from importlib import import_module

import numpy as np

from simulators.scene.optics import PinholeCamera

for _module in ("tests.engine_matrix.cells", "simulators.rig.virtual_rig", "simulators.rig.operator"):
    import_module(_module)
# the first call of a compiled function loads a great part of numba
PinholeCamera(2, 2).ray(np.zeros((1, 2)))
