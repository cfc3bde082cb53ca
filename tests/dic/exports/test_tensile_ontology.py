"""Statements after the Tensile Test Ontology, read and queried by rdflib.

The queries have the patterns of those that the ontology's repository (materialdigital/tensile-test-ontology,
CC BY 4.0) publishes beside its example data of an S355 steel: `show_Rp02_Rm_E_per_process.sparql` in its
versions of 2025 and of April 2026, and the checks of its mapping notebook.
"""

import re
from dataclasses import fields, replace
from urllib.parse import unquote

import numpy as np
import pytest
import rdflib

import dic
from dic.derived.ontology_facts import about_curve, about_series
from dic.exports import tensile_ontology
from dic.exports.turtle import quoted
from dic.gauges.series import GaugeImage, GaugeSeries
from dic.properties.curve import Curve
from dic.runfile.reader import RunInfo
from tests.command_line import refusal, run_dic

PROCESS = rdflib.URIRef("https://w3id.org/pmd/co/PMD_0000974")
E_GPA, YIELD_MPA, AREA_MM2 = 70.0, 280.0, 20.0
PREFIXES = """
PREFIX pmdco: <https://w3id.org/pmd/co/>
PREFIX tto: <https://w3id.org/pmd/tto/>
PREFIX obo: <http://purl.obolibrary.org/obo/>
PREFIX rdfs: <http://www.w3.org/2000/01/rdf-schema#>
PREFIX qudt: <http://qudt.org/schema/qudt/>
"""
LABELS = {
    "pmdco": {
        "PMD_0000974": "tensile testing process", "PMD_0000975": "test piece role",
        "PMD_0000017": "identifier", "PMD_0000006": "has value", "PMD_0000016": "process to quality (2025)",
        "PMD_0000020": "has unit (April 2026)", "PMD_0000022": "scalar value specification (April 2026)",
        "PMD_0000023": "scalar measurement datum (April 2026)",
        "PMD_0060000": "has value specification (April 2026)",
        "PMD_0060001": "specifies value of (April 2026)",
        "PMD_0000618": "elastic modulus", "PMD_0000973": "tensile testing machine",
        "PMD_0000976": "its function", "PMD_0000820": "load cell", "PMD_0000644": "its function",
        "PMD_0000636": "extensometer", "PMD_0000610": "its function", "PMD_0000879": "organisation",
        "PMD_0000881": "operator",
    },
    "tto": {
        "TTO_0000008": "tensile test result", "TTO_0000050": "slope of the elastic part",
        "TTO_0000047": "proof strength plastic extension rp02",
        "TTO_0000046": "proof strength plastic extension rp01",
        "TTO_0000044": "proof strength plastic extension",
        "TTO_0000059": "upper yield strength", "TTO_0000022": "lower yield strength",
        "TTO_0000041": "percentage yield point extension", "TTO_0000053": "tensile strength",
        "TTO_0000037": "percentage plastic extension at maximum force",
        "TTO_0000040": "percentage total extension at maximum force",
        "TTO_0000033": "percentage elongation after fracture",
        "TTO_0000026": "original cross-sectional area of the parallel length",
        "TTO_0000017": "extensometer gauge length",
    },
    "obo": {
        "BFO_0000030": "object", "BFO_0000040": "material entity", "BFO_0000051": "has part",
        "BFO_0000054": "has realization", "BFO_0000108": "exists at", "BFO_0000196": "bearer of",
        "IAO_0000003": "measurement unit label", "IAO_0000039": "has measurement unit label",
        "IAO_0000109": "measurement datum", "IAO_0000136": "is about", "IAO_0000219": "denotes",
        "IAO_0000417": "is quality measured as", "OBI_0000293": "has specified input",
        "OBI_0000299": "has specified output", "OBI_0001927": "specifies value of",
        "OBI_0001931": "scalar value specification", "OBI_0001933": "value specification",
        "OBI_0001938": "has value specification", "RO_0000057": "has participant",
        "RO_0000086": "has quality",
        "STATO_0000196": "confidence interval", "STATO_0000314": "upper confidence limit",
        "STATO_0000315": "lower confidence limit", "STATO_0000561": "confidence level",
    },
    "unit": {name: name for name in ("GigaPA", "MegaPA", "PERCENT", "MilliM2", "MilliM")},
    "qudt": {"standardUncertainty": "standard uncertainty"},
    "dc": {"title": "title"},
    "time": {"Instant": "instant", "inXSDDate": "in XSD date"},
}  # fmt: skip
"""All terms of others that the file may use. The labels of TTO, BFO, IAO, OBI, RO and STATO are the published
ones; those of the core ontology (`pmdco`) say what the example data use the term for."""


