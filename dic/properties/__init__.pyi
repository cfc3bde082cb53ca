from .anisotropy import planar_anisotropy as planar_anisotropy
from .curve import (
    Curve as Curve,
    read_curve as read_curve,
)
from .plot import plot_properties as plot_properties
from .properties import (
    Properties as Properties,
    material_properties as material_properties,
)
from .settings import PropertySettings as PropertySettings
from .shared_error import (
    JoinError as JoinError,
    with_delay_error as with_delay_error,
    with_join_error as with_join_error,
    with_shared_error as with_shared_error,
)
from .value import PropertyValue as PropertyValue
