"""Maps of displacement and strain at a few characteristic steps, drawn over the reference image."""

from dataclasses import dataclass

from dic.pictures.maps import draw_maps
from dic.pictures.panels import maps_of, scale_of
from dic.pictures.settings import MapSettings
from dic.report import rotation, tension
from dic.report.series import Run
from dic.report.style import PICTURE_DPI, PICTURE_WIDTH_MM, png_uri
from dic.runfile.reader import RunStep

_SETTINGS = MapSettings(width_mm=PICTURE_WIDTH_MM)


@dataclass(frozen=True)
class FieldPicture:
    """The maps of displacement and strain of one camera at one step, as a data URI, with their caption."""

    camera: str
    step: RunStep
    words: str
    uri: str


def field_pictures(run: Run) -> list[FieldPicture]:
    """Return the maps of every camera of a run, at steps that are characteristic of the kind of test."""
    telling = rotation.telling_steps if run.kind == "rotation" else tension.telling_steps
    pictures = []
    for step, words in telling(run.steps):
        for series in run.cameras:
            measured = {s.index: k for k, s in enumerate(series.steps)}
            if step.index in measured:
                at = measured[step.index]
                correction = run.result.corrections.best(series.camera, step.index, at)
                maps = maps_of(series.measurements[at], _SETTINGS, correction)
                scale = scale_of([maps], _SETTINGS)
                figure = draw_maps(maps, series.result.reference, "", _SETTINGS, scale)
                pictures.append(FieldPicture(series.label, step, words, png_uri(figure, dpi=PICTURE_DPI)))
    return pictures
