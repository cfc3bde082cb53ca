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
from dic.report.states import State, chosen_states
from dic.report.tensile_test import TensileTest
from dic.results.provenance import versions

_TITLES = {"laboratory": "Laboratory", "specimen": "Specimen", "machine": "Testing machine"}


@dataclass(frozen=True)
class Conditions:
    """The conditions of a test, in the form that the page template needs.

    Attributes
    ----------
    stated : list of (str, list of (str, str))
        Title of each table of facts, and its rows.
    hardware, analysis : FactTable
    noise : list of NoiseFloor
    states : list of State
        The points of the curve whose fields are shown.
    fields : list of StatePicture
    """

    stated: list[tuple[str, list[tuple[str, str]]]]
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
    software = origin.versions.partition(",")[0] if origin is not None else versions().partition(",")[0]
    return Conditions(
        stated=[(title, stated_table(facts, name, known.get(name, {}))) for name, title in _TITLES.items()],
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
        "parallel_length_mm": info.gauge_length_mm,
    }
    specimen = {"name": info.sample} | {key: f"{size:g} mm" for key, size in sizes.items()}
    return {"laboratory": {"date": date(info.start_time)}, "specimen": specimen}


def _direction_deg(test: TensileTest) -> float:
    """Return the direction of the gauge along the specimen, degrees from x right to y up."""
    gauge = next(gauge for gauge in test.series.gauges if gauge.name == test.gauge)
    if isinstance(gauge, Extensometer | TransverseExtensometer):
        x, y = gauge.upwards(gauge.end) - gauge.upwards(gauge.start)
        return float(np.degrees(np.arctan2(y, x)))
    return float(getattr(gauge, "direction_deg", 0.0))
