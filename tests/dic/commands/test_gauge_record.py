"""A folder of images and a machine's record give gauge readings with loads, and material properties."""

import csv
import json
import re

import numpy as np
import pytest
from PIL import Image

import dic
from tests.command_line import refusal, run_dic
from tests.dic.commands.tension_series import (
    AREA_MM2,
    AXIAL,
    E_MPA,
    GAUGES,
    IMAGES,
    WIDTH,
    stress_mpa,
)
from tests.exif_files import save_taken, set_changed

JOINS = {
    "name": ["--image-column", "Image"],
    "row": [],
    "time": ["--time", "Time:s", "--image-interval-s", 0.5],
}


@pytest.mark.parametrize("join", JOINS)
def test_load_stands_beside_the_strain_of_each_image(folder, tmp_path, join):
    table = tmp_path / "g.csv"
    record = ["--record", folder / "machine.csv", "--load", "Force:kN", "--displacement", "Way:mm"]
    written = ["-o", table, "--json", tmp_path / "g.json"]
    done = run_dic("gauges", folder / "r.h5", "--declare", AXIAL, *record, *JOINS[join], *written)
    assert done.status == 0, done
    assert done.report["record"]["join"] == join
    rows = list(csv.DictReader(table.read_text().splitlines()))
    assert len(rows) == IMAGES
    for k, row in enumerate(rows, 1):
        strain, std = 0.012 * k / IMAGES, float(row["axial_raw_strain_std"])
        assert float(row["load_n"]) == pytest.approx(AREA_MM2 * stress_mpa(strain), abs=0.01)
        assert float(row["displacement_mm"]) == pytest.approx(60 * strain, abs=1e-4)
        assert float(row["axial_raw_strain"]) == pytest.approx(strain, abs=5 * std)


RATE_N_PER_S, LATE_S = 40.0, 2.5
TIMES_S = (0.0, 1.0, 1.75, 4.25, 4.5, 6.0, 9.0)
"""Times in s of the images since the reference; the third image is damaged."""


def write_timed_series(speckle, folder, source):
    """Write images of a growing strain, and the machine's record, whose clock is ahead by `LATE_S`."""
    images, pattern = folder / "images", speckle(seed=31, noise=1.0)
    images.mkdir()
    for k, time_s in enumerate(TIMES_S):
        path = images / f"img{k}.tif"
        drawn = pattern.draw(lambda x, y, by=1e-3 * time_s: (x, 80 + (y - 80) / (1 + by)), noise_seed=k)
        taken = f"2026:07:01 10:00:{int(time_s):02d}" if source == "exif" else None
        save_taken(Image.fromarray(np.rint(drawn).astype(np.uint8)), path, taken, f"{time_s % 1:.2f}"[2:])
        if k == 2:
            path.write_bytes(path.read_bytes()[:5000])
        set_changed(path, 1_700_000_000 + (time_s if source == "file" else 0))
    at = np.arange(0.0, 15.0, 0.1)
    lines = ["t;F", "s;N", *(f"{t + LATE_S:.2f};{RATE_N_PER_S * t:.3f}" for t in at)]
    (folder / "clock.csv").write_text("\n".join(lines))
    loads = [f"{RATE_N_PER_S * time_s:.3f};0" for time_s in TIMES_S[1:]]
    (folder / "rows.csv").write_text("\n".join(["F;x", "N;", *loads]))
    return images


@pytest.mark.parametrize("source", ["exif", "file"])
def test_load_is_that_at_the_time_of_each_image_also_after_one_that_failed(speckle, tmp_path, source):
    images, result = write_timed_series(speckle, tmp_path, source), tmp_path / "r.h5"
    done = run_dic("correlate", images, "--subset", 21, "--step", 7, "-o", result, "--csv", tmp_path / "csv")
    assert done.status == 2
    strains = list(csv.DictReader((tmp_path / "csv" / "strain.csv").read_text().splitlines()))
    assert [float(row["time_s"]) for row in strains] == pytest.approx(TIMES_S[1:])
    assert {row["time_source"] for row in strains} == {source}
    words = ("gauges", result, "--gauge", AXIAL, "--load", "F:N", "--json", tmp_path / "g.json", "--force")
    by_time = (tmp_path / "clock.csv", "--time", "t:s", "--join", "time", "--offset-s", LATE_S)
    joins = {"row": (tmp_path / "rows.csv",), "time": by_time}
    for join, (record, *others) in joins.items():
        done = run_dic(*words, "--record", record, *others)
        assert done.report["record"]["join"] == join
        images_read = done.report["images"]
        assert [image["load_n"] for image in images_read] == pytest.approx(
            [RATE_N_PER_S * time_s for time_s in TIMES_S[1:]], abs=1e-2
        )
        assert [image["error"] is None for image in images_read] == [k != 2 for k in range(1, len(TIMES_S))]
    assert done.report["record"]["image_times"] == source
    assert (source == "file") == ("of the image files' last change, which is late" in done.out)


