"""A picture that is prepared once, and from which the frames of a moving specimen are drawn fast.

The prepared picture is the specimen's image at one state, with light integrated over the area of a pixel,
at the points of a fine grid. For another state, the exact intersection of rays and surface gives the material
points that the camera sees, and the exact projection gives their place in the prepared picture. So the
positions are those of `simulators.scene.render.render`. What differs is the light between the points, which
is interpolated, and the area of a pixel, which is that of the prepared state.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from os import cpu_count

import numpy as np
from numpy.typing import NDArray

from simulators.scene.optics import FOLD, PinholeCamera
from simulators.scene.render import render_part
from simulators.scene.scene import Surface
from simulators.scene.texture import Texture
from simulators.scene.torn import Torn
from simulators.scene.warp import PixelMap

Array = NDArray[np.float64]

PER_PIXEL = 3
"""Points of a prepared picture per pixel and direction."""
UNIT = 255.0
"""Light of the reflectance 1 in a prepared picture."""
TILE_PX = 64
"""Size of the tiles in which the map of pixels is of second order. With a band they are smaller."""
SMALLEST_TILE_PX = 8
MAP_ERROR_PX = 5e-4
_STEEPEST = 6.0
"""Greatest second derivative of the smooth step of a band's front."""
_REMAINDER = 3**0.5 / 27 / 8
"""A parabola through three points of a tile is off by this factor, times size³ and the third derivative."""
MARGIN_PX = 64
"""Least margin of a prepared picture: the tiles at its edges reach beyond the image."""
_ROWS_AT_ONCE = 64
_LOW = 0.05
"""Sine of the least angle between a ray and the specimen's plane."""

Moments = Sequence[tuple[float, Surface]]
"""What a camera sees during one exposure: surfaces, each with its share of the exposure."""


class BeyondPictureError(Exception):
    """The camera sees material that is outside a prepared picture."""


