from .correlator import Correlator as Correlator
from .field import Field as Field
from .initial_guess import rigid_motion as rigid_motion
from .repetition import Repetition as Repetition
from .series import Series as Series
from .settings import (
    CorrelationSettings as CorrelationSettings,
    ReferenceSettings as ReferenceSettings,
)
from .status import Status as Status
