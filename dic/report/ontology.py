"""Writes the properties of a test in the report in terms of the Tensile Test Ontology."""

from pathlib import Path

from dic.exports.tensile_ontology import AboutTest, write_tensile_ontology
from dic.pipeline.test_ontology import with_gauge
from dic.report.tensile_test import TensileTest
from dic.typing import PathLike


def write_test_ontology(test: TensileTest, path: PathLike, *, iri: str = "") -> list[str]:
    """Write the best values of a test as a Turtle file, in terms of the Tensile Test Ontology.

    The best values are those of `TensileTest.main`: the best kind of strain of the last camera. The file also
    contains the stated facts about laboratory, specimen and machine.

    Parameters
    ----------
    test : TensileTest
    path : path
    iri : str
        Beginning of the IRIs of the test's individuals; "" for IRIs relative to the place of the file.

    Returns
    -------
    list of str
        Keys of the properties that have a value but no class in the ontology, and are therefore not written.

    Raises
    ------
    OutputError
        If `iri` is no IRI.
    OSError
        If the file cannot be written.
    """
    column = test.main
    about = AboutTest(Path(test.title).stem, test.details.facts.tables, iri=iri)
    about = with_gauge(about, test.series_of(column.camera), test.gauge, column.read.kind)
    return write_tensile_ontology(column.properties, path, about)