@dataclass(frozen=True, eq=False)
class PreparedPicture:
    """A specimen or a grid as one camera sees it in one state, from which other states are drawn.

    Attributes
    ----------
    camera : PinholeCamera
    surface : Surface
        The state.
    margin_px : int
        What the picture shows beyond each side of the image.
    fine : ndarray of uint8, shape (rows, columns)
    """

    camera: PinholeCamera
    surface: Surface
    margin_px: int
    fine: NDArray[np.uint8]

    @classmethod
    def prepare(
        cls,
        camera: PinholeCamera,
        surface: Surface,
        margin_px: int,
        tell: Callable[[float], None] = lambda part: None,
    ) -> "PreparedPicture":
        """Draw the picture; `tell` is called with the part (0 to 1) that is done."""
        height, width = points_of(camera, margin_px)
        fine = np.empty((height, width), np.uint8)
        bands = [
            range(first, min(first + _ROWS_AT_ONCE, height)) for first in range(0, height, _ROWS_AT_ONCE)
        ]
        with ThreadPoolExecutor(cpu_count()) as threads:
            drawn = threads.map(lambda rows: _light_at_points(camera, surface, margin_px, rows, width), bands)
            for rows, light in zip(bands, drawn, strict=True):
                fine[rows.start : rows.stop] = light
                tell(rows.stop / height)
        return cls(camera, surface, margin_px, fine)

    def shows(self, texture: Texture) -> bool:
        """Return True if the picture shows this texture, torn or not."""
        whole = texture.whole if isinstance(texture, Torn) else texture
        return whole is self.surface.texture

    def where(self, moments: Moments) -> PixelMap:
        """Return where each pixel is in this picture, at each of the moments.

        Raise `BeyondPictureError` if some pixel is not in the picture.
        """
        tile = min(self._tile_px(surface) for _, surface in moments)
        down, across = self._tiles(tile)
        rays = self._rays(tile)
        nodes = (len(moments), 2 * down + 1, 2 * across + 1)
        columns, rows = np.empty(nodes), np.empty(nodes)
        drawn_at = np.full((len(moments), down, across), -1, np.int32)
        drawn: list[NDArray[np.float32]] = []
        for k, (_, surface) in enumerate(moments):
            material = surface.material(*rays)
            if isinstance(surface.texture, Torn):
                sides = surface.texture.sides(material)
                material = surface.texture.closed(material, sides)
                self._draw_mixed(surface, sides.reshape(nodes[1:]), drawn_at[k], drawn)
            px = self.camera.project(self.surface.world(material))
            points = (px + self.margin_px) * PER_PIXEL
            columns[k], rows[k] = points[:, 0].reshape(nodes[1:]), points[:, 1].reshape(nodes[1:])
        height, width = self.fine.shape
        if min(columns.min(), rows.min()) < 2 or columns.max() > width - 4 or rows.max() > height - 4:
            raise BeyondPictureError
        shares = np.array([share for share, _ in moments])
        tiles = np.stack(drawn) if drawn else np.empty((0, tile, tile), np.float32)
        return PixelMap(columns, rows, shares, drawn_at, tiles)

    def _draw_mixed(
        self,
        surface: Surface,
        sides: NDArray[np.int_],
        drawn_at: NDArray[np.int32],
        drawn: list[NDArray[np.float32]],
    ) -> None:
        """Draw the tiles through which the crack goes exactly, because their map is not smooth.

        `sides` has the sides of the nodes, shape (2 tiles down + 1, 2 tiles across + 1).
        """
        tile = TILE_PX * self._tiles(TILE_PX)[0] // len(drawn_at)
        for row, column in np.ndindex(drawn_at.shape):
            found = sides[2 * row : 2 * row + 3, 2 * column : 2 * column + 3]
            if found.min() == found.max() != 0:
                continue
            drawn_at[row, column] = len(drawn)
            at = np.arange(tile)
            light = render_part(self.camera, surface, row * tile + at, column * tile + at)
            drawn.append((light * UNIT).astype(np.float32))

    def _tile_px(self, surface: Surface) -> int:
        """Return the size of tiles in which a map of second order is accurate enough, also in a front."""
        tile = TILE_PX
        if surface.band is not None:
            front_px = surface.band.front_width_mm * self.camera.focal_px / self.camera.distance_mm
            third = abs(surface.band.strain) * _STEEPEST / front_px**2
            while tile > SMALLEST_TILE_PX and third * _REMAINDER * tile**3 > MAP_ERROR_PX:
                tile //= 2
        return tile

    def _tiles(self, tile: int) -> tuple[int, int]:
        """Return the number of tiles down and across. All sizes of tiles cover the same pixels."""
        per = TILE_PX // tile
        return -(-self.camera.height_px // TILE_PX) * per, -(-self.camera.width_px // TILE_PX) * per

    def _rays(self, tile: int) -> tuple[Array, Array]:
        """Return the rays of the nodes, which are the same in each frame."""
        if tile not in self._known_rays:
            down, across = self._tiles(tile)
            x, y = np.meshgrid(np.arange(2 * across + 1), np.arange(2 * down + 1))
            nodes = np.stack([x, y], axis=-1).reshape(-1, 2) * (tile / 2)
            self._known_rays[tile] = self.camera.ray(np.asarray(nodes, np.float64))
        return self._known_rays[tile]

    @cached_property
    def _known_rays(self) -> dict[int, tuple[Array, Array]]:
        return {}


def points_of(camera: PinholeCamera, margin_px: int) -> tuple[int, int]:
    """Return the number of rows and columns of a prepared picture."""
    height, width = ((side + 2 * margin_px) * PER_PIXEL for side in (camera.height_px, camera.width_px))
    return height, width


def _light_at_points(
    camera: PinholeCamera, surface: Surface, margin_px: int, rows: range, width: int
) -> NDArray[np.uint8]:
    """Return the light of a pixel around each point of some rows of a picture, shape (rows, width)."""
    reach = len(_AREA) // 2
    x = np.arange(-reach, width + reach) / PER_PIXEL - margin_px
    y = np.arange(rows.start - reach, rows.stop + reach) / PER_PIXEL - margin_px
    px = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    at_points = surface.texture.reflectance(surface.material(*camera.ray(px))).reshape(len(y), len(x))
    wide = sum(weight * at_points[:, k : k + width] for k, weight in enumerate(_AREA))
    light = sum(weight * wide[k : k + len(rows)] for k, weight in enumerate(_AREA))
    return np.rint(np.clip(np.asarray(light) * UNIT, 0.0, UNIT)).astype(np.uint8)


def _area_of_a_pixel(side: int) -> Array:
    """Return the weights of five points that integrate light over a pixel of `side` distances of points.

    The second and the fourth moment of the weights are those of a square, less those of the triangle with
    which the interpolation between points smooths in the mean.
    """
    second = side**2 / 12.0 - 1.0 / 6.0
    fourth = -(side**4) / 120.0 + 1.0 / 60.0 + 3.0 * second**2
    outer = (fourth - second) / 24.0
    inner = second / 2.0 - 4.0 * outer
    return np.array([outer, inner, 1.0 - 2.0 * (inner + outer), inner, outer])


_AREA = _area_of_a_pixel(PER_PIXEL)


def can_prepare(camera: PinholeCamera, margin_px: int) -> bool:
    """Return True if the lens has a ray to the specimen's plane for each point of a prepared picture."""
    right, bottom = camera.width_px + margin_px, camera.height_px + margin_px
    corners = np.array([[-margin_px, -margin_px], [right, -margin_px], [-margin_px, bottom], [right, bottom]])
    reach_px2 = np.max(np.sum((corners - camera.principal_point_px) ** 2, axis=1))
    if camera.k1_per_px2 * reach_px2 <= FOLD:
        return False
    _, directions = camera.ray(corners.astype(np.float64))
    return bool(np.all(directions[:, 2] < -_LOW * np.linalg.norm(directions, axis=1)))
