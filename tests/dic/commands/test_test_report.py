"""`dic report` of a tensile test: each number can be followed; facts, fields, noise floor, PDF."""

import hashlib
import json
import re
import sys
import tomllib

import h5py
import numpy as np
import pytest
import rdflib

import dic
from dic.report.camera_images import images_of
from dic.report.state_fields import state_picture
from dic.report.stated_facts import FACTS as FACTS_KNOWN
from dic.report.states import CurvePoint, chosen_states
from tests.command_line import refusal, run_dic
from tests.dic.commands.tension_series import AREA_MM2, AXIAL, E_MPA, GAUGES, WIDTH, stress_mpa
from tests.dic.report.page import Page
from tests.pdf_files import page_texts, require_pango
from tests.places import DOCS

FACTS = """
[specimen]
material = "2024-T3"
thickness_mm = 0.8
[machine]
load_cell_class = "0.5"
[pattern]
technique = "white base coat, black spray"
[cameras]
lens = "telecentric 0.3×"
stand_off_mm = 300
"""
STATIC = ("img001", "img002.png")


@pytest.fixture(scope="session")
def reported(folder, tmp_path_factory):
    """The report of the tension test as HTML and JSON, with facts, gauges, fields and images at rest."""
    place = tmp_path_factory.mktemp("report")
    (place / "facts.toml").write_text(FACTS, encoding="utf-8")
    (place / "gauges.toml").write_text(GAUGES)
    done = run_dic(
        "report", folder / "r.h5", "--gauges", place / "gauges.toml", "--transverse-gauge", "width",
        "--record", folder / "machine.csv", "--load", "Force:kN", "--area-mm2", AREA_MM2,
        "--facts", place / "facts.toml", "--fields-at", "half", "--fields-at", "stress=200",
        "--fields-at", "last", "--static", STATIC[0], "--static", STATIC[1],
        "-o", place / "report.html", "--json", place / "report.json",
        "--ttl", place / "report.ttl", "--ttl-iri", "https://lab.example/",
    )  # fmt: skip
    assert done.status == 0, done
    return place


@pytest.mark.extended
def test_the_ontologys_file_has_the_values_of_the_json(reported):
    (test,) = json.loads((reported / "report.json").read_text())["tests"]
    graph = rdflib.Graph().parse(reported / "report.ttl")
    has_value = rdflib.URIRef("https://w3id.org/pmd/co/PMD_0000006")
    for name, key in (("proofStrength_Rp02", "Rp02_mpa"), ("modulusOfElasticity_E", "E_gpa")):
        (of_value,) = {each for each in graph.subjects() if str(each).endswith(f"_{name}_svs")}
        assert str(of_value).startswith("https://lab.example/r.h5%20")
        value = graph.value(of_value, has_value)
        assert float(value) == test["columns"][-1]["values"][key]["value"]
    named = {str(text) for text in graph.objects(None, has_value)}
    assert "2024-T3" in named
    assert any(text.startswith("r.h5 ") for text in named)
    assert any(text.endswith("gauge axial, raw strain") for text in named)


