"""The kinds of phases of a protocol, each in a module of its own. A new kind is registered in `PHASES`."""

from rig.protocol.draft import Phase
from rig.protocol.phases.ask import Ask
from rig.protocol.phases.cycles import Cycles
from rig.protocol.phases.hold import Hold
from rig.protocol.phases.preload import Preload
from rig.protocol.phases.pull import Pull
from rig.protocol.phases.rotate import Rotate
from rig.protocol.phases.to_displacement import ToDisplacement
from rig.protocol.phases.to_load import ToLoad
from rig.protocol.phases.unload import Unload

PHASES: tuple[type[Phase], ...] = (Preload, ToLoad, ToDisplacement, Pull, Hold, Cycles, Unload, Rotate, Ask)
"""All kinds of phases, in the order in which error messages list them."""