def curve():
    """A specimen that is elastic up to 280 MPa and then hardens linearly up to 14 % and breaks."""
    strain = np.concatenate([np.linspace(0.0, 0.004, 200), np.linspace(0.0045, 0.14, 300)])
    stress = np.where(strain <= 0.004, 1e3 * E_GPA * strain, YIELD_MPA + 500.0 * (strain - 0.004))
    rng = np.random.default_rng(4)
    loads = AREA_MM2 * stress + rng.normal(0.0, 2.0, len(stress))
    return Curve("curve.csv", np.append(loads, 10.0), np.append(strain, 0.1401), None, None)


@pytest.fixture(scope="module")
def found():
    settings = dic.properties.PropertySettings(
        area_mm2=AREA_MM2, area_std_mm2=0.05, load_std_percent=0.3, offsets_percent=(0.2, 0.1, 0.5)
    )
    return dic.material_properties(curve(), settings)


@pytest.fixture
def written(found, tmp_path):
    """Return a function that writes the properties, and reads them as a graph."""

    def write(**about):
        path = tmp_path / "test.ttl"
        dic.exports.write_tensile_ontology(found, path, dic.exports.AboutTest(**({"name": "Zx 7"} | about)))
        return rdflib.Graph().parse(path, format="turtle")

    return write


def by_datum(form):
    """The query for process identifier, Rp0.2, Rm and E by the classes of the qualities."""
    specified, unit = form
    parts = [
        f"""OPTIONAL {{ ?process obo:OBI_0000299 ?{name}_datum .
        ?{name}_datum {specified} ?{name}_value ; obo:IAO_0000136 ?{name}_quality .
        ?{name}_quality a {kind} .
        ?{name}_value pmdco:PMD_0000006 ?{name} ; {unit} ?{name}_unit }}"""
        for name, kind in (("Rp02", "tto:TTO_0000047"), ("Rm", "tto:TTO_0000053"), ("E", "pmdco:PMD_0000618"))
    ]
    return (
        PREFIXES
        + f"""SELECT ?id ?Rp02 ?Rp02_unit ?Rm ?Rm_unit ?E ?E_unit WHERE {{
        ?process a pmdco:PMD_0000974 .
        ?name a pmdco:PMD_0000017 ; obo:IAO_0000219 ?process ; rdfs:label "Process identifier" ;
            {specified} ?name_value .
        ?name_value pmdco:PMD_0000006 ?id .
        {" ".join(parts)} }}"""
    )


BY_NAME = (
    PREFIXES
    + """SELECT ?value ?unit WHERE {
    ?experiment rdfs:label "Process identifier" ; obo:IAO_0000219 ?process .
    ?process pmdco:PMD_0000016 ?quality . ?quality obo:IAO_0000417 ?datum .
    ?datum pmdco:PMD_0060000 ?specified . ?specified pmdco:PMD_0000006 ?value ; pmdco:PMD_0000020 ?unit .
    FILTER(CONTAINS(STR(?quality), "NAME")) }"""
)
FORMS = {
    "the core ontology": ("pmdco:PMD_0060000", "pmdco:PMD_0000020"),
    "OBI and IAO": ("obo:OBI_0001938", "obo:IAO_0000039"),
}


@pytest.mark.parametrize("form", FORMS.values(), ids=FORMS)
def test_the_ontologys_query_returns_rp02_rm_and_e(written, found, form):
    (row,) = written().query(by_datum(form))
    values = [float(row[name]) for name in ("Rp02", "Rm", "E")]
    assert str(row["id"]) == "Zx 7"
    assert values == [found.values[key].value for key in ("Rp02_mpa", "Rm_mpa", "E_gpa")]
    # E 70 GPa; on the hardening line, Rp0.2 is where strain is 0.2 % more than stress over E
    hardening = 500.0
    rp02 = (YIELD_MPA - hardening * 0.004 + hardening * 0.002) / (1.0 - hardening / (1e3 * E_GPA))
    assert values == pytest.approx([rp02, YIELD_MPA + 500.0 * 0.136, E_GPA], rel=0.003)
    units = [str(row[f"{name}_unit"]).rpartition("/")[2] for name in ("Rp02", "Rm", "E")]
    assert units == ["MegaPA", "MegaPA", "GigaPA"]


