from .cut_plot import plot_cuts as plot_cuts
from .declared import Gauge as Gauge
from .file import read_gauges as read_gauges
from .kinds import (
    GAUGES as GAUGES,
    Extensometer as Extensometer,
    LineCut as LineCut,
    PointGauge as PointGauge,
    StrainGauge as StrainGauge,
    TransverseExtensometer as TransverseExtensometer,
)
from .plot import plot_gauges as plot_gauges
from .reading import (
    Profile as Profile,
    Reading as Reading,
)
from .series import (
    GaugeImage as GaugeImage,
    GaugeSeries as GaugeSeries,
)
from .table import (
    gauge_table_files as gauge_table_files,
    write_gauge_table as write_gauge_table,
)