@pytest.fixture(scope="module")
def found(folder, tmp_path_factory):
    """The material properties in the result file."""
    path = tmp_path_factory.mktemp("found") / "p.json"
    done = run_dic(
        "properties", folder / "r.h5", "--declare", AXIAL, "--declare", WIDTH, "--transverse-gauge", "width",
        "--record", folder / "machine.csv", "--load", "Force:kN", "--time", "Time:s",
        "--area-mm2", AREA_MM2, "--json", path,
    )  # fmt: skip
    assert done.status == 0, done
    assert f"raw strain of {IMAGES} images, 0 without a reading" in done.out
    return json.loads(path.read_text())


def test_properties_of_a_result_file_are_the_true_ones(found):
    for name, truth in (("E_gpa", E_MPA / 1e3), ("nu", 0.33)):
        value = found[name]
        assert abs(value["value"] - truth) < 4 * value["std"] + 0.005 * truth
        assert value["std"] < 0.05 * truth
    assert found["Rm_mpa"]["value"] == pytest.approx(stress_mpa(0.012), rel=1e-6)
    assert (found["strain_kind"], found["images"], found["left_out"]) == ("raw", IMAGES, 0)


def test_the_clock_is_told_with_its_part_of_each_deviation(folder, tmp_path):
    done = run_dic(
        "properties", folder / "r.h5", "--declare", AXIAL, "--record", folder / "machine.csv",
        "--load", "Force:kN", *JOINS["time"], "--offset-s", "0", "--clock-rate-std-percent", "0.5",
        "--area-mm2", AREA_MM2, "--json", tmp_path / "p.json",
    )  # fmt: skip
    assert done.status == 0, done
    record, part = done.report["record"], done.report["std_by_join"]["E_gpa"]
    assert (record["offset_s"], record["offset_from"], record["clock_rate_from"]) == (0.0, "given", "given")
    assert record["clock_rate_std"] == 0.005
    # E has the relative error of the rate where the load grows evenly, and less where it grows more slowly.
    assert part["clock_rate"] == pytest.approx(0.005 * E_MPA / 1e3, rel=0.3)
    assert done.report["E_gpa"]["std"] > part["both"] > part["offset"]
    assert "image's second 1 ± 0.005" in done.out
    assert "± by offset and rate of the machine's clock: E " in done.out


