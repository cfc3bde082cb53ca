from .alignment import (
    Alignment as Alignment,
    load_alignment as load_alignment,
    save_alignment as save_alignment,
)
from .correct import Corrections as Corrections
from .correction import Correction as Correction
from .diagnosis import Sensitivity as Sensitivity
from .motion import Motion as Motion
from .plane import Plane as Plane
from .two_cameras import TwoCameraStep as TwoCameraStep