@pytest.mark.parametrize(
    ("name", "key"),
    [
        ("proofStrength_Rp02", "Rp02_mpa"),
        ("tensileStrength_Rm", "Rm_mpa"),
        ("modulusOfElasticity_E", "E_gpa"),
    ],
)
def test_the_first_query_of_the_ontology_finds_values_by_the_names_of_the_qualities(
    written, found, name, key
):
    (row,) = written().query(BY_NAME.replace("NAME", name))
    assert float(row["value"]) == found.values[key].value


def test_every_value_has_its_uncertainty_and_its_rule(written, found):
    rows = written().query(
        PREFIXES
        + """SELECT ?kind ?value ?std ?low ?high ?level ?rule WHERE {
        ?datum a obo:IAO_0000109 ; obo:IAO_0000136 ?quality ; obo:OBI_0001938 ?specified .
        ?datum rdfs:comment ?rule .
        ?quality a ?kind .
        ?specified pmdco:PMD_0000006 ?value ; qudt:standardUncertainty ?std .
        ?interval a obo:STATO_0000196 ; obo:IAO_0000136 ?quality ;
            obo:BFO_0000051 ?lower , ?upper , ?confidence .
        ?lower a obo:STATO_0000315 ; obo:OBI_0001938/pmdco:PMD_0000006 ?low .
        ?upper a obo:STATO_0000314 ; obo:OBI_0001938/pmdco:PMD_0000006 ?high .
        ?confidence a obo:STATO_0000561 ; obo:OBI_0001938/pmdco:PMD_0000006 ?level }"""
    )
    kinds = {
        "TTO_0000047": "Rp02_mpa", "TTO_0000046": "Rp01_mpa", "TTO_0000044": "Rp05_mpa",
        "TTO_0000053": "Rm_mpa", "TTO_0000050": "E_gpa", "TTO_0000037": "Ag_percent",
        "TTO_0000040": "Agt_percent", "TTO_0000033": "A_percent",
    }  # fmt: skip
    read = {}
    for row in rows:
        kind = str(row["kind"]).rpartition("/")[2]
        numbers = [float(row[name]) for name in ("value", "std", "low", "high")]
        read.setdefault(kind, set()).add((*numbers, float(row["level"]), str(row["rule"])))
    for kind, key in kinds.items():
        value = found.values[key]
        if value.value is None or value.std is None:
            assert kind not in read
            continue
        texts = {one[5] for one in read[kind]}
        assert texts == {value.rule, *value.flags}
        assert {one[:5] for one in read[kind]} == {(value.value, value.std, value.low, value.high, 95.0)}
    assert {"TTO_0000047", "TTO_0000053", "TTO_0000050", "TTO_0000044"} <= set(read)


def test_what_the_ontology_has_no_class_for_is_named(found, tmp_path):
    left_out = dic.exports.write_tensile_ontology(
        found, tmp_path / "test.ttl", dic.exports.AboutTest(name="7")
    )
    assert left_out == [key for key in ("nu", "r", "n") if found.values[key].value is not None]
    assert "n" in left_out


def test_only_terms_that_the_published_ontologies_have_are_used(written):
    facts = {
        "laboratory": {"name": "Lab", "operator": "N.", "date": "2026-11-23"},
        "specimen": {"name": "Zx7", "material": "S355"},
        "machine": {"model": "M 5", "load_cell": "100 kN"},
    }
    graph = written(facts=facts, extensometer="offaxis", gauge_length_mm=50.0)
    spaces = {prefix: tensile_ontology.PREFIXES[prefix] for prefix in LABELS}
    unknown = set()
    for term in {term for triple in graph for term in triple if isinstance(term, rdflib.URIRef)}:
        for prefix, space in spaces.items():
            if str(term).startswith(space) and str(term) != space:
                unknown |= {str(term)} - {space + name for name in LABELS[prefix]}
    assert unknown == set()
    used = {iri for kinds in tensile_ontology.CLASSES.values() for iri in kinds[1]}
    assert used <= {f"{prefix}:{name}" for prefix, names in LABELS.items() for name in names}


