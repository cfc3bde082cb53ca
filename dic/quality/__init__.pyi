from .findings import quality_findings as quality_findings
from .plot import plot_quality as plot_quality
from .quality import (
    Quality as Quality,
    assess_quality as assess_quality,
)