def test_every_number_can_be_followed_to_its_file_image_and_rule(folder, reported):
    (test,) = json.loads((reported / "report.json").read_text())["tests"]
    inputs = test["provenance"]["inputs"]
    used = (folder / "r.h5", folder / "machine.csv", reported / "gauges.toml", reported / "facts.toml")
    assert inputs == {str(path): digest_of(path) for path in used}
    assert test["joined"]["join"] == "row"
    (column,) = test["columns"]
    curve, values = column["curve"], column["values"]
    read = run_dic(
        "gauges", folder / "r.h5", reported / "gauges.toml", "--json", reported / "gauges.json", "--force"
    )
    images = {image["file"]: image["gauges"] for image in read.report["images"]}
    for k, row in enumerate(curve, 1):
        assert row["sha256"] == digest_of(row["image"])
        assert row["image"].endswith(f"img{k:03d}.png")
        assert row["load_n"] == pytest.approx(AREA_MM2 * stress_mpa(0.012 * k / len(curve)), abs=1e-3)
        for key, gauge in (("strain", "axial"), ("transverse_strain", "width")):
            assert row[key] == images[row["image"]][gauge]["raw"]["strain"]
    strain, load, across = (
        np.array([row[key] for row in curve]) for key in ("strain", "load_n", "transverse_strain")
    )
    stress = load / test["S0_mm2"]
    part = slice(values["E_gpa"]["window"]["first_point"], values["E_gpa"]["window"]["last_point"] + 1)
    slope, intercept = np.polyfit(strain[part], stress[part], 1)
    assert values["E_gpa"]["value"] == pytest.approx(slope / 1e3, rel=1e-9)
    ratio = np.polyfit(load[part], across[part], 1)[0] / np.polyfit(load[part], strain[part], 1)[0]
    assert values["nu"]["value"] == pytest.approx(-ratio, rel=1e-9)
    assert values["Rm_mpa"]["value"] == pytest.approx(stress[values["Rm_mpa"]["window"]["point"]])
    assert values["Rm_mpa"]["value"] == pytest.approx(stress.max())
    offset, foot = values["Rp02_mpa"], -intercept / slope
    at = offset["window"]["strain_percent"] / 100.0
    assert offset["value"] == pytest.approx(slope * (at - 0.002), rel=1e-9)  # on the shifted elastic line
    beside = int(np.searchsorted(strain - foot, at))
    assert stress[beside - 1] <= offset["value"] <= stress[beside]
    for name, value in values.items():
        assert value["symbol"], name
        assert value["rule"], name
        if value["value"] is None:
            assert any(flag.startswith("missing: ") for flag in value["flags"]), name
        else:
            assert value["high"] - value["low"] == pytest.approx(2 * 1.959964 * value["std"]), name
    assert {name for name, value in values.items() if value["value"] is None} >= {"ReH_mpa", "r", "n"}


def test_every_entry_of_the_tables_can_be_followed_to_its_file_step_and_rule(folder, reported):
    (test,) = json.loads((reported / "report.json").read_text())["tests"]
    tables = test["tables"]
    files = tables.pop("files")
    assert files == {str(path): digest_of(path) for path in (folder / "r.h5", reported / "facts.toml")}
    for name in ("laboratory", "specimen", "machine", "hardware", "analysis"):
        for entry in tables[name]:
            known = entry["text"] is not None
            assert known == (entry["file"] in files) == (entry["step"] is not None), entry
            assert entry["rule"], entry
    shown = {(table, entry["name"]): entry for table, entries in tables.items() for entry in entries}
    material = shown["specimen", "Material"]
    stated = tomllib.loads((reported / "facts.toml").read_text(encoding="utf-8"))
    key = material["rule"].removeprefix("stated as ")
    assert material["text"] == stated[material["step"].strip("[]")][key]
    assert shown["hardware", "Lens"]["step"] == "[cameras]"
    assert shown["hardware", "Aperture"] == {
        "name": "Aperture", "camera": None, "text": None, "file": None, "step": None, "rule": "not stated"
    }  # fmt: skip
    with h5py.File(folder / "r.h5") as file:
        series = file["series"]
        labels = list(series["label"].asstr()[:])
        for row, unit in (("Subset size", " px"), ("Step size", " px"), ("Subset shape function", "")):
            entry = shown["analysis", row]
            assert entry["text"] == f"{series.attrs[entry['rule']]}{unit}"
            assert entry["step"] == f"series of {labels[0]}"
        for component in ("exx", "eyy", "exy"):
            noise = shown["noise_floor", f"local ε{component[1:]}, raw"]
            place, rest = labels.index(noise["step"]), [labels.index(one) for one in noise["images_at_rest"]]
            maps = [1e6 * series[component][k] for k in rest]
            spread = np.sqrt(np.mean([np.nanvar(each, ddof=1) for each in maps]))
            assert noise["measured"] == pytest.approx(spread, rel=1e-6)
            assert noise["bias"] == pytest.approx(np.mean([np.nanmean(each) for each in maps]), rel=1e-6)
            predicted = 1e6 * np.nanmedian(series[f"{component}_std"][place])
            # Only a strain that was read with its parts has the part of the images apart.
            assert noise["predicted"] == pytest.approx(predicted, rel=1e-6)


