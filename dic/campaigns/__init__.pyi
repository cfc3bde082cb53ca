from .campaign import (
    Campaign as Campaign,
    SpecimenTest as SpecimenTest,
    compare_specimens as compare_specimens,
)
from .file import (
    list_specimens as list_specimens,
    read_campaign as read_campaign,
)
from .specimen import (
    CampaignSpecimen as CampaignSpecimen,
    CurveColumns as CurveColumns,
    GaugeChoice as GaugeChoice,
    measure_campaign as measure_campaign,
)
from .table import write_campaign_table as write_campaign_table
