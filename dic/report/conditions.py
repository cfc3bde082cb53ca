"""The conditions of a tensile test in the report: specimen, machine, cameras, settings, noise and fields."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dic.gauges.declared import Extensometer, TransverseExtensometer
from dic.pipeline.run_result import RunResult
from dic.report.analysis import NoiseFloor, analysis_table, noise_floor_of
from dic.report.camera_images import CameraImages, Results
from dic.report.hardware import FactTable, hardware_table, stated_table
from dic.report.numbers import date
from dic.report.state_fields import StatePicture, quantity_along, state_picture
from dic.report.stated_facts import NOT_STATED, StatedFacts
from dic.report.states import State, chosen_states
from dic.report.tensile_test import TensileTest

_TITLES = {"laboratory": "Laboratory", "specimen": "Specimen", "machine": "Testing machine"}
_SIDES = ("width_mm", "thickness_mm")
_AREA_TOLERANCE = 0.01
"""Accepted relative difference between the area used and width × thickness, which are often rounded."""


@dataclass(frozen=True)
class Conditions:
    """The conditions of a test, in the form that the page template needs.

    Attributes
    ----------
    stated : list of (str, list of (str, str))
        Title of each table of facts, and its rows.
    doubts : list of str
        Facts that contradict the evaluation, one sentence each.
    hardware, analysis : FactTable
    noise : list of NoiseFloor
    states : list of State
        The points of the curve whose fields are shown.
    fields : list of StatePicture
    """

    stated: list[tuple[str, list[tuple[str, str]]]]
    doubts: list[str]
    hardware: FactTable
    analysis: FactTable
    noise: list[NoiseFloor]
    states: list[State]
    fields: list[StatePicture]


def conditions_of(test: TensileTest, result: Results, images: Sequence[CameraImages]) -> Conditions:
    """Return the conditions of a test; call it within `plot_style`.

    Raises
    ------
    MeasurementError
        If the stated facts, the points of the curve or the images at rest do not fit the results.
    """
    facts, known = test.details.facts, _known(result)
    # Check everything that may be refused before drawing the pictures, which take most of the time.
    facts.require_cameras(each.camera for each in images)
    states = chosen_states(test.main, test.details.fields_at)
    floors = [noise_floor_of(each, test) for each in images]
    quantity = quantity_along(_direction_deg(test))
    pictures = [state_picture(each, states, quantity) for each in images]
    origin = result.provenance
    software = origin.versions.partition(",")[0] if origin is not None else NOT_STATED
    return Conditions(
        stated=[(title, stated_table(facts, name, known.get(name, {}))) for name, title in _TITLES.items()],
        doubts=_doubts(facts, result, test.settings.area_mm2),
        hardware=hardware_table(result, images, facts),
        analysis=analysis_table(images, software),
        noise=[floor for floor in floors if floor is not None],
        states=states,
        fields=[picture for picture in pictures if picture is not None],
    )


def _known(result: Results) -> Mapping[str, Mapping[str, str]]:
    """Return the facts about laboratory and specimen that the run file contains."""
    if not isinstance(result, RunResult):
        return {}
    info = result.info
    sizes = {
        "width_mm": info.width_mm,
        "thickness_mm": info.thickness_mm,
        "gauge_length_mm": info.gauge_length_mm,
    }
    specimen = {"name": info.sample} | {key: f"{size:g} mm" for key, size in sizes.items()}
    return {"laboratory": {"date": date(info.start_time)}, "specimen": specimen}


def _doubts(facts: StatedFacts, result: Results, area_mm2: float) -> list[str]:
    """Return a sentence if the specimen's width and thickness do not give the area that was used."""
    sizes = (
        {"width_mm": result.info.width_mm, "thickness_mm": result.info.thickness_mm}
        if isinstance(result, RunResult)
        else {}
    )
    sizes |= {key: value for key, value in facts.tables.get("specimen", {}).items() if key in _SIDES}
    if any(key not in sizes for key in _SIDES):
        return []
    width_mm, thickness_mm = (float(sizes[key]) for key in _SIDES)
    if abs(width_mm * thickness_mm / area_mm2 - 1.0) <= _AREA_TOLERANCE:
        return []
    product = f"{width_mm:g} mm × {thickness_mm:g} mm = {width_mm * thickness_mm:.4g} mm²"
    return [f"Width × thickness is {product}, but all stresses were computed with S0 = {area_mm2:g} mm²."]


def _direction_deg(test: TensileTest) -> float:
    """Return the direction of the gauge along the specimen, degrees from x right to y up."""
    gauge = next(gauge for gauge in test.series.gauges if gauge.name == test.gauge)
    if isinstance(gauge, Extensometer | TransverseExtensometer):
        x, y = gauge.upwards(gauge.end) - gauge.upwards(gauge.start)
        return float(np.degrees(np.arctan2(y, x)))
    return float(getattr(gauge, "direction_deg", 0.0))
