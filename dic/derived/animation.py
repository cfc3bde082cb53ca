"""An animation of a measured field: one frame for each image of a series, all on one scale."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from dic.derived.deformed_images import deformed_image
from dic.derived.export import ExportSource, sources_of
from dic.errors import CorrelationError
from dic.pictures.animation import animation_writer, colours_of
from dic.pictures.background import view_of
from dic.pictures.contact_sheet import shortened
from dic.pictures.maps import MapDrawer
from dic.pictures.panels import Maps, Scale, finished, maps_of, widened
from dic.pictures.settings import MapSettings
from dic.pipeline.measured_images import CameraView, MeasuredImage, only_camera
from dic.pipeline.result_file import Loaded, Results, with_results
from dic.typing import Grey, PathLike

_DEFAULT = MapSettings(quantities=("eyy",), width_mm=120.0)


@dataclass(frozen=True)
class Animation:
    """The number of frames of an animation that was written, and the images that could not be measured.

    Attributes
    ----------
    frames : int
        Number of frames, one for each image.
    failures : list of str
        One sentence for each image that could not be measured. The frame of such an image says so.
    """

    frames: int
    failures: list[str]


def write_animation(
    results: Results,
    path: PathLike,
    *,
    settings: MapSettings | None = None,
    frames_per_s: float = 5.0,
    camera: str | None = None,
    known: Sequence[Mapping[str, Any]] = (),
    on_image: Callable[[int], None] = lambda total: None,
) -> Animation:
    """Write an animation of maps: one frame for each image, all with the same scale, size and view.

    The title of a frame names the image, its number, and its load and time where they are known. Memory does
    not depend on the number of images: each image is read twice, first for the scale and then for its frame.

    Parameters
    ----------
    results : path, MeasuredSeries, SeriesResult or RunResult
        A result file of `dic correlate` or `dic process`, or results that `dic` has read or computed.
    path : path
        The ending gives the format: .gif, or .mp4 if the OpenCV of this computer can write it.
    settings : MapSettings, optional
        Default: eyy on the reference image, 120 mm wide. With `on="deformed"` each frame shows its own image,
        which is read from the image file or from the run file.
    frames_per_s : float
        From 0.01 to 50.
    camera : str, optional
        Camera of a run; needed if the run has several.
    known : sequence of mapping, optional
        Values to show in the titles, for each image of the series: `load_n` and `time_s`, such as
        `GaugeImage.known` after `join_record`. The steps of a run have these values already.
    on_image : callable, optional
        Called with the number of all images, after each image that was read.

    Raises
    ------
    CorrelationError
        If no image has values of this kind.
    OutputError
        If the format or the number of frames is not possible.
    OSError
        If the animation cannot be written, or an image cannot be read.
    RunFileError
        If the results cannot be read, or the camera must be chosen.
    """
    how = _How(settings or _DEFAULT, frames_per_s, known, on_image)
    work = partial(_write, path=path, camera=camera, how=how)
    return with_results(results, work, local_strain=True)


@dataclass(frozen=True)
class _How:
    """How an animation is drawn."""

    settings: MapSettings
    per_s: float
    known: Sequence[Mapping[str, Any]]
    on_image: Callable[[int], None]


def _write(results: Loaded, path: PathLike, camera: str | None, how: _How) -> Animation:
    view = only_camera(results.views, camera, "results")
    (source,) = sources_of(results, view.camera or None)
    settings, source = how.settings, _with_known(source, how.known)
    reference, image_of = _images_of(results, view, settings)
    total = 2 * len(source.images)
    with animation_writer(path, how.per_s, colours_of(settings)) as add:
        whole = _whole(source, settings, lambda: how.on_image(total))
        failures, drawer = list[str](), MapDrawer(settings)
        for k, image in enumerate(source.images):
            title, grey, maps = _title(k, source, image), reference, whole.without_values()
            if image.measurement is None:
                title = f"{title} · not measured"
                failures.append(f"{image.failure}")
            else:
                grey, maps = image_of(k), maps_of(image.measurement, settings, image.correction)
            add(drawer.draw(whole.framed(maps), grey, title, whole.scale).pixels())
            how.on_image(total)
    return Animation(len(source.images), failures)


def _with_known(source: ExportSource, known: Sequence[Mapping[str, Any]]) -> ExportSource:
    """Return the source with further known values of each image."""
    if not known:
        return source
    if len(known) != len(source.images):
        expected, remedy = f"values of {len(source.images)} images", "give those of all images, or none"
        raise CorrelationError("results", "draw an animation", expected, str(len(known)), remedy)
    return replace(source, known=[dict(each) for each in known])


def _images_of(
    results: Loaded, view: CameraView, settings: MapSettings
) -> tuple[Grey, Callable[[int], Grey]]:
    """Return the reference image, and a function that returns the image under the k-th map."""
    reference = view.series.reference
    if settings.on == "reference":
        return reference, lambda k: reference
    return reference, partial(deformed_image, results, view)


@dataclass
class _Whole:
    """Data common to all frames: scale, range of the values, view, and maps of the first image."""

    scale: Scale
    reach: dict[str, tuple[float, float]]
    first: Maps
    view: tuple[float, float, float, float]

    def framed(self, maps: Maps) -> Maps:
        """Return the maps of an image in the view of all frames, with the same colour bar."""
        panels = tuple(replace(panel, reach=self.reach.get(panel.quantity)) for panel in maps.panels)
        return Maps(panels, replace(maps.places, view=self.view))

    def without_values(self) -> Maps:
        """Return maps without any value."""
        panels = (replace(panel, values=np.full_like(panel.values, np.nan)) for panel in self.first.panels)
        return replace(self.first, panels=tuple(panels))


def _whole(source: ExportSource, settings: MapSettings, count: Callable[[], None]) -> _Whole:
    """Read all images once, and return the data that are common to all frames.

    Raises `CorrelationError` if no image has a value.
    """
    scale: Scale = {}
    reach: dict[str, tuple[float, float]] = {}
    first: Maps | None = None
    corners = []
    for image in source.images:
        count()
        if image.measurement is None:
            continue
        maps = maps_of(image.measurement, settings, image.correction)
        scale, first = widened(scale, maps), first or maps
        for panel in maps.panels:
            if panel.span is not None:
                low, high = reach.get(panel.quantity, panel.ends)
                reach[panel.quantity] = min(low, panel.ends[0]), max(high, panel.ends[1])
        drawn = maps.places.drawn_corners().reshape(-1, 2)
        corners += [drawn.min(axis=0), drawn.max(axis=0)]
    if first is None or not scale:
        what = ", ".join(settings.quantities)
        kind = "" if settings.kind == "best" else f"{settings.kind} "
        expected, remedy = f"an image with {kind}values of {what}", "choose another kind or another quantity"
        raise CorrelationError("results", "draw an animation", expected, "none", remedy)
    return _Whole(finished(scale, settings), reach, first, view_of(np.array(corners)))


def _title(k: int, source: ExportSource, image: MeasuredImage) -> str:
    """Return the name and the number of an image, and the load and the time where they are known."""
    known = source.known[k] if k < len(source.known) else image.time.as_dict()
    name = shortened(str(known.get("step") or image.label))
    parts = [name, f"{k + 1} of {len(source.images)}"]
    for key, unit, digits in (("load_n", "N", 0), ("time_s", "s", 1)):
        value = known.get(key)
        # Do not show the time of the last change of a file, because it may not be the time of the exposure.
        wrong = key == "time_s" and known.get("time_source") == "file"
        if value is not None and np.isfinite(value) and not wrong:
            parts.append(f"{value:z.{digits}f} {unit}")
    return " · ".join(parts)
