from .animation import (
    Animation as Animation,
    write_animation as write_animation,
)
from .channel_tables import (
    ChannelSummary as ChannelSummary,
    ChannelTable as ChannelTable,
    channel_summaries as channel_summaries,
    write_channels as write_channels,
)
from .compared import compare_results as compare_results
from .export import (
    Export as Export,
    export_results as export_results,
)
from .export_tables import (
    to_pandas as to_pandas,
    to_xarray as to_xarray,
)
from .gauge_record import (
    GaugeCurve as GaugeCurve,
    gauge_curve as gauge_curve,
    join_record as join_record,
)
from .gauge_series import (
    GaugeReader as GaugeReader,
    is_results as is_results,
    measure_gauges as measure_gauges,
    write_gauge_picture as write_gauge_picture,
)
from .image_clock import ImageClock as ImageClock
from .kept_readings import KeptReadings as KeptReadings
from .ontology_facts import about_curve as about_curve, about_series as about_series
from .run_tables import write_run_tables as write_run_tables
from .series_files import GAUGE_FILE as GAUGE_FILE, SeriesFiles as SeriesFiles, SeriesOutputs as SeriesOutputs
from .series_maps import SeriesMaps as SeriesMaps
from .whole_field import whole_field_gauges as whole_field_gauges
