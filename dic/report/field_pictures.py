"""The maps of a run in its report: at telling steps, and of a long run in a few images from first to last."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dic.pictures.contact_sheet import draw_contact_sheet
from dic.pictures.maps import MapDrawer
from dic.pictures.panels import Maps, maps_of, scale_of
from dic.pictures.settings import MapSettings
from dic.pipeline.result import RunResult
from dic.report import rotation, tension
from dic.report.series import CameraSeries, Run
from dic.report.states import chosen_states
from dic.report.strains import COMPONENTS
from dic.report.style import PICTURE_WIDTH_MM, pixels_uri
from dic.report.tensile_record import TensileTest
from dic.report.thinning import some_of
from dic.runfile.reader import RunStep

_MAPS = MapSettings(width_mm=PICTURE_WIDTH_MM)
_QUANTITIES = ("exx", "eyy", "exy")
_MOST_SMALL = 12
"""Number of small maps of a long run."""


@dataclass(frozen=True)
class FieldPicture:
    """Maps of one camera as a data URI, with their caption."""

    caption: str
    uri: str


def field_pictures(run: Run, proof: RunStep | None = None) -> list[FieldPicture]:
    """Return the maps of every camera of a run, at steps that are characteristic of the kind of test.

    `proof`: the step at the proof strength, if it is known. A long run has small maps of the strain along the
    specimen in evenly spaced images, too.
    """
    if run.kind == "rotation":
        telling = rotation.telling_steps(run.steps)
    elif run.is_long:
        telling = tension.telling_images(run.steps, proof)
    else:
        telling = tension.telling_steps(run.steps)
    pictures = [
        FieldPicture(f"{series.label} at {words}, step {step.index}.", _full_maps(run, series, at))
        for step, words in telling
        for series in run.cameras
        if (at := _place(series, step)) is not None
    ]
    if run.is_long:
        wanted = {step.index for step, _ in telling}
        pictures += [_small_maps(run, series, wanted) for series in run.cameras if series.steps]
    return pictures


def proof_step(run: Run, tests: Sequence[TensileTest]) -> RunStep | None:
    """Return the step at the proof strength of a run's test; None without a test or a proof strength."""
    names = {run.result.source, run.result.file}
    for test in tests:
        if test.series.source in names:
            labels = {state.label for state in chosen_states(test.main) if state.words.startswith("Rp0,2")}
            return next((step for step in run.steps if f"{step.kind} {step.index}" in labels), None)
    return None


def _place(series: CameraSeries, step: RunStep) -> int | None:
    return next((k for k, each in enumerate(series.steps) if each.index == step.index), None)


def _maps(result: RunResult, series: CameraSeries, at: int, settings: MapSettings) -> Maps:
    correction = result.corrections.best(series.camera, series.steps[at].index, at)
    return maps_of(series.measurements[at], settings, correction)


def _full_maps(run: Run, series: CameraSeries, at: int) -> str:
    maps = _maps(run.result, series, at, _MAPS)
    page = MapDrawer(_MAPS).draw(maps, series.result.reference, "", scale_of([maps], _MAPS))
    return pixels_uri(page.pixels())


def _small_maps(run: Run, series: CameraSeries, wanted: set[int]) -> FieldPicture:
    strains = tension.best_strain(series)[:, :2]
    along = int(np.argmax(np.nanmax(np.abs(strains), axis=0, initial=0.0)))
    settings = replace(_MAPS, quantities=(_QUANTITIES[along],))
    telling = [k for k, step in enumerate(series.steps) if step.index in wanted]
    shown = some_of(len(series.steps), _MOST_SMALL, telling)
    images = [(f"step {series.steps[k].index}", _maps(run.result, series, k, settings)) for k in shown]
    scale = scale_of([maps for _, maps in images], settings)
    page = draw_contact_sheet(images, series.result.reference, len(series.steps), settings, scale)
    caption = (
        f"{series.label}: {COMPONENTS[along]} in {len(shown)} of {len(series.steps)} images, on one scale."
    )
    return FieldPicture(caption, pixels_uri(page.pixels()))