def digest_of(path):
    with open(path, "rb") as file:  # noqa: PTH123
        return hashlib.file_digest(file, "sha256").hexdigest()


def test_page_states_facts_and_says_what_nobody_stated(reported):
    html = (reported / "report.html").read_text(encoding="utf-8")
    rows = dict(cells for table in Page(html).all_tables("settings") for cells in table if len(cells) == 2)
    assert (rows["Material"], rows["Thickness"]) == ("2024-T3", "0.8 mm")
    assert rows["Class of the load cell (ISO 7500-1)"] == "0.5"
    assert {rows[name] for name in ("Condition", "Operator", "Grips")} == {"not stated"}
    assert rows["Load from the machine's record"] == "joined by row"
    facts = dict(cells for table in Page(html).all_tables("settings facts") for cells in table)
    assert facts["Lens"] == "telecentric 0.3×"
    assert facts["Stand-off distance"] == "300 mm"
    assert {facts[name] for name in ("Aperture", "Field of view", "Exposure time")} == {"not stated"}
    assert facts["Image resolution"] == "180 px × 160 px"
    assert facts["Subset size"] == "21 px"
    assert facts["Virtual strain gauge size"] == "35 px"  # 2 steps of 7 px, and a subset
    assert facts["Interpolant"] == "B-spline of order 5"
    captions = " ".join(" ".join(Page(html).captions).split())
    for words in ("half of the strain at the largest stress:", "stress 200 MPa:", "last image:"):
        assert re.search(re.escape(words) + r" \S*img0\d\d\.png, [\d.]+ MPa, [\d.]+ %", captions), words


def test_noise_floor_is_the_scatter_and_the_mean_in_the_images_at_rest(folder, reported):
    (table,) = Page((reported / "report.html").read_text(encoding="utf-8")).all_tables("noise")
    rows = {row[0]: [float(cell.replace("−", "-")) for cell in row[2:]] for row in table[1:]}
    with h5py.File(folder / "r.h5") as file:
        known = {
            f"local ε{name[1:]}, raw": 1e6 * file[f"series/{name}"][:2] for name in ("exx", "eyy", "exy")
        }
    for name, images in known.items():
        spread = np.sqrt(np.mean([np.nanvar(image, ddof=1) for image in images]))
        mean = np.mean([np.nanmean(image) for image in images])
        assert rows[name][1:] == pytest.approx([spread, mean], abs=0.051), name
        # 0.06 % of strain in the first image; the noise of the images makes nearly all of the scatter
        assert 0.5 < rows[name][0] / spread < 2.0, name
    html = (reported / "report.html").read_text(encoding="utf-8")
    assert "img001.png may not be at rest" in html  # 0.06 % of strain
    axial = 1e6 * 0.012 / 20 * np.array([1.0, 2.0])
    gauge = rows["strain of gauge “axial”, raw"]
    assert gauge[2] == pytest.approx(axial.mean(), abs=5 * gauge[0])
    assert gauge[1] == pytest.approx(axial.std(ddof=1), abs=5 * gauge[0])


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        (
            "facts",
            '[specimen]\nmass_g = 3\nwidth_mm = "wide"\n[cameras.side]\nlense = "f"\n[rig]\na = 1',
            ("'mass_g'", "width_mm: expected a number, got 'wide'", "'lense'", "'rig'"),
        ),
        (
            "facts",
            "[specimen]\nwidth_mm = -5\n[machine]\ntemperature_c = -400\n[cameras]\nexposure_ms = 0",
            (
                "width_mm: expected a number above 0, got -5",
                "temperature_c: expected a number above -273.15, got -400",
                "exposure_ms: expected a number above 0, got 0",
            ),
        ),
        (
            "facts",
            '[laboratory]\ndate = "2 March 2026"',
            ('[laboratory]: date: expected a date such as "2026-03-02"', "got '2 March 2026'"),
        ),
        ("facts", "[specimen", ("read the stated facts: expected a TOML file, got one that cannot",)),
        (
            "facts",
            '[cameras.on_axis]\nlens = "macro"',
            ("[cameras], for results without named cameras, got [cameras.on_axis]",),
        ),
        ("static", "img099", ("--static: expected the name of one measured image, got no image named",)),
    ],
)
def test_details_that_do_not_fit_are_one_sentence(folder, tmp_path, name, text, words):
    if name == "facts":
        (tmp_path / "facts.toml").write_text(text)
        text = tmp_path / "facts.toml"
    record = "--record", folder / "machine.csv", "--load", "Force:kN", "--area-mm2", AREA_MM2
    page = tmp_path / "report.html"
    said = refusal("report", folder / "r.h5", *record, "--declare", AXIAL, f"--{name}", text, "-o", page)
    assert all(each in said for each in words)  # all mistakes together
    assert not page.exists()


