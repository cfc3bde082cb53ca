"""Maps of displacement and strain, drawn over the reference or the deformed image."""

from typing import Any

from numpy.typing import NDArray

from dic.errors import MEASURE_FIRST, require_kind
from dic.image.given import grey_image
from dic.out_of_plane.correction import Correction
from dic.pictures.background import Background, background_of
from dic.pictures.frames import draw_axes, draw_bar, draw_title
from dic.pictures.layout import PanelLayout
from dic.pictures.marks import MARGIN_MM
from dic.pictures.page import Page
from dic.pictures.painting import Latest, Painter
from dic.pictures.panels import Maps, Panel, Scale, in_readable_unit, maps_of, scale_of
from dic.pictures.settings import MapSettings
from dic.strain.measurement import Measurement
from dic.typing import ImageLike, PathLike


def write_maps(
    measurement: Measurement,
    image: ImageLike,
    path: PathLike,
    *,
    title: str | None = None,
    correction: Correction | None = None,
    settings: MapSettings | None = None,
    scale: Scale | None = None,
) -> None:
    """Write one picture with the maps of a measurement: two displacements and three strains.

    Parameters
    ----------
    measurement : Measurement
    image : ndarray, shape (height, width), or path
        The image under the maps: the reference image, or the deformed image if `settings.on` says so.
    path : path
        The file to write. The suffix of the file name determines the format, such as .png, .pdf or .svg.
    title : str, optional
        Title of the picture. Default: the measurement's label.
    correction : Correction, optional
        Correction of the measurement. If the image was corrected, the maps show corrected values instead of
        calibrated values.
    settings : MapSettings, optional
    scale : mapping, optional
        Lower and upper end of the colour scale of each quantity, for example from `dic.pictures.map_scale`.
        Default: the 1st to the 99th percentile of this image.

    Raises
    ------
    MeasurementError
        If an argument has the wrong type, or the settings ask for axes in mm without a calibration.
    OSError
        If the file cannot be written.
    """
    require_kind("measurement", measurement, Measurement, MEASURE_FIRST)
    settings = settings or MapSettings()
    grey = grey_image(image, "image under the maps")
    maps = maps_of(measurement, settings, correction)
    scale = scale_of([maps], settings) if scale is None else scale
    title = measurement.label if title is None else title
    MapDrawer(settings).draw(maps, grey, title, scale).write(path)


class MapDrawer:
    """Draws the maps of images, one after the other; what images share is computed once.

    Parameters
    ----------
    settings : MapSettings
    """

    def __init__(self, settings: MapSettings) -> None:
        self._settings = settings
        self._painter = Painter(settings)
        self._background = Latest[Background]()

    def draw(self, maps: Maps, image: NDArray[Any], title: str, scale: Scale) -> Page:
        """Return a page with all maps of one image, laid out by the shape of the specimen."""
        places, settings = maps.places, self._settings
        inputs = image, places.corners, places.to_axes, places.unit, places.view
        background = self._background.of(inputs, lambda: background_of(image, places))
        panels, scale = in_readable_unit(maps.panels, scale)
        layout = PanelLayout.fitting(
            len(panels),
            settings.width_mm,
            settings.dpi,
            background.aspect,
            ticks=places.unit is not None,
            title=bool(title),
        )
        page = layout.new_page()
        if title:
            page.add_title(title, MARGIN_MM)
        self._painter.begin(places, background, panels, layout.panel(0))
        for index, panel in enumerate(panels):
            place, power = layout.panel(index), ""
            if places.unit is not None:
                draw_axes(page, place, background.extent, places.unit, layout.is_outer(index))
            if self._painter.draw(page, place, panel, scale):
                ends, cut = scale[panel.quantity], cut_ends([panel], scale)
                power = draw_bar(page, layout.bar(index), ends, cut, settings)
            draw_title(page, layout, index, f"{panel.name}, {power}{panel.unit}")
        return page


def cut_ends(panels: list[Panel], scale: Scale) -> str:
    """Return at which ends values exceed the scale: "neither", "min", "max" or "both"."""
    low, high = scale[panels[0].quantity]
    least = min(panel.ends[0] for panel in panels)
    most = max(panel.ends[1] for panel in panels)
    return {(False, False): "neither", (True, False): "min", (False, True): "max", (True, True): "both"}[
        least < low, most > high
    ]
