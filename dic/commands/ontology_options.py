"""Options of `dic properties` and `dic report` for a file in terms of the Tensile Test Ontology."""

from collections.abc import Sequence
from pathlib import Path

import dic


def require_iri(iri: str | None) -> None:
    """Raise an error if the beginning of the names is no IRI, before any work is done."""
    dic.exports.AboutTest("", iri=iri or "")


def ontology_line(path: Path, left_out: Sequence[str]) -> str:
    """Return a line that names the written file, and the properties that have no class in the ontology."""
    without = f"; the ontology has no class for {', '.join(left_out)}" if left_out else ""
    return f"ontology: {path}{without}"
