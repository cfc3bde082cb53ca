"""Draws the maps of a series on one colour scale; memory does not grow with the number of images."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from dic.errors import MeasurementError
from dic.files.lazy import Spool
from dic.image.read import read_image
from dic.out_of_plane.correction import Correction
from dic.pictures.contact_sheet import draw_contact_sheet, shown_of
from dic.pictures.maps import MapDrawer
from dic.pictures.panels import Maps, Scale, finished, maps_of, scale_of, widened
from dic.pictures.settings import MapSettings
from dic.strain.measurement import Measurement
from dic.typing import Grey


@dataclass(frozen=True)
class MapFiles:
    """Paths of the pictures of a series."""

    maps: Sequence[Path]
    """The picture of each image; empty for no pictures."""
    sheets: Mapping[str, Path]
    """The file of each contact sheet, keyed by its quantity."""

    def all(self) -> list[Path]:
        """Return the paths of all pictures."""
        return [*self.maps, *self.sheets.values()]


@dataclass(frozen=True)
class _Waiting:
    number: int
    label: str
    title: str
    maps: Maps | None
    """Maps for the picture of the image, if it is not drawn yet."""
    small: Maps | None
    """Maps for the contact sheets, if there are any."""


class SeriesMaps:
    """Draw the maps of a series of image files.

    A scale for all images is known only after the last image. Until then the values are in a temporary file.
    If the images have separate scales, each picture is drawn at once. A picture that cannot be drawn does not
    end the measurement: `draw` raises the error after all other pictures are drawn.

    Parameters
    ----------
    reference : ndarray, shape (height, width)
    files : MapFiles
    settings : MapSettings
    """

    def __init__(self, reference: Grey, files: MapFiles, settings: MapSettings) -> None:
        self._reference, self._files, self._settings = reference, files, settings
        self._small = replace(settings, quantities=tuple(files.sheets) or ("eyy",), on="reference")
        self._drawer = MapDrawer(settings)
        self._at_once = bool(files.maps) and settings.scale == "image"
        self._waiting = Spool[_Waiting]()
        self._failed: dict[int, MeasurementError | OSError] = {}

    def add(self, number: int, title: str, measurement: Measurement, correction: Correction | None) -> None:
        """Add the maps of an image; `number` is the index of the image in the series, from 0.

        The label of the measurement must be the path of the image file. If an image is added again, for
        example after a correction, the new maps replace the earlier ones.
        """
        if not self._files.all():
            return
        self._failed.pop(number, None)
        try:
            self._add(number, title, measurement, correction)
        except (MeasurementError, OSError) as error:
            self._failed[number] = error

    def _add(self, number: int, title: str, measurement: Measurement, correction: Correction | None) -> None:
        sheets = bool(self._files.sheets)
        maps = maps_of(measurement, self._settings, correction) if self._files.maps else None
        small = maps_of(measurement, self._small, correction) if sheets else None
        waiting = _Waiting(number, measurement.label, title, maps, small)
        if self._at_once and maps is not None:
            self._draw_maps(waiting, maps, scale_of([maps], self._settings))
            waiting = replace(waiting, maps=None)
        if sheets or not self._at_once:
            self._waiting.put(number, waiting)

    @property
    def pictures_left(self) -> int:
        """Number of pictures that `draw` will try to write."""
        if not len(self._waiting):
            return len(self._failed)
        return len(self._failed) + len(self._files.sheets) + (len(self._waiting) if self._maps_wait else 0)

    @property
    def _maps_wait(self) -> bool:
        return bool(self._files.maps) and not self._at_once

    def draw(self, on_picture: Callable[[], None] = lambda: None) -> None:
        """Write all pictures that need the scale of the whole series. Call `on_picture` after each.

        Raises
        ------
        MeasurementError, OSError
            The error of the first picture that could not be drawn.
        """
        of_maps: Scale = {}
        of_sheets: Scale = {}
        for waiting in self._waiting:
            of_maps = of_maps if waiting.maps is None else widened(of_maps, waiting.maps)
            of_sheets = of_sheets if waiting.small is None else widened(of_sheets, waiting.small)
        shown = set(shown_of(len(self._waiting)))
        small: list[tuple[str, Maps]] = []
        for index, waiting in enumerate(self._waiting):
            if waiting.maps is not None:
                self._draw_maps(waiting, waiting.maps, finished(of_maps, self._settings))
                on_picture()
            if waiting.small is not None and index in shown:
                small.append((waiting.label, waiting.small))
        for quantity, path in self._files.sheets.items() if small else ():
            chosen = [(label, maps.only({quantity})) for label, maps in small]
            self._draw_sheet(path, chosen, finished(of_sheets, self._small))
            on_picture()
        if self._failed:
            raise next(iter(self._failed.values()))

    def _draw_maps(self, waiting: _Waiting, maps: Maps, scale: Scale) -> None:
        settings = self._settings
        image = self._reference if settings.on == "reference" else read_image(waiting.label)
        page = self._drawer.draw(maps, image, waiting.title, scale)
        page.write(self._files.maps[waiting.number])

    def _draw_sheet(self, path: Path, images: Sequence[tuple[str, Maps]], scale: Scale) -> None:
        page = draw_contact_sheet(images, self._reference, len(self._waiting), self._small, scale)
        page.write(path)
