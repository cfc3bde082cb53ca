"""Writes material properties in terms of the Tensile Test Ontology (TTO) of the Platform MaterialDigital.

The classes are from the version 2026-04-08 of TTO (https://w3id.org/pmd/tto/, CC BY 4.0; M. Schilling et al.,
Advanced Engineering Materials 2024, 2400138). Process, test piece, measurement datum and value specification
are linked as in the ontology's example data of an S355 steel. This example was published in several forms:
with properties of the PMD core ontology, and with properties of OBI and IAO. This module writes all these
forms, so that the queries published with each form find the values.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any

from dic.errors import OutputError, require_kind
from dic.exports.turtle import Statements, local_name, number, quoted
from dic.files.writing import write_text
from dic.properties.properties import Properties, offset_key
from dic.properties.value import PropertyValue
from dic.typing import PathLike

PREFIXES = {
    "tto": "https://w3id.org/pmd/tto/",
    "pmdco": "https://w3id.org/pmd/co/",
    "obo": "http://purl.obolibrary.org/obo/",
    "unit": "http://qudt.org/vocab/unit/",
    "qudt": "http://qudt.org/schema/qudt/",
    "dc": "http://purl.org/dc/elements/1.1/",
    "time": "http://www.w3.org/2006/time#",
    "owl": "http://www.w3.org/2002/07/owl#",
    "rdfs": "http://www.w3.org/2000/01/rdf-schema#",
    "xsd": "http://www.w3.org/2001/XMLSchema#",
}
CLASSES: Mapping[str, tuple[str, tuple[str, ...]]] = {
    # The query of the ontology's example asks for an elastic modulus; TTO's class below it says how it was
    # found.
    "E_gpa": ("modulusOfElasticity_E", ("pmdco:PMD_0000618", "tto:TTO_0000050")),
    "Rp02_mpa": ("proofStrength_Rp02", ("tto:TTO_0000047",)),
    "ReH_mpa": ("upperYieldStrength_ReH", ("tto:TTO_0000059",)),
    "ReL_mpa": ("lowerYieldStrength_ReL", ("tto:TTO_0000022",)),
    "Ae_percent": ("percentageYieldPointExtension_Ae", ("tto:TTO_0000041",)),
    "Rm_mpa": ("tensileStrength_Rm", ("tto:TTO_0000053",)),
    "Ag_percent": ("percentagePlasticExtensionAtMaximumForce_Ag", ("tto:TTO_0000037",)),
    "Agt_percent": ("percentageTotalExtensionAtMaximumForce_Agt", ("tto:TTO_0000040",)),
    "A_percent": ("percentageElongationAfterFracture_A", ("tto:TTO_0000033",)),
}
"""The name in IRIs and the classes of each property that the ontology has, keyed by property."""
_RP01, _ANY_RP = "tto:TTO_0000046", "tto:TTO_0000044"
_UNITS = {"GPa": "GigaPA", "MPa": "MegaPA", "%": "PERCENT", "mm²": "MilliM2", "mm": "MilliM"}
_IRI = re.compile(r"(https?|urn):[^\s<>\"{}|\\^`]+")


@dataclass(frozen=True)
class AboutTest:
    """The data of a test other than its properties, which the file also contains.

    Attributes
    ----------
    name : str
        Name of the test, from which the IRIs are formed. It must be unique among the tests at one IRI.
    facts : mapping of str to mapping
        Facts in the tables "laboratory" (name, operator, date), "specimen" (name, material) and "machine"
        (model, load_cell).
    extensometer : str
        Name of the extensometer, such as "offaxis, gauge axial, corrected strain"; "" if it is not known.
    gauge_length_mm : float or None
    iri : str
        Beginning of the IRIs (identifiers) of this test's individuals, such as "https://lab.example/tests/".
        "" for IRIs relative to the path of the file.
    """

    name: str
    facts: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    extensometer: str = ""
    gauge_length_mm: float | None = None
    iri: str = ""

    def __post_init__(self) -> None:
        if self.iri and not _IRI.fullmatch(self.iri):
            expected, remedy = "an IRI without spaces", 'give for example "https://lab.example/tests/"'
            raise OutputError("settings", "IRI of the test", expected, self.iri, remedy)
        _day(self)

    def fact(self, table: str, key: str) -> str:
        """Return a fact as text; "" if it is not stated."""
        return str(self.facts.get(table, {}).get(key, ""))


def _day(about: AboutTest) -> str:
    """Return the day of the test as YYYY-MM-DD; "" if no date is stated.

    Raises `OutputError` if the stated date is no date of ISO 8601.
    """
    stated = about.fact("laboratory", "date")
    try:
        return datetime.fromisoformat(stated).date().isoformat() if stated else ""
    except ValueError as error:
        expected, remedy = "a date of ISO 8601", 'write date = "2026-03-02"'
        raise OutputError("stated facts", "[laboratory] date", expected, repr(stated), remedy) from error


def write_tensile_ontology(properties: Properties, path: PathLike, about: AboutTest) -> list[str]:
    """Write the properties of a tensile test as a Turtle file, in terms of the Tensile Test Ontology.

    Each property has its unit, its standard deviation (QUDT's standardUncertainty), its 95 % interval
    (classes of STATO), and comments with its rule and its flags.

    Parameters
    ----------
    properties : Properties
        From `material_properties`.
    path : path
    about : AboutTest

    Returns
    -------
    list of str
        Keys of the properties that have a value but no class in the ontology, and are therefore not written.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    require_kind("properties", properties, Properties, "compute them with dic.material_properties")
    require_kind("about", about, AboutTest, 'give dic.exports.AboutTest(name="specimen 7")')
    classes = {**CLASSES, **_offsets(properties)}
    test = _Test(about)
    for key, value in properties.values.items():
        if key in classes and value.value is not None:
            test.add_value(*classes[key], value)
    area, std = properties.settings.area_mm2, properties.settings.area_std_mm2
    rule = "area of the cross-section before the test, as given"
    given = PropertyValue(area, std, "mm²", rule)
    test.add_value("originalCrossSectionArea_S0", ("tto:TTO_0000026",), given, test.piece)
    if about.gauge_length_mm is not None:
        length = PropertyValue(about.gauge_length_mm, None, "mm", "gauge length in the reference image")
        test.add_value("extensometerGaugeLength_Le", ("tto:TTO_0000017",), length, test.piece)
    write_text(path, test.statements.text())
    return [key for key, value in properties.values.items() if key not in classes and value.value is not None]


def _offsets(properties: Properties) -> dict[str, tuple[str, tuple[str, ...]]]:
    """Return name and classes of each offset yield strength other than Rp0.2, keyed by property."""
    found: dict[str, tuple[str, tuple[str, ...]]] = {}
    for offset in properties.settings.offsets_percent:
        key = offset_key(offset)
        if key not in CLASSES:
            name = f"proofStrength_{key.removesuffix('_mpa')}"
            found[key] = (name, (_RP01 if offset == 0.1 else _ANY_RP,))
    return found


class _Test:
    """The statements about one test; the names of individuals follow the ontology's example data."""

    def __init__(self, about: AboutTest) -> None:
        self.statements = Statements({"": about.iri or "#"} | PREFIXES)
        self._name = f":{local_name(about.name)}"
        self.process, self.piece = self._of("process"), self._of("testpiece")
        self._material, self._result = self._of("testpiece_material"), self._of("result")
        self._begin(about)
        self._add_test_piece(about)
        self._add_devices(about)
        self._add_laboratory(about)

    def _of(self, part: str) -> str:
        return f"{self._name}_{part}"

    def _begin(self, about: AboutTest) -> None:
        add = self.statements.add
        add("<>", "a", "owl:Ontology")
        add("<>", "dc:title", quoted(f"Tensile test {about.name}"))
        add("<>", "owl:imports", "tto:")
        add(self.process, "a", "pmdco:PMD_0000974")
        add(self.process, "rdfs:label", quoted(about.name))
        self._identify(self._of("process_identifier"), self.process, about.name, "Process identifier")
        add(self._result, "a", "tto:TTO_0000008")
        add(self.process, "obo:OBI_0000299", self._result)

    def _add_test_piece(self, about: AboutTest) -> None:
        add, role = self.statements.add, self._of("testpiece_role")
        add(self.piece, "a", "obo:BFO_0000030")
        add(self.piece, "obo:BFO_0000196", role)
        add(role, "a", "pmdco:PMD_0000975")
        add(self.process, "obo:OBI_0000293", self.piece)
        add(self.piece, "obo:BFO_0000051", self._material)
        add(self._material, "a", "obo:BFO_0000040")
        if name := about.fact("specimen", "name"):
            self._identify(f"{self.piece}_identifier", self.piece, name, "Test piece identifier")
        if material := about.fact("specimen", "material"):
            identifier = f"{self._material}_identifier"
            self._identify(identifier, self._material, material, "material identifier")

    def _add_devices(self, about: AboutTest) -> None:
        """Add machine, load cell and extensometer, each with its function, if their names are known."""
        for part, kind, function, name in (
            ("tensile_testing_machine", "0000973", "0000976", about.fact("machine", "model")),
            ("load_cell", "0000820", "0000644", about.fact("machine", "load_cell")),
            ("extensometer", "0000636", "0000610", about.extensometer),
        ):
            if not name:
                continue
            add, device = self.statements.add, self._of(part)
            add(device, "a", f"pmdco:PMD_{kind}")
            add(device, "obo:BFO_0000196", f"{device}_function")
            add(f"{device}_function", "a", f"pmdco:PMD_{function}")
            add(f"{device}_function", "obo:BFO_0000054", self.process)
            add(self.process, "obo:RO_0000057", device)
            self._identify(f"{device}_name", device, name, f"{part} name")

    def _add_laboratory(self, about: AboutTest) -> None:
        add = self.statements.add
        if name := about.fact("laboratory", "name"):
            place = self._of("institution")
            add(place, "a", "pmdco:PMD_0000879")
            add(self.process, "obo:RO_0000057", place)
            self._identify(f"{place}_name", place, name, "institution name")
        if operator := about.fact("laboratory", "operator"):
            add(self._of("operator"), "a", "pmdco:PMD_0000881")
            add(self._of("operator"), "rdfs:label", quoted(operator))
            add(self.process, "obo:RO_0000057", self._of("operator"))
        if date := _day(about):
            add(self._of("date"), "a", "time:Instant")
            add(self._of("date"), "time:inXSDDate", f'"{date}"^^xsd:date')
            add(self.process, "obo:BFO_0000108", self._of("date"))

    def add_value(
        self, name: str, classes: tuple[str, ...], value: PropertyValue, bearer: str | None = None
    ) -> None:
        """Add a measured value with its uncertainty, as a quality of `bearer` (default: the material)."""
        if value.value is None:
            raise ValueError(f"{name} has no value")
        add, quality = self.statements.add, self._of(f"{name}_quality")
        datum, specification = self._of(f"{name}_smd"), self._of(f"{name}_svs")
        add(quality, "a", *classes)
        add(bearer or self._material, "obo:RO_0000086", quality)
        add(quality, "obo:IAO_0000417", datum)
        add(datum, "a", "pmdco:PMD_0000023", "obo:IAO_0000109")
        for predicate in ("pmdco:PMD_0060000", "obo:OBI_0001938"):
            add(datum, predicate, specification)
        add(datum, "obo:IAO_0000136", quality)
        add(datum, "rdfs:comment", *(quoted(text) for text in (value.rule, *value.flags)))
        add(self.process, "obo:OBI_0000299", datum)
        add(self.process, "pmdco:PMD_0000016", quality)
        add(self._result, "obo:BFO_0000051", datum)
        for predicate in ("pmdco:PMD_0060001", "obo:OBI_0001927", "obo:IAO_0000136"):
            add(specification, predicate, quality)
        self._specify(specification, value.value, value.unit, "pmdco:PMD_0000022")
        if value.std is not None:
            add(specification, "qudt:standardUncertainty", number(value.std))
            self._add_interval(name, quality, value)

    def _add_interval(self, name: str, quality: str, value: PropertyValue) -> None:
        """Add the 95 % interval of a value: a confidence interval with two limits and a level."""
        add, interval = self.statements.add, self._of(f"{name}_interval")
        add(interval, "a", "obo:STATO_0000196")
        add(interval, "obo:IAO_0000136", quality)
        limits = (
            ("lower", "0000315", value.low),
            ("upper", "0000314", value.high),
            ("level", "0000561", 95.0),
        )
        for part, kind, limit in limits:
            if limit is not None:
                datum = f"{interval}_{part}"
                add(interval, "obo:BFO_0000051", datum)
                add(datum, "a", f"obo:STATO_{kind}")
                add(datum, "obo:OBI_0001938", f"{datum}_svs")
                self._specify(f"{datum}_svs", limit, "%" if part == "level" else value.unit)

    def _specify(self, specification: str, value: float, unit: str, *classes: str) -> None:
        """Add a number with its unit, as a scalar value specification."""
        add, named = self.statements.add, f"unit:{_UNITS[unit]}"
        add(specification, "a", *classes, "obo:OBI_0001931")
        add(specification, "pmdco:PMD_0000006", number(value))
        for predicate in ("pmdco:PMD_0000020", "obo:IAO_0000039"):
            add(specification, predicate, named)
        add(named, "a", "obo:IAO_0000003")

    def _identify(self, identifier: str, thing: str, text: str, label: str) -> None:
        """Add a name of a thing, as an identifier with a value specification."""
        add, value = self.statements.add, f"{identifier}_value"
        add(identifier, "a", "pmdco:PMD_0000017")
        add(identifier, "rdfs:label", quoted(label))
        add(identifier, "obo:IAO_0000219", thing)
        for predicate in ("pmdco:PMD_0060000", "obo:OBI_0001938"):
            add(identifier, predicate, value)
        add(value, "a", "obo:OBI_0001933")
        add(value, "pmdco:PMD_0000006", quoted(text))
