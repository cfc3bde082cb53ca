from .campaign_page import (
    outlier_text as outlier_text,
    plot_campaign as plot_campaign,
    statistics_cells as statistics_cells,
    symbol_of as symbol_of,
    write_campaign_report as write_campaign_report,
)
from .conditions import tables_of_test as tables_of_test
from .ontology import write_test_ontology as write_test_ontology
from .page import write_report as write_report
from .pdf import require_pdf as require_pdf
from .series_page import series_dict as series_dict, write_series_report as write_series_report
from .stated_facts import (
    StatedFacts as StatedFacts,
    read_stated_facts as read_stated_facts,
)
from .tensile_page import DECIMALS as DECIMALS, value_cell as value_cell
from .tensile_record import (
    ReportDetails as ReportDetails,
    TensileTest as TensileTest,
    tensile_test as tensile_test,
)
