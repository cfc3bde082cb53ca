"""Draws the picture of a printed target on its plate, as a camera would see it on a bench.

The sheet is the one that `dic target` draws. The simulators' camera sees it on a plate of aluminium in front
of a dark bench.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import cv2
import numpy as np
from numpy.typing import NDArray

from simulators.scene.optics import PinholeCamera
from simulators.scene.pose import Pose
from simulators.scene.render import render
from simulators.scene.scene import Surface
from simulators.scene.texture import Texture

Array = NDArray[np.float64]

# Half width and half height of the plate, its thickness, and its distance from the bench behind it.
_PLATE_MM = np.array([172.0, 128.0])
_THICKNESS_MM, _TO_BENCH_MM = 8.0, 45.0
# Where the shadow falls on the bench, and how soft it is.
_SHADOW_MM, _SOFT_MM = np.array([-30.0, -42.0]), 16.0
_SCREW_MM, _SCREW_RADIUS_MM = np.array([158.0, 114.0]), 5.0
_CAMERA = PinholeCamera(1000, 750, focal_px=2300.0, distance_mm=1000.0, pan_deg=30.0, tilt_deg=14.0)


@dataclass(frozen=True)
class _Plate:
    """The outline of the plate: 1 on the plate, 0 beside it."""

    quadrature_order: ClassVar[int] = 4

    def reflectance(self, points_mm: Array) -> Array:
        return (np.abs(points_mm) < _PLATE_MM).all(axis=1).astype(np.float64)


@dataclass(frozen=True)
class _Front:
    """The front of the plate: brushed aluminium, four screws, and the sheet in the middle."""

    sheet: NDArray[np.uint8]
    px_per_mm: float
    brushed: Array
    quadrature_order: ClassVar[int] = 4

    def reflectance(self, points_mm: Array) -> Array:
        x, y = points_mm.T
        across = np.linspace(-_PLATE_MM[1], _PLATE_MM[1], len(self.brushed))
        light = 0.34 + 0.05 * np.interp(y + 0.004 * x, across, self.brushed)
        # A lamp is reflected as a band across the direction of the brush.
        light += 0.22 * np.exp(-(((x - 95.0 + 0.2 * y) / 60.0) ** 2))
        away = np.abs(points_mm) - _SCREW_MM
        radius = np.hypot(*away.T)
        slot = (np.abs(away[:, 0] - 0.6 * away[:, 1]) < 0.9) & (radius < 0.8 * _SCREW_RADIUS_MM)
        light = np.where(radius < _SCREW_RADIUS_MM, 0.62 - 0.05 * away[:, 1], light)
        light = np.where((radius >= _SCREW_RADIUS_MM) & (radius < 1.2 * _SCREW_RADIUS_MM), 0.14, light)
        light[slot] = 0.08
        height, width = self.sheet.shape
        column, row = x * self.px_per_mm + (width - 1) / 2, (height - 1) / 2 - y * self.px_per_mm
        level = _looked_up(self.sheet, column, row, cv2.BORDER_REPLICATE)
        on_sheet = (column > 0) & (column < width - 1) & (row > 0) & (row < height - 1)
        return np.where(on_sheet, 0.05 + 0.75 * level / 255.0, light)


@dataclass(frozen=True)
class _Bench:
    """A dark bench with a grain, and the shadow of the plate."""

    grain: NDArray[np.float32]
    quadrature_order: ClassVar[int] = 2

    def reflectance(self, points_mm: Array) -> Array:
        across, up = (points_mm * [1.0, 4.0]).T
        grain = _looked_up(self.grain, across, up, cv2.BORDER_WRAP)
        outside = (np.abs(points_mm - _SHADOW_MM) - _PLATE_MM).max(axis=1)
        lit = 1.0 / (1.0 + np.exp(-outside / (_SOFT_MM / 2)))
        return (0.13 + 0.025 * grain) * (0.3 + 0.7 * lit)


def _looked_up(picture: NDArray[Any], column: Array, row: Array, border: int) -> Array:
    """Return the values (n,) of a picture at places between its pixels; the rays come in whole rows."""
    places = [each.astype(np.float32).reshape(-1, _CAMERA.width_px) for each in (column, row)]
    values = cv2.remap(picture, *places, cv2.INTER_LINEAR, borderMode=border)
    return np.asarray(values, np.float64).ravel()


def photograph(sheet: Path, dpi: float) -> NDArray[np.uint8]:
    """Return the picture of a sheet that was printed at its true size, glued to a plate, 33° off-axis."""
    rng = np.random.default_rng(13)
    grain = cv2.GaussianBlur(rng.normal(size=(700, 700)), (0, 0), sigmaX=6.0, sigmaY=1.0)
    brushed = cv2.GaussianBlur(rng.normal(size=(1200, 1)), (0, 0), 1.2)[:, 0]
    drawn = cv2.imread(str(sheet), cv2.IMREAD_GRAYSCALE)
    if drawn is None:
        raise FileNotFoundError(sheet)
    front = _at(_Front(np.asarray(drawn, np.uint8), dpi / 25.4, brushed / brushed.std()), 0.0)
    bench = _at(_Bench((grain / grain.std()).astype(np.float32)), -_THICKNESS_MM - _TO_BENCH_MM)
    on_front = _at(_Plate(), 0.0)
    # The rim of the plate is seen between the outlines of its front and its back.
    solid = np.maximum(on_front, np.maximum(_at(_Plate(), -_THICKNESS_MM), _at(_Plate(), -_THICKNESS_MM / 2)))
    light = on_front * front + (solid - on_front) * 0.2 + (1.0 - solid) * bench
    y, x = np.mgrid[: _CAMERA.height_px, : _CAMERA.width_px] / _CAMERA.width_px - 0.5
    # A lamp at the upper right, and the lens's loss of light towards the corners.
    light *= (1.05 + 0.35 * x - 0.25 * y) / (1.0 + 0.6 * (x**2 + (y + 0.125) ** 2)) ** 2
    grey = 235.0 * cv2.GaussianBlur(light, (0, 0), 0.8)
    noisy = grey + rng.normal(size=grey.shape) * np.sqrt(2.0 + 0.04 * grey)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def _at(texture: Texture, z_mm: float) -> Array:
    """Return what the camera sees of a plane parallel to the sheet, at the height z."""
    return render(_CAMERA, Surface(texture, Pose(translation_mm=np.array([0.0, 0.0, z_mm]))))
