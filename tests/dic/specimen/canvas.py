"""Draw images of specimens in a laboratory: speckled surfaces, other objects, light and a camera.

This module uses no code of `dic`. Outlines are drawn on a grid three times finer than the pixels and then
averaged, so the mask of the specimen is exact to a fraction of a pixel.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np

FINE = 3
"""Number of fine pixels along the side of a pixel."""

_BITS = 4
"""Number of fractional bits of OpenCV's coordinates."""


@dataclass(frozen=True)
class Speckles:
    """Paint with round dots of random size at random places.

    `dots` and `ground` are reflectances; `radius_px` is the mean radius; `coverage` is the share of the
    surface that dots cover. `squeeze` is the factor by which an oblique view shortens the pattern along x.
    """

    radius_px: float = 2.2
    coverage: float = 0.5
    dots: float = 0.1
    ground: float = 0.8
    squeeze: float = 1.0


@dataclass
class Canvas:
    """The scene in front of the camera, as reflectances on a grid three times finer than the pixels.

    `shift_px` moves the specimen relative to all other objects. The array `specimen` is 1 where the specimen
    is visible.
    """

    shape: tuple[int, int]
    shift_px: tuple[float, float] = (0.0, 0.0)
    grey: np.ndarray = field(init=False)
    specimen: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        fine = self.shape[0] * FINE, self.shape[1] * FINE
        self.grey, self.specimen = np.zeros(fine, np.float32), np.zeros(fine, np.uint8)

    def fill(self, reflectance: np.ndarray | float) -> None:
        self.grey[:] = _enlarged(reflectance, self.grey.shape)

    def shade(self, outline: np.ndarray, reflectance: np.ndarray | float) -> None:
        """Draw an object that is not the specimen; its outline has corners (x, y), px."""
        inside = self._inside([outline])
        self.grey[inside] = _enlarged(reflectance, self.grey.shape)[inside]
        self.specimen[inside] = 0

    def line(self, places: np.ndarray, width_px: float, reflectance: float) -> None:
        """Draw a cable or a mark as a line through places (x, y), px."""
        inside = np.zeros_like(self.specimen)
        places = np.round(np.asarray(places) * FINE * 2**_BITS).astype(np.int32)
        cv2.polylines(inside, [places], False, 1, max(1, round(width_px * FINE)), cv2.LINE_8, _BITS)
        self.grey[inside > 0], self.specimen[inside > 0] = reflectance, 0

    def print(self, words: str, place: tuple[float, float], height_px: float, reflectance: float) -> None:
        """Draw a text whose lower left corner is at `place`."""
        inside = np.zeros_like(self.specimen)
        at, size = (round(place[0] * FINE), round(place[1] * FINE)), height_px * FINE / 22.0
        cv2.putText(inside, words, at, cv2.FONT_HERSHEY_SIMPLEX, size, 1, max(1, round(2.5 * size)))
        self.grey[inside > 0], self.specimen[inside > 0] = reflectance, 0

    def soften(self, blur_px: float) -> None:
        """Blur everything that has been drawn so far."""
        self.grey = cv2.GaussianBlur(self.grey, (0, 0), blur_px * FINE)

    def paint(
        self,
        outlines: Sequence[np.ndarray],
        speckles: Speckles,
        rng: np.random.Generator,
        light: np.ndarray | float = 1.0,
    ) -> None:
        """Draw a specimen with speckles; each further outline inside the first one is a hole."""
        moved = [np.asarray(outline) + self.shift_px for outline in outlines]
        inside = self._inside(moved)
        grey = self._speckled(speckles, rng) * _enlarged(light, self.grey.shape)
        self.grey[inside], self.specimen[inside] = grey[inside], 1

    def mask(self) -> np.ndarray:
        """Return the pixels of which at least half shows the specimen."""
        size = self.shape[::-1]
        return cv2.resize(self.specimen.astype(np.float32), size, interpolation=cv2.INTER_AREA) >= 0.5

    def _inside(self, outlines: Sequence[np.ndarray]) -> np.ndarray:
        drawn = np.zeros(self.grey.shape, np.uint8)
        corners = [np.round(np.asarray(one) * FINE * 2**_BITS).astype(np.int32) for one in outlines]
        cv2.fillPoly(drawn, corners, 1, cv2.LINE_8, _BITS)
        return drawn > 0

    def _speckled(self, speckles: Speckles, rng: np.random.Generator) -> np.ndarray:
        height, width = self.shape
        area = np.pi * speckles.radius_px**2 * speckles.squeeze
        count = int(-np.log(1.0 - speckles.coverage) * (height + 20) * (width + 20) / area)
        places = rng.uniform(-10, [width + 10, height + 10], (count, 2)) + self.shift_px
        radii = speckles.radius_px * rng.uniform(0.6, 1.4, count)
        dots = np.zeros(self.grey.shape, np.uint8)
        places, scale = np.round(places * FINE * 2**_BITS).astype(int), FINE * 2**_BITS
        for (x, y), radius in zip(places.tolist(), radii.tolist(), strict=True):
            axes = (max(1, round(radius * speckles.squeeze * scale)), max(1, round(radius * scale)))
            cv2.ellipse(dots, (x, y), axes, 0, 0, 360, 1, -1, cv2.LINE_8, _BITS)
        return np.where(dots > 0, speckles.dots, speckles.ground).astype(np.float32)


