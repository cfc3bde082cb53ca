"""Writes the properties of a test in the report in terms of the Tensile Test Ontology."""

from dic.derived.ontology_facts import about_series
from dic.exports.tensile_ontology import write_tensile_ontology
from dic.report.tensile_record import TensileTest
from dic.typing import PathLike


def write_test_ontology(test: TensileTest, path: PathLike, *, iri: str = "") -> list[str]:
    """Write the best values of a test as a Turtle file, in terms of the Tensile Test Ontology.

    The best values are those of `TensileTest.main`: the best kind of strain of the last camera. The file also
    contains the stated facts about laboratory, specimen and machine, and the run's name of the specimen and
    its date.

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
    series, facts = test.series_of(column.camera), test.details.facts.tables
    about = about_series(series, test.gauge, column.read.kind, facts, title=test.title, iri=iri)
    return write_tensile_ontology(column.properties, path, about)
