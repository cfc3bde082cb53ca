"""How a simulated camera draws its pictures: exactly, or fast from pictures that are prepared beforehand."""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from typing import Any, Protocol
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DeviceFault
from simulators.rig.camera_settings import CameraSettings
from simulators.rig.light import Light
from simulators.rig.picture_store import PictureStore
from simulators.scene.prepared import (
    UNIT,
    BeyondPictureError,
    Moments,
    PreparedPicture,
    points_of,
)
from simulators.scene.render import render
from simulators.scene.scene import Surface
from simulators.scene.torn import Torn
from simulators.scene.warp import Exposing, PixelMap, expose, light_of

Image = NDArray[np.uint8] | NDArray[np.uint16]
_NOISE_VALUES = 1 << 22
_LONG = 4_000_000
"""Number of points of a picture whose preparation takes so long that the user is told of it."""


class Painter(Protocol):
    """Draws the pictures of one camera."""

    def paint(self, moments: Moments, light: Light, number: int) -> Image:
        """Return the grey levels of frame `number`, which shows the mean of several moments."""


class ExactPainter:
    """Integrates the light over each pixel, and draws new noise for each frame.

    The noise depends only on `seed`, on the camera's `name` and on the frame's number.
    """

    def __init__(self, settings: CameraSettings, seed: int, name: str) -> None:
        self._settings, self._seed = settings, [seed, crc32(name.encode())]
        self._optics, self._sensor = settings.optics(), settings.sensor()

    def paint(self, moments: Moments, light: Light, number: int) -> Image:
        """Return the grey levels of frame `number`."""
        return self.expose(
            sum(share * render(self._optics, surface) for share, surface in moments), light, number
        )

    def expose(self, reflectance: Any, light: Light, number: int) -> Image:
        """Return the grey levels of frame `number` for reflectances, shape (height, width)."""
        rng = np.random.default_rng([*self._seed, number])
        settings = self._settings
        return self._sensor.expose(light.on(reflectance), settings.exposure_us, settings.gain, rng)


class PreparedPainter:
    """Draws from a prepared picture of the specimen and one of the grid, with noise that is prepared too.

    A picture is prepared when it is needed for the first time, and anew when the specimen has moved so far
    that the camera sees material beyond its margin.

    Parameters
    ----------
    settings : CameraSettings
    seed : int
    name : str
        Name of the camera.
    margin_px : int
    store : PictureStore or None
        Where prepared pictures are kept for later.
    say : callable
        ``say(line)`` is called with lines about the preparation.
    """

    def __init__(
        self,
        settings: CameraSettings,
        seed: int,
        name: str,
        margin_px: int,
        store: PictureStore | None,
        say: Callable[[str], None],
    ) -> None:
        self._exact = ExactPainter(settings, seed, name)
        self._settings, self._seed, self._name = settings, [seed, crc32(name.encode())], name
        self._margin_px, self._store, self._say = margin_px, store, say
        self._optics, self._sensor = settings.optics(), settings.sensor()
        self._pictures: list[PreparedPicture] = []
        self._noise = noise_of(seed)

    def prepare(self, surface: Surface) -> PreparedPicture:
        """Prepare the picture of a surface, or load it, and use it from now on for this texture."""
        if isinstance(surface.texture, Torn):
            surface = replace(surface, texture=surface.texture.whole)
        picture = None if self._store is None else self._store.load(self._optics, surface, self._margin_px)
        if picture is None:
            picture = PreparedPicture.prepare(self._optics, surface, self._margin_px, self._tell())
            if self._store is not None:
                self._store.keep(picture)
        self._pictures = [picture, *(each for each in self._pictures if not each.shows(surface.texture))]
        return picture

    def paint(self, moments: Moments, light: Light, number: int) -> Image:
        """Return the grey levels of frame `number`."""
        picture, where = self._find(moments)
        settings = self._settings
        if not light.keeps_sharp:
            mean = np.empty((settings.height_px, settings.width_px), np.float32)
            light_of(picture.fine, where, mean)
            return self._exact.expose(mean.astype(np.float64) / UNIT, light, number)
        image = np.empty(
            (settings.height_px, settings.width_px), np.uint8 if settings.bits == 8 else np.uint16
        )
        shading = light.shading(settings.height_px, settings.width_px, UNIT)
        expose(picture.fine, where, shading, self._exposing(number), image)
        return image

    def _find(self, moments: Moments) -> tuple[PreparedPicture, PixelMap]:
        """Return the picture that shows all moments, and the place of each pixel in it."""
        _, middle = moments[len(moments) // 2]
        for picture in self._pictures:
            if picture.shows(middle.texture):
                try:
                    return picture, picture.where(moments)
                except BeyondPictureError:
                    break
        picture = self.prepare(middle)
        try:
            return picture, picture.where(moments)
        except BeyondPictureError:
            raise DeviceFault(
                self._name,
                "draw a frame",
                f"a motion of less than {self._margin_px} px during one exposure",
                "a longer one",
                "raise margin_px in [simulation.prepared], or move more slowly",
            ) from None

    def _exposing(self, number: int) -> Exposing:
        settings, sensor = self._settings, self._sensor
        rng = np.random.default_rng([*self._seed, number])
        return Exposing(
            electrons=sensor.full_well_e * settings.exposure_us / sensor.saturation_exposure_us / UNIT,
            dark_e2=sensor.read_noise_e**2,
            full_e=sensor.full_well_e,
            grey_per_e=settings.gain * sensor.highest_grey / sensor.full_well_e,
            highest_grey=float(sensor.highest_grey),
            noise=self._noise,
            noise_from=rng.integers(0, len(self._noise) - settings.width_px, settings.height_px),
        )

    def _tell(self) -> Callable[[float], None]:
        """Return a function that says each quarter of a preparation which takes long."""
        if math.prod(points_of(self._optics, self._margin_px)) < _LONG:
            return lambda part: None
        told = 0

        def tell(part: float) -> None:
            nonlocal told
            if int(4 * part) > told:
                told = int(4 * part)
                self._say(f"{self._name}: {25 * told} % of a picture is prepared")

        return tell


@lru_cache(maxsize=1)
def noise_of(seed: int) -> NDArray[np.float32]:
    """Return prepared values of a normal distribution. Each row of each frame begins elsewhere in them."""
    return np.random.default_rng(seed).standard_normal(_NOISE_VALUES, dtype=np.float32)
