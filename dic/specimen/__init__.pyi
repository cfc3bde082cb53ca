from .find import (
    Specimen as Specimen,
    find_specimen as find_specimen,
)
from .write import (
    RegionFiles as RegionFiles,
    region_files as region_files,
    write_region as write_region,
)
