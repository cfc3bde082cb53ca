from .formats import EXPORTS as EXPORTS
from .tensile_ontology import (
    AboutTest as AboutTest,
    write_tensile_ontology as write_tensile_ontology,
)
