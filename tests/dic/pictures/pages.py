"""Draw maps on a page, and find places of the image on it."""

import numpy as np

import dic
from dic.pictures.background import background_of
from dic.pictures.maps import MapDrawer
from dic.pictures.page import Page
from dic.pictures.panels import Maps, maps_of, scale_of


def drawn(measurement, image, title="", scale=None, **settings) -> tuple[Page, Maps]:
    """Return the page of a measurement's maps, and the maps."""
    how = dic.pictures.MapSettings(**settings)
    maps = maps_of(measurement, how)
    scale = scale_of([maps], how) if scale is None else scale
    return MapDrawer(how).draw(maps, image, title, scale), maps


def maps_on(page: Page) -> list:
    """Return the places of the maps of a page, which are higher than its colour bars."""
    return [place for place, _ in page.pictures if place.height > 3.0]


def pixel_at(page: Page, place, background, x: float, y: float) -> tuple[int, int]:
    """Return row and column of the page's pixel at a place of the axes in one of its maps."""
    left, right, lower, upper = background.extent
    across = place.left + (x - left) / (right - left) * place.width
    down = place.top + (y - upper) / (lower - upper) * place.height
    return int(down / 25.4 * page.dpi), int(across / 25.4 * page.dpi)


def colours_at(page: Page, maps: Maps, image: np.ndarray, places, index: int = 0) -> np.ndarray:
    """Return the colours of a page at places (x, y) of the axes of one of its maps, shape (n, 3)."""
    background, pixels = background_of(image, maps.places), page.pixels()
    at = [pixel_at(page, maps_on(page)[index], background, x, y) for x, y in places]
    return np.array([pixels[row, column] for row, column in at], int)