@pytest.mark.parametrize(
    "broken",
    [
        "?datum a obo:IAO_0000109 FILTER NOT EXISTS { ?datum obo:OBI_0001938/pmdco:PMD_0000006 ?value }",
        "?datum a obo:IAO_0000109 ; obo:OBI_0001938 ?one , ?two FILTER(?one != ?two)",
        "?one obo:OBI_0001927 ?quality FILTER NOT EXISTS { ?quality obo:IAO_0000417 ?datum }",
        "?p a pmdco:PMD_0000974 FILTER NOT EXISTS { ?p obo:OBI_0000299 ?result . ?result a tto:TTO_0000008 }",
        "?result a tto:TTO_0000008 FILTER NOT EXISTS { ?result obo:BFO_0000051/a pmdco:PMD_0000023 }",
        "?p obo:RO_0000057 ?device . ?device obo:BFO_0000196 ?f FILTER NOT EXISTS { ?f obo:BFO_0000054 ?p }",
    ],
)
def test_the_checks_of_the_ontologys_example_hold(written, broken):
    graph = written(extensometer="offaxis", facts={"machine": {"model": "M 5"}})
    assert not list(graph.query(f"{PREFIXES} SELECT * WHERE {{ {broken} }}"))


def test_facts_and_devices_are_named(written):
    facts = {"specimen": {"material": "S355"}, "machine": {"model": "M 5"}, "laboratory": {"name": "Lab"}}
    graph = written(facts=facts, extensometer="offaxis, gauge axial", gauge_length_mm=12.5)
    rows = graph.query(
        PREFIXES + "SELECT ?label ?text WHERE { ?i a pmdco:PMD_0000017 ; rdfs:label ?label ;"
        " obo:OBI_0001938/pmdco:PMD_0000006 ?text }"
    )
    assert {str(row["label"]): str(row["text"]) for row in rows} == {
        "Process identifier": "Zx 7",
        "material identifier": "S355",
        "tensile_testing_machine name": "M 5",
        "extensometer name": "offaxis, gauge axial",
        "institution name": "Lab",
    }
    (length,) = graph.query(
        PREFIXES + "SELECT ?value ?unit WHERE { ?q a tto:TTO_0000017 ; obo:IAO_0000417/obo:OBI_0001938 ?s ."
        " ?s pmdco:PMD_0000006 ?value ; obo:IAO_0000039 ?unit }"
    )
    assert (float(length["value"]), str(length["unit"]).rpartition("/")[2]) == (12.5, "MilliM")


@pytest.mark.parametrize(
    "text", ['"', "\\", 'a\n"b"\r\t\\u0041', "\x00\x1f", "Zürich 試験 😀", "<> . ;", "'''\"\"\""]
)
def test_any_text_survives(written, text):
    graph = written(name=text, facts={"specimen": {"material": text}})
    rows = graph.query(
        PREFIXES + 'SELECT ?text WHERE { ?i rdfs:label "material identifier" ;'
        " obo:OBI_0001938/pmdco:PMD_0000006 ?text }"
    )
    assert [str(row["text"]) for row in rows] == [text]
    assert quoted(text).isprintable() or any(ord(sign) > 127 for sign in text)
    (process,) = graph.subjects(rdflib.RDF.type, PROCESS)
    assert unquote(str(process)).endswith(f"#{text}_process")


def test_different_names_have_different_iris_of_plain_ascii(written):
    names = [
        "Zug-1",
        "Zug 1",
        "Zug_1",
        "Müller",
        "Möller",
        "试样1",
        "1",
        "",
        "_",
        "-1",
        ".1",
        "1.",
        "a~",
        "100%",
    ]
    found = set()
    for name in names:
        (process,) = written(name=name, iri="https://lab.example/t/").subjects(rdflib.RDF.type, PROCESS)
        assert re.fullmatch(r"https://lab\.example/t/([\w.-]|%[0-9A-F]{2})*_process", str(process), re.ASCII)
        assert unquote(str(process)) == f"https://lab.example/t/{name}_process"
        found.add(process)
    assert len(found) == len(names)


def test_the_individuals_begin_with_the_iri_that_is_given(written):
    (process,) = written(iri="https://lab.example/tests/").subjects(rdflib.RDF.type, PROCESS)
    assert str(process) == "https://lab.example/tests/Zx%207_process"
    with pytest.raises(
        dic.errors.OutputError, match="IRI of the test: expected an IRI without spaces, got lab 5"
    ):
        dic.exports.AboutTest(name="a", iri="lab 5")