@dataclass(frozen=True)
class Camera:
    """A camera that turns reflectances into grey levels of 8 bit.

    `white` is the grey level of reflectance 1; `photon_noise` is the standard deviation of the noise at grey
    level 200, in grey levels, and `read_noise` is the noise without light. `jpeg` is the quality of a JPEG
    file, or 0 for a file without loss.
    """

    white: float = 220.0
    black: float = 6.0
    blur_px: float = 0.7
    photon_noise: float = 1.5
    read_noise: float = 0.7
    jpeg: int = 0

    def take(self, canvas: Canvas, light: np.ndarray | float, rng: np.random.Generator) -> np.ndarray:
        """Return the picture, float32, shape (height, width); `light` multiplies the reflectances."""
        lit = canvas.grey * _enlarged(light, canvas.grey.shape)
        blurred = cv2.GaussianBlur(lit, (0, 0), self.blur_px * FINE)
        grey = self.white * cv2.resize(blurred, canvas.shape[::-1], interpolation=cv2.INTER_AREA)
        variance = self.read_noise**2 + self.photon_noise**2 * np.maximum(grey, 0.0) / 200.0
        grey = self.black + grey + np.sqrt(variance) * rng.normal(size=grey.shape)
        levels = np.clip(np.round(grey), 0, 255).astype(np.uint8)
        if self.jpeg:
            _, packed = cv2.imencode(".jpg", levels, [cv2.IMWRITE_JPEG_QUALITY, self.jpeg])
            levels = cv2.imdecode(packed, cv2.IMREAD_GRAYSCALE)
        return levels.astype(np.float32)


def uneven(
    rng: np.random.Generator, shape: tuple[int, int], scale_px: float, low: float, high: float
) -> np.ndarray:
    """Return smooth random values between `low` and `high`, with details of `scale_px`."""
    rough = rng.normal(size=(shape[0] // 2 + 1, shape[1] // 2 + 1)).astype(np.float32)
    smooth = cv2.GaussianBlur(rough, (0, 0), scale_px / 2, borderType=cv2.BORDER_REFLECT)
    smooth = cv2.resize(smooth, shape[::-1], interpolation=cv2.INTER_CUBIC)
    part = (smooth - smooth.min()) / (smooth.max() - smooth.min())
    return (low + (high - low) * part).astype(np.float32)


def brushed(rng: np.random.Generator, shape: tuple[int, int], level: float, depth: float) -> np.ndarray:
    """Return the reflectance of brushed metal: streaks along x."""
    rough = rng.normal(size=shape).astype(np.float32)
    streaks = cv2.GaussianBlur(rough, (0, 0), sigmaX=25.0, sigmaY=0.8)
    return np.clip(level + depth * streaks / streaks.std(), 0.02, 1.2)


def _enlarged(values: np.ndarray | float, shape: tuple[int, ...]) -> np.ndarray:
    if np.ndim(values) == 0:
        return np.full(shape, values, np.float32)
    return np.asarray(cv2.resize(values, shape[::-1], interpolation=cv2.INTER_LINEAR))