def test_properties_of_a_result_file_are_those_of_its_table(folder, found, tmp_path):
    table, record = tmp_path / "g.csv", ["--record", folder / "machine.csv", "--load", "Force:kN"]
    gauges = "--gauge", AXIAL, "--gauge", WIDTH
    assert run_dic("gauges", folder / "r.h5", *gauges, *record, "-o", table).status == 0
    columns = "--load", "load_n:N", "--strain", "axial_raw_strain:1", "--transverse", "width_raw_strain:1"
    done = run_dic("properties", table, *columns, "--area-mm2", AREA_MM2, "--json", tmp_path / "p.json")
    assert done.status == 0, done
    for name in ("E_gpa", "nu", "Rp02_mpa", "Rm_mpa"):
        # The table has nine decimals.
        assert done.report[name]["value"] == pytest.approx(found[name]["value"], rel=1e-4), name


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--declare", AXIAL], "a load for each image, got none; give the machine's record with --record"),
        (["--declare", AXIAL, "--strain", "3:%"], "the table of a testing machine, got a result file"),
        ([], "at least one gauge, got none"),
        (["--declare", AXIAL, "--gauge", "width"], "choose a gauge: expected one of axial, got 'width'"),
        (["--declare", AXIAL, "--load", "Force:kN"], "--record beside it"),
        (["--declare", AXIAL, "--record", "{machine}"], "the column of the load and its unit, got none"),
        (
            [*("--declare", AXIAL, "--record", "{machine}", "--load", "Force:kN", "--time", "Time:s"),
             *("--image-interval-s", "1")],
            "got img011.png at 11 s and 9 more images outside",
        ),
        (
            [*("--declare", AXIAL, "--record", "{machine}", "--load", "Force:kN", "--time", "Time:s"),
             *("--image-interval-s", "0.5", "--offset-s", "soon")],
            "a number, or auto, got 'soon'",
        ),
        (
            [*("--declare", AXIAL, "--record", "{machine}", "--load", "Force:kN", "--kind", "corrected")],
            "choose a kind of strain: expected one of raw, got 'corrected'",
        ),
        (["--declare", AXIAL, "--gauge-length-mm", "-5"], "the table of a testing machine, got a result"),
        *(
            ([*("--declare", AXIAL, "--record", "{machine}", "--load", "Force:kN"), *idle], words)
            for idle, words in (
                (["--join", "row", "--image-interval-s", "7"], "--image-interval-s: expected --join time"),
                (["--join", "row", "--offset-s", "33"], "--offset-s: expected --join time, got --join row"),
                (["--join", "name", "--image-column", "Image", "--offset-s", "50"], "expected --join time"),
                (["--join", "row", "--image-column", "Image"], "--image-column: expected --join name"),
                (["--join", "time", "--image-interval-s", "1", "--offset-gauge", "a"], "--offset-s auto"),
                    (["--join", "row", "--clock-rate", "1"], "--clock-rate: expected --join time"),
                    (["--join", "row", "--offset-std-s", "1"], "--offset-std-s: expected --join time"),
            )
        ),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_refused_in_one_sentence(folder, arguments, words):
    given = [str(one).format(machine=folder / "machine.csv") for one in arguments]
    assert words in refusal("properties", folder / "r.h5", *given, "--area-mm2", AREA_MM2)


def test_a_file_that_does_not_exist_is_named_as_missing(folder, tmp_path):
    missing = tmp_path / "none.csv"
    words = refusal("properties", missing, "--declare", AXIAL, "--area-mm2", AREA_MM2)
    assert "none.csv: read: expected a table or a result file, got No such file" in words
    assert "got no such file; name another file" in refusal("gauges", missing, "--gauge", AXIAL)


def test_a_damaged_file_in_the_place_of_results_is_called_damaged(folder, tmp_path):
    damaged = tmp_path / "damaged.h5"
    damaged.write_bytes((folder / "r.h5").read_bytes()[:20_000])
    images = sorted(folder.rglob("*.png"))[:2]
    words = refusal("correlate", *images, "-o", damaged)
    assert "one that exists and cannot be used" in words
    assert "--force" in words
    assert damaged.stat().st_size == 20_000


def test_a_table_takes_no_gauges(folder):
    columns = "--load", "Force:kN", "--strain", "Way:%", "--area-mm2", AREA_MM2
    assert "a result file of `dic correlate`" in refusal(
        "properties", folder / "machine.csv", *columns, "--gauge", "axial"
    )


