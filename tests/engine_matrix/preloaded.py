"""Import the modules of a run and run compiled code once, at the start of each process of the matrix."""

from importlib import import_module

from simulators.scene.optics import PinholeCamera
from simulators.scene.render import render
from simulators.scene.scene import Surface
from simulators.scene.texture import LineGrid, Speckle

for _module in ("tests.engine_matrix.cells", "simulators.rig.virtual_rig", "simulators.rig.operator"):
    import_module(_module)
# The first call of each compiled function loads its machine code. A line that is silent meanwhile would fail.
for _texture in (LineGrid(), Speckle.sprayed(1)):
    render(PinholeCamera(2, 2), Surface(_texture))
