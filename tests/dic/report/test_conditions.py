"""The conditions of a tensile test in the report: facts, sizes in mm, noise floors and remarks."""

from dataclasses import replace

import numpy as np
import pytest

import dic
from dic.out_of_plane.correct import Corrections
from dic.out_of_plane.correction import Correction
from dic.out_of_plane.plane import Plane
from dic.report.analysis import analysis_table
from dic.report.camera_images import images_of
from dic.report.conditions import conditions_of
from dic.report.hardware import hardware_table
from dic.report.noise_floor import doubt_of_rest, noise_floor_of
from dic.report.state_fields import state_picture
from dic.report.states import CurvePoint
from dic.report.style import plot_style
from dic.runfile.joined import open_run
from dic.runfile.reader import RunStep
from tests.dic.report.runs import INFO, SIDE_PX, affine, camera, correction, given, stretch, uncorrected
from tests.run_files import write_run

STEPS = 12
NECKS = "it necks"


def run(*declined, info=INFO):
    """A run whose calibrated εyy rises by 1000 µε per step; corrected εyy is half of it, or was declined."""
    steps = [RunStep(k, "load", 1e3 * k, 1e3 * k, 0.25 * k, np.nan, 10.0 * k) for k in range(1, STEPS + 1)]
    seen = camera("on_axis", steps, [stretch(-3e-4 * step.index, 1e-3 * step.index) for step in steps])
    half = [affine(stretch(0.0, 5e-4 * step.index), "half").calibrated for step in steps]
    corrections = [
        Correction.refused("tilt", one, NECKS)
        if step.index in declined
        else replace(correction(one, (0.0, 0.0, 0.0), Plane()), displacement=moved)
        for step, one, moved in zip(steps, seen.measurements, half, strict=True)
    ]
    found = {"on_axis": Corrections(corrections)}
    return given(uncorrected("runs/t.h5", info, [seen]), "tension", found, findings={"on_axis": []})


def pulled(result, **details):
    series = dic.measure_gauges(result, dic.derived.whole_field_gauges(result))
    settings = dic.properties.PropertySettings(area_mm2=20.0)
    return dic.tensile_test(series, "along", "across", settings, details=dic.report.ReportDetails(**details))


@pytest.mark.parametrize(
    ("declined", "kind", "bias"), [((), "corrected", 1500.0), ((1,), "calibrated", 3000.0)]
)
def test_predicted_and_measured_noise_are_of_the_kind_that_the_row_names(declined, kind, bias):
    result = run(*declined)
    (images,) = images_of(result)
    floor = noise_floor_of(images, pulled(result, static=("3",)))
    rows = {row.quantity: row for row in floor.rows}
    assert float(rows[f"local εyy, {kind}"].bias) == pytest.approx(bias, abs=0.05)
    assert "local εyy" not in rows


def test_a_strain_at_rest_beyond_four_standard_deviations_is_doubted():
    still = dic.gauges.Reading("mm", 3.9e-5, 1e-5, 1e-5)
    assert doubt_of_rest("img1", {"axial": still}) == ""
    said = doubt_of_rest("img2", {"across": still, "axial": replace(still, strain=-6e-4)})
    assert "img2 may not be at rest: the strain of gauge “axial” is −600.0 µε" in said
    assert "standard deviation is 10.0 µε" in said


def test_a_declined_correction_takes_the_kind_from_the_heading_of_the_maps():
    (images,) = images_of(run(7))
    states = [CurvePoint("Rp0,2", f"load {k}", 100.0, 0.001 * k) for k in (3, 7)]
    with plot_style():
        picture = state_picture(images, states, "eyy")
    assert picture.kind == "εyy"
    assert f"load 7 was not corrected: {NECKS}; its map shows calibrated strain." in picture.missing


def test_settings_of_a_camera_stay_in_the_table_if_the_first_camera_measured_nothing():
    images = images_of(run())[0]
    blind = replace(images, camera="blind", series=replace(images.series, images=[]))
    alone = analysis_table([images], run())
    table = analysis_table([blind, images], run())
    assert dict(table.rows).keys() == dict(alone.rows).keys()
    assert dict(table.rows)["Subset size"] == ["–", *dict(alone.rows)["Subset size"]]


