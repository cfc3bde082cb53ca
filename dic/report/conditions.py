"""The conditions of a tensile test in the report: specimen, machine, cameras, settings, noise and fields."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from math import isfinite
from typing import Any

from dic.pipeline.result import RunResult, SeriesResult
from dic.report.analysis import analysis_table
from dic.report.camera_images import ReportedImages, Results, images_of
from dic.report.fact_table import Fact, FactTable
from dic.report.hardware import hardware_table, results_file, stated_table
from dic.report.noise_floor import NoiseFloor, noise_floor_of
from dic.report.numbers import date, direction_text
from dic.report.repeat import result_of
from dic.report.state_fields import StatePicture, quantity_along, state_picture
from dic.report.stated_facts import StatedFacts
from dic.report.states import CurvePoint, chosen_states
from dic.report.tensile_record import TensileTest

_TITLES = {"laboratory": "Laboratory", "specimen": "Specimen", "machine": "Testing machine"}
_SIDES = ("width_mm", "thickness_mm")
_AREA_TOLERANCE = 0.01
"""Accepted relative difference between the area used and width × thickness, which are often rounded."""


@dataclass(frozen=True)
class TestTables:
    """The tables about a test beside its values."""

    stated: Mapping[str, FactTable]
    """Facts about laboratory, specimen and machine, keyed by table."""
    hardware: FactTable
    analysis: FactTable
    noise: list[NoiseFloor]

    def as_dict(self) -> dict[str, Any]:
        """Return all tables for JSON; each fact has its file, its step and its rule."""
        return {
            **{name: table.as_list() for name, table in self.stated.items()},
            "hardware": self.hardware.as_list(),
            "analysis": self.analysis.as_list(),
            "noise_floor": [row for floor in self.noise for row in floor.as_list()],
        }


@dataclass(frozen=True)
class StatedConditions:
    """The conditions of a test, in the form that the page template needs."""

    stated: list[tuple[str, list[tuple[str, str]]]]
    """Title of each table of facts, and its rows."""
    doubts: list[str]
    """Facts that contradict the evaluation, one sentence each."""
    tables: TestTables
    states: list[CurvePoint]
    """The points of the curve whose fields are shown."""
    fields: list[StatePicture]


def conditions_of(test: TensileTest, result: Results, images: Sequence[ReportedImages]) -> StatedConditions:
    """Return the conditions of a test; call it within `plot_style`.

    Raises `MeasurementError` if the stated facts, the points of the curve or the images at rest do not fit
    the results.
    """
    # Check everything that may be refused before drawing the pictures, which take most of the time.
    states = chosen_states(test.main, test.details.fields_at)
    tables = _tables(test, result, images)
    quantity = quantity_along(_direction_deg(test))
    pictures = [state_picture(each, states, quantity) for each in images]
    stated = [
        (_TITLES[name], [(row, text) for row, (text,) in table.rows]) for name, table in tables.stated.items()
    ]
    doubts = [*_doubts(test.details.facts, result, test.settings.area_mm2), *tables.hardware.doubts]
    return StatedConditions(stated, doubts, tables, states, [each for each in pictures if each is not None])


def tables_of_test(test: TensileTest, results: Results | Sequence[Results]) -> dict[str, Any]:
    """Return the tables of a tensile test's report for JSON: facts, hardware, analysis and noise floor.

    Parameters
    ----------
    test : TensileTest
    results : RunResult or SeriesResult, or a sequence of them
        The results from which the test was computed.

    Returns
    -------
    dict
        The tables "laboratory", "specimen", "machine", "hardware", "analysis" and "noise_floor". Each entry
        has the file, the step and the rule that it comes from. The table "files" has the SHA-256 of each of
        these files, and null for a file of unknown digest.

    Raises
    ------
    MeasurementError
        As for `conditions_of`.
    """
    several = [results] if isinstance(results, RunResult | SeriesResult) else results
    result = result_of(test, several)
    found = _tables(test, result, images_of(result)).as_dict()
    digests = (dict(result.provenance.inputs) if result.provenance else {}) | dict(test.provenance.inputs)
    entries = [entry for table in found.values() for entry in table]
    used = dict.fromkeys(entry["file"] for entry in entries if entry["file"])
    return found | {"files": {name: digests.get(name) for name in used}}


def _tables(test: TensileTest, result: Results, images: Sequence[ReportedImages]) -> TestTables:
    facts, known = test.details.facts, _known(result)
    facts.require_cameras(each.camera for each in images)
    floors = [noise_floor_of(each, test, results_file(result)) for each in images]
    return TestTables(
        {name: stated_table(facts, name, known.get(name, {})) for name in _TITLES},
        hardware_table(result, images, facts),
        analysis_table(images, result),
        [floor for floor in floors if floor is not None],
    )


def _known(result: Results) -> Mapping[str, Mapping[str, Fact]]:
    """Return the facts about laboratory and specimen that the run file contains."""
    if not isinstance(result, RunResult):
        return {}
    info, of_run = result.info, partial(Fact, file=results_file(result))
    sizes = {
        "width_mm": info.width_mm,
        "thickness_mm": info.thickness_mm,
        "gauge_length_mm": info.gauge_length_mm,
    }
    specimen = {"name": of_run(info.sample, step="run", rule="sample")}
    if info.direction_deg is not None:
        told = direction_text(info.direction_deg)
        specimen["orientation"] = of_run(told, step="run", rule="direction_deg")
    specimen |= {
        key: of_run(f"{size:g} mm", step="run", rule=key) for key, size in sizes.items() if isfinite(size)
    }
    begun = of_run(date(info.start_time), step="run", rule="start_time")
    return {"laboratory": {"date": begun}, "specimen": specimen}


def _doubts(facts: StatedFacts, result: Results, area_mm2: float) -> list[str]:
    """Return a sentence if the specimen's width and thickness do not give the area that was used."""
    sizes = (
        {"width_mm": result.info.width_mm, "thickness_mm": result.info.thickness_mm}
        if isinstance(result, RunResult)
        else {}
    )
    sizes |= {key: value for key, value in facts.tables.get("specimen", {}).items() if key in _SIDES}
    if any(key not in sizes or not isfinite(float(sizes[key])) for key in _SIDES):
        return []
    width_mm, thickness_mm = (float(sizes[key]) for key in _SIDES)
    if abs(width_mm * thickness_mm / area_mm2 - 1.0) <= _AREA_TOLERANCE:
        return []
    product = f"{width_mm:g} mm × {thickness_mm:g} mm = {width_mm * thickness_mm:.4g} mm²"
    return [f"Width × thickness is {product}, but all stresses were computed with S0 = {area_mm2:g} mm²."]


def _direction_deg(test: TensileTest) -> float:
    """Return the direction of the gauge along the specimen, degrees from x right to y up."""
    gauge = next(gauge for gauge in test.series.gauges if gauge.name == test.gauge)
    return float(getattr(gauge, "direction_deg", 0.0))