def test_example_of_facts_in_the_documentation_states_every_fact(tmp_path):
    page = (DOCS / "report.md").read_text("utf-8")
    (example,) = re.findall(r"```toml\n(\[laboratory\].*?)```", page, re.DOTALL)
    (tmp_path / "facts.toml").write_text(example, encoding="utf-8")
    facts = dic.report.read_stated_facts(tmp_path / "facts.toml")
    assert {name: set(table) for name, table in facts.tables.items()} == {
        name: set(known) for name, known in FACTS_KNOWN.items()
    }
    assert facts.given("specimen", "parallel_length_mm") == "75 mm"


@pytest.fixture(scope="module")
def column(folder):
    """The column of the tension test's raw strain."""
    record = dic.records.read_machine_record(folder / "machine.csv", load="Force:kN")
    series = dic.measure_gauges(folder / "r.h5", dic.read_gauges(texts=[AXIAL]))
    series, _ = dic.derived.join_record(series, record, "row")
    return dic.tensile_test(series, "axial", None, dic.properties.PropertySettings(area_mm2=AREA_MM2)).main


def test_points_of_the_curve_are_those_that_were_asked_for(column):
    wanted = ["stress=200", "last", "half", "strain=0.3", "image=img007", "image=img008.png"]
    states = chosen_states(column, wanted)
    images = [int(re.search(r"img(\d+)", state.label)[1]) for state in states]
    # image k has a strain of k · 0.06 %; 200 MPa at 70 GPa is 0.286 %, and half of 1.2 % is image 10
    assert images == [5, 7, 8, 10, 20]
    assert states[0].words == "stress 200 MPa, strain 0.3 %"
    for state, k in zip(states, images, strict=True):
        assert state.stress_mpa == pytest.approx(stress_mpa(0.0006 * k), rel=1e-5)
        assert state.strain == pytest.approx(0.0006 * k, abs=1e-4)
    # the yield strength of 420 MPa is passed at 0.6 %, and 0.2 % of plastic strain at 0.8 %: image 13 or 14
    default = {state.words: state.label for state in chosen_states(column)}
    assert list(default) == ["half of the strain at the largest stress", "Rp0,2", "Rm"]
    assert re.search(r"img01[34]", default["Rp0,2"])


@pytest.mark.parametrize(
    ("wanted", "words"),
    [
        ("Rp05", "fields at: expected one of half, Rp02, ReH"),
        ("ReH", "expected a curve with ReH, got missing: "),
        ("strain=7", "a strain between"),
        ("stress=", "got none; give stress="),
        ("load=7", "expected one of half"),
        ("image=other.png", "one image of the curve, got 0 of the name 'other.png'"),
    ],
)
def test_points_that_the_curve_does_not_have_are_refused(column, wanted, words):
    with pytest.raises(dic.errors.CurveError, match=re.escape(words)):
        chosen_states(column, [wanted])


def test_deformed_images_that_are_gone_or_changed_are_not_shown(folder, tmp_path):
    (tmp_path / "r.h5").write_bytes((folder / "r.h5").read_bytes())
    with h5py.File(tmp_path / "r.h5", "r+") as file:
        names = file["series/images/label"].asstr()[:]
        images = {name: tmp_path / f"moved{k}.png" for k, name in enumerate(names)}
        for group in ("series/images/label", "series/label"):
            file[group][:] = [str(images[name]) for name in file[group].asstr()[:]]
    last = names[-1]
    images[last].write_bytes((folder / "images" / "img003.png").read_bytes())
    (images,) = images_of(dic.load_series_result(tmp_path / "r.h5"))
    states = [CurvePoint("Rm", images.labels[k], 400.0, 0.012) for k in (3, -1)]
    picture = state_picture(images, states, "eyy")
    assert picture.kind == "εyy raw"
    gone, other = picture.missing
    assert "moved3.png: draw the deformed image: expected the image file, got No such file" in gone
    assert "expected the image that was measured, got another image" in other