@pytest.mark.extended
def test_images_and_a_table_become_a_test_report(folder, tmp_path):
    known = tmp_path / "known.json"
    known.write_text(json.dumps({"E_gpa": E_MPA / 1e3, "nu": 0.33}))
    page, values = tmp_path / "report.html", tmp_path / "report.json"
    record = "--record", folder / "machine.csv", "--load", "Force:kN"
    command = "report", folder / "r.h5", *record, "--area-mm2", AREA_MM2, "-o", page
    done = run_dic(*command, "--known", known, "--json", values)
    assert done.status == 0, done
    (test,) = json.loads(values.read_text())["tests"]
    (column,) = test["columns"]
    assert column["strain_kind"] == "raw"
    assert [gauge["name"] for gauge in test["gauges"]] == ["along", "across"]
    for name, symbol, truth in (("E_gpa", "E", E_MPA / 1e3), ("nu", "ν", 0.33)):
        value = column["values"][name]
        assert value["symbol"] == symbol
        assert abs(value["value"] - truth) < 4 * value["std"] + 0.005 * truth
    for k, point in enumerate(column["curve"], 1):
        assert point["image"].endswith(f"img{k:03d}.png")
        assert point["load_n"] == pytest.approx(AREA_MM2 * stress_mpa(0.012 * k / IMAGES), abs=0.01)
    text = page.read_text(encoding="utf-8")
    cells = re.findall(r"<td[^>]*>(.*?)</td>", text[text.index("<td>E</td>") :])
    assert cells[:2] == ["E", "GPa"]
    assert float(cells[2].split(" ± ")[0]) == pytest.approx(column["values"]["E_gpa"]["value"], abs=0.51)
    assert cells[3] == "70.00"
    assert text.count("data:image/svg+xml") == 2  # the curves of all columns, and of all gauges


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (
            ["--record", "{machine}", "--load", "Force:kN"],
            "--area-mm2: expected the area of the cross-section",
        ),
        (["--area-mm2", "20"], "a load for each image, got none; give the machine's record with --record"),
        (["--ttl", "{machine}.ttl"], "--ttl: expected a tensile test"),
        (["--join", "row"], "--record"),
        (
            ["--record", "{machine}", "--load", "Force:kN", "--area-mm2", "20", "--known", "{wrong}"],
            "known values: E: expected numbers named E_gpa",
        ),
        (
            ["--record", "{machine}", "--load", "Force:kN", "--area-mm2", "20", "--known", "{machine}"],
            "expected a JSON object of values",
        ),
    ],
)
def test_a_report_of_a_test_refuses_what_does_not_fit(folder, tmp_path, arguments, words):
    wrong = tmp_path / "wrong.json"
    wrong.write_text('{"E": 70}')
    given = [str(one).format(machine=folder / "machine.csv", wrong=wrong) for one in arguments]
    assert words in refusal("report", folder / "r.h5", *given, "-o", tmp_path / "report.html")
    assert not (tmp_path / "report.html").exists()


def test_result_files_are_specimens_of_a_campaign(folder, tmp_path):
    """The same result file as for `dic properties` gives the same values."""
    (tmp_path / "gauges.toml").write_text(GAUGES)
    record = ["--record", folder / "machine.csv", "--load", "Force:kN"]
    alone = run_dic(
        "properties", folder / "r.h5", "--gauges", tmp_path / "gauges.toml", "--transverse-gauge", "width",
        "--area-mm2", AREA_MM2, *record, "--json", tmp_path / "p.json",
    )  # fmt: skip
    text = f"""
[defaults]
load = "Force:kN"
area_mm2 = {AREA_MM2}
record = "{folder / "machine.csv"}"
[[specimen]]
name = "gauges"
file = "{folder / "r.h5"}"
gauges = "gauges.toml"
transverse_gauge = "width"
"""
    (tmp_path / "campaign.toml").write_text(text)
    done = run_dic("campaign", tmp_path, "--json", tmp_path / "c.json")
    (found,) = done.report["specimens"]
    assert (found["strain_kind"], found["left_out"], done.report["warnings"]) == ("raw", 0, [])
    assert "strain: raw, gauges" in done.out
    assert found["E_gpa"]["value"] is not None
    assert {key: found[key] for key in ("E_gpa", "nu", "Rp02_mpa")} == {
        key: alone.report[key] for key in ("E_gpa", "nu", "Rp02_mpa")
    }


def test_without_gauges_a_campaign_reads_the_whole_field(folder):
    source = dic.campaigns.GaugeChoice(record=folder / "machine.csv", load="Force:kN")
    settings = dic.properties.PropertySettings(area_mm2=AREA_MM2)
    specimen = dic.campaigns.CampaignSpecimen("whole", folder / "r.h5", settings, source)
    (test,) = dic.campaigns.measure_campaign([specimen]).tests
    assert test.properties.values["E_gpa"].value == pytest.approx(E_MPA / 1e3, rel=0.01)
    assert test.properties.values["nu"].value == pytest.approx(0.33, abs=0.01)
