from .camera import (
    LiveCamera as LiveCamera,
    MotionNow as MotionNow,
)
from .field_solver import (
    FieldSolver as FieldSolver,
    PairSolver as PairSolver,
)
from .image import (
    LiveGauge as LiveGauge,
    LiveImage as LiveImage,
    LiveValue as LiveValue,
)
from .motion import (
    Bend as Bend,
    FieldMotion as FieldMotion,
    SharedErrors as SharedErrors,
)
from .pair import (
    LivePair as LivePair,
    surface_of as surface_of,
)
from .reasons import Reason as Reason
from .settings import LiveSettings as LiveSettings
from .setup import LiveSetup as LiveSetup
from .setups import (
    LiveHow as LiveHow,
    LiveSetups as LiveSetups,
)
from .sought import (
    LostPlaces as LostPlaces,
    Sought as Sought,
)