def test_the_command_writes_the_values_of_its_json(tmp_path):
    one, text = curve(), ["load;strain"]
    text += [f"{load:.9f};{strain:.12f}" for load, strain in zip(one.load_n, one.strain, strict=True)]
    (tmp_path / "Zx7.csv").write_text("\n".join(text))
    (tmp_path / "facts.toml").write_text('[specimen]\nmaterial = "S355"\n')
    words = ("properties", tmp_path / "Zx7.csv", "--load", "load:N", "--strain", "strain:1", "--area-mm2", 20)
    done = run_dic(
        *words, "--ttl", tmp_path / "t.ttl", "--facts", tmp_path / "facts.toml", "--json", tmp_path / "v.json"
    )
    assert done.status == 0, done
    assert done.out.splitlines()[-1] == f"ontology: {tmp_path / 't.ttl'}; the ontology has no class for n"
    graph = rdflib.Graph().parse(tmp_path / "t.ttl")
    (row,) = graph.query(by_datum(FORMS["OBI and IAO"]))
    assert re.fullmatch(r"Zx7\.csv [0-9a-f]{12}", str(row["id"]))
    assert "Test piece identifier" not in {str(text) for text in graph.objects(None, rdflib.RDFS.label)}
    for name, key in (("Rp02", "Rp02_mpa"), ("Rm", "Rm_mpa"), ("E", "E_gpa")):
        assert float(row[name]) == done.report[key]["value"]
    assert "--ttl beside it" in refusal(*words, "--ttl-iri", "https://lab.example/")
    assert "IRI of the test" in refusal(*words, "--ttl", tmp_path / "u.ttl", "--ttl-iri", "lab")
    assert not (tmp_path / "u.ttl").exists()
    # the IRI is refused before the results are read
    said = refusal("report", tmp_path / "none.h5", "--ttl", tmp_path / "u.ttl", "--ttl-iri", "lab")
    assert "IRI of the test: expected an IRI without spaces, got lab" in said


def of_images(*digests, source="results.h5", run=None):
    images = tuple(GaugeImage(f"image {k}", digest=digest) for k, digest in enumerate(digests))
    return GaugeSeries(source, (), images, run=run)


def about(series, **facts):
    return about_series(series, "axial", "raw", {"specimen": facts} if facts else {})


def test_the_name_of_a_test_is_that_of_its_data_and_not_only_of_its_file():
    one, other = of_images("a" * 64, "b" * 64), of_images("a" * 64, "c" * 64)
    assert about(one).name.startswith("results.h5 ")
    assert about(one).name != about(other).name
    assert about(one, name="Zx7").name.startswith("Zx7 ")
    assert about(one, name="Zx7").name != about(other, name="Zx7").name
    # measured again in another folder, without the image that could not be measured
    again = of_images("a" * 64, "", "b" * 64, source="again/results.h5")
    assert about(again).name == about(one).name
    first, second = curve(), replace(curve(), load_n=1.001 * curve().load_n)
    names = [
        about_curve(each, {}, gauge_length_mm=None, iri="").name for each in (first, second, replace(first))
    ]
    assert names[0] == names[2] != names[1]


def test_series_with_other_references_have_other_names():
    one = replace(of_images("a" * 64, "b" * 64), reference_digest="c" * 64)
    assert about(one).name != about(replace(one, reference_digest="d" * 64)).name


def test_a_run_names_its_specimen_and_its_date():
    empty = {each.name: "" for each in fields(RunInfo)}
    run = RunInfo(
        **empty | {"run_id": "20261123T080000Z-1", "sample": "Zx8", "start_time": "2026-11-23T08:00:00+00:00"}
    )
    found = about(of_images("a" * 64, run=run), material="S355")
    assert found.name == about(of_images("b" * 64, run=run)).name
    assert "Zx8" in found.name
    assert "20261123T080000Z-1" in found.name
    stated = [
        found.fact(*key) for key in (("specimen", "name"), ("specimen", "material"), ("laboratory", "date"))
    ]
    assert stated == ["Zx8", "S355", "2026-11-23"]
    assert about(of_images("a" * 64, run=run), name="Zx9").fact("specimen", "name") == "Zx9"
    other = replace(run, run_id="20261123T090000Z-1")
    assert about(of_images("a" * 64, run=other)).name != found.name
