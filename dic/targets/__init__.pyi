from .find import find_target as find_target
from .kinds import (
    TARGETS as TARGETS,
    AsymmetricDotTarget as AsymmetricDotTarget,
    CharucoTarget as CharucoTarget,
    CheckerboardTarget as CheckerboardTarget,
    DotTarget as DotTarget,
    LineGridTarget as LineGridTarget,
    Target as Target,
)
from .points import GridPoints as GridPoints
from .sheet.draw import draw_target as draw_target
