from .contact_sheet import write_contact_sheet as write_contact_sheet
from .maps import write_maps as write_maps
from .panels import map_scale as map_scale
from .settings import (
    FORMATS as FORMATS,
    QUANTITIES as QUANTITIES,
    MapSettings as MapSettings,
    PlotSettings as PlotSettings,
    require_format as require_format,
)