def test_large_lengths_of_the_table_have_neither_a_bare_point_nor_an_exponent():
    images = images_of(run())[0]
    gauge_px = images.series.images[0].measurement.gauge_px
    index = np.stack(np.meshgrid(np.arange(11), np.arange(11)), axis=-1).reshape(-1, 2)
    # the gauge is 280 mm wide and 1080 mm high
    pitch_px = np.array([gauge_px / 280.0, gauge_px / 1080.0]) * 25.0
    points = dic.targets.GridPoints.on_lattice(index, index * pitch_px, (11, 11), 25.0)
    calibration = dic.Calibration.fit(points, (SIDE_PX, SIDE_PX))
    rows = dict(analysis_table([replace(images, calibration=calibration)], run()).rows)
    assert rows["Virtual strain gauge size"] == [f"{gauge_px} px, 280 mm × 1080 mm"]


def test_the_size_of_the_pattern_as_made_and_as_measured_have_their_own_origins():
    facts = dic.report.StatedFacts({"pattern": {"feature_size_mm": 0.2}}, source="facts.toml")
    result = replace(run(), file="r.h5")
    table = hardware_table(result, images_of(result), facts)
    entries = {entry["name"]: entry for entry in table.as_list()}
    made, measured = entries["Pattern feature size as made"], entries["Pattern feature size"]
    assert (made["text"], made["file"], made["step"]) == ("0.2 mm", "facts.toml", "[pattern]")
    assert (measured["file"], measured["step"]) == ("r.h5", "reference")
    assert "0.2 mm" not in measured["text"]


def test_facts_of_a_moved_run_name_the_file_that_was_opened(tmp_path):
    moved = write_run(tmp_path / "t.h5")
    with open_run(moved) as opened:
        name, info = opened.cameras[0], opened.info
    result = replace(run(info=info), source="gone/t.h5", file=str(tmp_path / "r.h5"))
    images = [replace(images_of(result)[0], camera=name)]
    entries = {
        entry["name"]: entry for entry in hardware_table(result, images, dic.report.StatedFacts()).as_list()
    }
    assert {entries[row]["file"] for row in ("Camera", "Bit depth", "Exposure time")} == {str(moved)}
    assert entries["Image resolution"]["text"] == f"{SIDE_PX} px × {SIDE_PX} px"
    assert entries["Image resolution"]["file"] == str(tmp_path / "r.h5")


def test_lengths_in_mm_use_the_scale_of_their_own_direction():
    index = np.stack(np.meshgrid(np.arange(11), np.arange(11)), axis=-1).reshape(-1, 2)
    uv_px = np.array([10.0, 110.0]) + index * (10.0, -8.0)  # 0.1 and 0.125 mm/px
    points = dic.targets.GridPoints.on_lattice(index, uv_px, (11, 11), 1.0)
    result = run()
    calibration = dic.Calibration.fit(points, (SIDE_PX, SIDE_PX))
    result = replace(result, cameras=[replace(result.cameras[0], calibration=calibration)])
    facts = dict(hardware_table(result, images_of(result), dic.report.StatedFacts()).rows)
    assert facts["Field of view"][0].startswith("12.00 mm × 15.00 mm")
    assert facts["Image scale"][0].startswith("10.00 px/mm × 8.00 px/mm, 100.000 µm/px × 125.000 µm/px")
    assert calibration.axes_mm_per_px == pytest.approx((0.1, 0.125), rel=1e-9)


def test_the_page_states_only_what_is_known_and_what_contradicts_it():
    result = run(info=replace(INFO, width_mm=25.0, thickness_mm=0.9, gauge_length_mm=60.0))
    facts = dic.report.StatedFacts({"specimen": {"thickness_mm": 1.0}})
    test = pulled(result, facts=facts, fields_at=("last",))
    with plot_style():
        found = conditions_of(test, result, images_of(result))
    specimen = dict(dict(found.stated)["Specimen"])
    assert (specimen["Parallel length"], specimen["Gauge length"]) == ("not stated", "60 mm")
    assert dict(found.tables.analysis.rows)["Software"] == ["not stated"]
    # the stated thickness of 1 mm replaces 0.9 mm, and S0 is 20 mm²
    assert found.doubts == [
        "Width × thickness is 25 mm × 1 mm = 25 mm², but all stresses were computed with S0 = 20 mm²."
    ]
    facts = dic.report.StatedFacts({"specimen": {"width_mm": 20.1, "thickness_mm": 1.0}})  # 0.5 % off
    test = pulled(result, facts=facts, fields_at=("last",))
    with plot_style():
        assert conditions_of(test, result, images_of(result)).doubts == []