@pytest.mark.extended
def test_pdf_has_every_table_whole_on_a_page(folder, tmp_path):
    require_pango()
    pdfium = pytest.importorskip("pypdfium2")
    (tmp_path / "facts.toml").write_text(FACTS, encoding="utf-8")
    done = run_dic(
        "report", folder / "r.h5", "--declare", AXIAL, "--declare", WIDTH, "--transverse-gauge", "width",
        "--record", folder / "machine.csv", "--load", "Force:kN", "--area-mm2", AREA_MM2,
        "--facts", tmp_path / "facts.toml", "-o", tmp_path / "r.html", "--pdf", tmp_path / "report.pdf",
    )  # fmt: skip
    assert done.status == 0, done
    document = pdfium.PdfDocument(tmp_path / "report.pdf")
    pages = page_texts(tmp_path / "report.pdf")
    assert len(pages) >= 3
    margins = [page.get_textpage().get_text_bounded(bottom=page.get_height() - 45) for page in document]
    assert all("Strain in" in margin for margin in margins[1:])  # the title stands at the top of each page
    for number, page in enumerate(document, 1):
        for drawn in page.get_objects(filter=[pdfium.raw.FPDF_PAGEOBJ_IMAGE]):
            left, _, right, _ = drawn.get_bounds()
            assert (right - left) / 72 * 25.4 > 60, number
    for first, last in (
        ("Camera not stated", "Pattern feature size"),
        ("Image filtering", "Calibration none"),
        ("displacement u px", "strain of gauge “width”"),
    ):
        assert sum(first in page and last in page for page in pages) == 1, first
    assert all(f"{number} / {len(pages)}" in page for number, page in enumerate(pages, 1))
    assert sum("Material 2024-T3" in page for page in pages) == 1


@pytest.mark.parametrize("written", ['"2026-03-02"', "2026-03-02", '"2026-03-02T08:30:00+01:00"'])
def test_a_stated_date_is_a_date_of_iso_8601(tmp_path, written):
    (tmp_path / "facts.toml").write_text(f"[laboratory]\ndate = {written}\n")
    facts = dic.report.read_stated_facts(tmp_path / "facts.toml")
    assert json.loads(json.dumps(facts.as_dict()))["laboratory"]["date"].startswith("2026-03-02")
    dic.exports.AboutTest("a", facts.tables)
    said = r"\[laboratory\] date: expected a date of ISO 8601, got '2.3.26'"
    with pytest.raises(dic.errors.OutputError, match=said):
        dic.exports.AboutTest("a", {"laboratory": {"date": "2.3.26"}})


def test_an_error_of_the_program_is_no_sentence_about_the_results(folder, tmp_path, monkeypatch):
    def broken(*_, **__):
        raise TypeError("a mistake of the program")

    monkeypatch.setattr("dic.write_series_report", broken)
    with pytest.raises(TypeError, match="a mistake of the program"):
        run_dic("report", folder / "r.h5", "-o", tmp_path / "report.html")


def test_pdf_without_its_library_is_one_sentence(folder, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "weasyprint", None)
    page, pdf = tmp_path / "report.html", tmp_path / "report.pdf"
    said = refusal("report", folder / "r.h5", "-o", page, "--pdf", pdf)
    assert "write PDF: expected the library WeasyPrint" in said
    assert "pip install 'offaxis[pdf]'" in said
    assert not page.exists()
    # the library is looked for before the results are read
    said = refusal("report", tmp_path / "none.h5", "-o", page, "--pdf", pdf)
    assert "write PDF: expected the library WeasyPrint" in said


def test_modulus_of_the_report_is_the_true_one(reported):
    (test,) = json.loads((reported / "report.json").read_text())["tests"]
    value = test["columns"][0]["values"]["E_gpa"]
    assert abs(value["value"] - E_MPA / 1e3) < 4 * value["std"] + 0.005 * E_MPA / 1e3
