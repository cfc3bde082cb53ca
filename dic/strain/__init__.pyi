from .displacement import (
    Displacement as Displacement,
    Noise as Noise,
)
from .measurement import Measurement as Measurement
from .resolution import strain_resolution_px as strain_resolution_px
from .settings import StrainSettings as StrainSettings
from .strain import (
    MeanStrain as MeanStrain,
    StrainField as StrainField,
    gauge_text as gauge_text,
)
