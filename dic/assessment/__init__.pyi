from .assessment import (
    Assessment as Assessment,
    assess_method as assess_method,
)
from .plots import plot_assessment as plot_assessment
