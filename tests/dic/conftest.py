"""Images of calibration grids with known intersections, drawn without code of `dic`."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
import pytest
from scipy.special import erf

from dic.correlation.series import Series
from dic.targets.line_grid.find import find_grid
from dic.targets.points import GridPoints


@dataclass(frozen=True)
class GridPicture:
    image: np.ndarray
    xy_mm: np.ndarray
    uv_px: np.ndarray

    def errors_px(self, grid: GridPoints) -> np.ndarray:
        """Return the distance, px, of each found point from the true position of the same intersection."""
        truth = {tuple(np.round(xy, 6)): uv for xy, uv in zip(self.xy_mm, self.uv_px, strict=True)}
        return np.linalg.norm(grid.uv_px - [truth[tuple(np.round(xy, 6))] for xy in grid.xy_mm], axis=1)


@dataclass(frozen=True)
class GridView:
    """A pinhole camera that looks at a grid from the direction of pan, tilt and roll, and the grid itself."""

    size_px: tuple[int, int] = (450, 450)
    pan_deg: float = 0.0
    tilt_deg: float = 0.0
    roll_deg: float = 0.0
    focal_px: float = 1400.0
    distance_mm: float = 40.0
    k1_per_px2: float = 0.0
    lines: tuple[int, int] = (21, 21)
    pitch_mm: float = 0.5
    line_mm: float = 0.06
    overhang_mm: float = 0.0
    blur_px: float = 0.7
    noise: float = 2.0
    dark: float = 50.0
    bright: float = 200.0
    gradient: float = 0.0
    dark_lines: bool = True
    outside: str = "plain"

    def homography(self) -> np.ndarray:
        pan, tilt, roll = np.radians([self.pan_deg, self.tilt_deg, self.roll_deg])
        about_y = np.array([[np.cos(pan), 0, np.sin(pan)], [0, 1, 0], [-np.sin(pan), 0, np.cos(pan)]])
        about_x = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
        about_z = np.array([[np.cos(roll), -np.sin(roll), 0], [np.sin(roll), np.cos(roll), 0], [0, 0, 1]])
        rotation = about_z @ about_x @ about_y
        pose = np.column_stack([rotation[:, 0], rotation[:, 1], [0, 0, self.distance_mm]])
        # Y up on the grid, y down in the image
        return np.diag([self.focal_px, -self.focal_px, 1.0]) @ pose

    def centre_px(self) -> np.ndarray:
        return np.array([(self.size_px[1] - 1) / 2 + 0.3, (self.size_px[0] - 1) / 2 - 0.2])

    def project(self, xy_mm: np.ndarray) -> np.ndarray:
        at = np.column_stack([xy_mm, np.ones(len(xy_mm))]) @ self.homography().T
        ideal = at[:, :2] / at[:, 2:]
        return ideal * (1 + self.k1_per_px2 * (ideal**2).sum(axis=1, keepdims=True)) + self.centre_px()

    def unproject(self, uv_px: np.ndarray) -> np.ndarray:
        distorted = uv_px - self.centre_px()
        ideal = distorted
        for _ in range(6 if self.k1_per_px2 else 0):
            ideal = distorted / (1 + self.k1_per_px2 * (ideal**2).sum(axis=-1, keepdims=True))
        at = (
            np.concatenate([ideal, np.ones_like(ideal[..., :1])], axis=-1)
            @ np.linalg.inv(self.homography()).T
        )
        return at[..., :2] / at[..., 2:]

    def render(self, rng: np.random.Generator) -> GridPicture:
        height, width = self.size_px
        brightness = np.zeros(self.size_px)
        # 2-point Gauss-Legendre over the pixel's area: for lines with any blur far more exact than the noise
        nodes, weights = np.array([-0.5, 0.5]) / np.sqrt(3), np.array([0.5, 0.5])
        rows, columns = np.mgrid[:height, :width].astype(float)
        for dx, wx in zip(nodes, weights, strict=True):
            for dy, wy in zip(nodes, weights, strict=True):
                samples = self.unproject(np.stack([columns + dx, rows + dy], axis=-1))
                brightness += wx * wy * (1 - self._ink(samples))
        if not self.dark_lines:
            brightness = 1 - brightness
        if self.outside == "speckle":
            brightness = self._with_clutter(brightness, rows, columns, rng)
        grey = self.dark + (self.bright - self.dark) * brightness
        grey = grey * (1 + self.gradient * (columns / width - 0.5 + 0.6 * (rows / height - 0.5)))
        grey = grey + rng.normal(0, self.noise, grey.shape)
        counts = [(np.arange(n) - (n - 1) / 2) * self.pitch_mm for n in self.lines]
        xy_mm = np.stack(np.meshgrid(*counts, indexing="ij"), axis=-1).reshape(-1, 2)
        image = np.clip(np.rint(grey), 0, 255).astype(np.float32)
        return GridPicture(image, xy_mm, self.project(xy_mm))

    def _ink(self, xy_mm: np.ndarray) -> np.ndarray:
        blur_mm = max(self.blur_px, 0.05) * self.distance_mm / self.focal_px * np.sqrt(2)
        ends = [(n - 1) / 2 * self.pitch_mm for n in self.lines]
        bare = np.ones(xy_mm.shape[:-1])
        for axis in (0, 1):
            across, along = xy_mm[..., axis], xy_mm[..., 1 - axis]
            phase = across / self.pitch_mm + (self.lines[axis] - 1) / 2
            nearest = np.clip(np.rint(phase), 0, self.lines[axis] - 1)
            offset = (phase - nearest) * self.pitch_mm
            half = self.line_mm / 2
            ink = (erf((offset + half) / blur_mm) - erf((offset - half) / blur_mm)) / 2
            stop = ends[1 - axis] + half + self.overhang_mm
            ink *= (erf((along + stop) / blur_mm) - erf((along - stop) / blur_mm)) / 2
            bare *= 1 - ink
        return 1 - bare

    def _with_clutter(
        self, brightness: np.ndarray, rows: np.ndarray, columns: np.ndarray, rng: np.random.Generator
    ) -> np.ndarray:
        from scipy.ndimage import gaussian_filter

        speckle = gaussian_filter(rng.normal(size=brightness.shape), 2.5)
        speckle = np.clip(0.5 + speckle / speckle.std() * 0.35, 0, 1)
        xy = np.abs(self.unproject(np.stack([columns, rows], axis=-1)))
        ends = [(n - 1) / 2 * self.pitch_mm + 0.6 * self.pitch_mm for n in self.lines]
        outside = (xy[..., 0] > ends[0]) | (xy[..., 1] > ends[1])
        return np.where(outside, speckle, brightness)


@pytest.fixture(scope="session")
def draw_grid() -> Callable[..., GridPicture]:
    """A function ``draw(seed=0, **view)`` that returns an image of a grid and its true intersections."""

    @lru_cache(maxsize=32)
    def rendered(seed: int, view: GridView) -> GridPicture:
        return view.render(np.random.default_rng(seed))

    def draw(seed: int = 0, **view: Any) -> GridPicture:
        picture = rendered(seed, GridView(**view))
        # A test may draw on its copy.
        return replace(picture, image=picture.image.copy())

    return draw


@pytest.fixture(scope="module")
def grids_found_once() -> Iterator[None]:
    """Within a module whose tests process the same image of a grid again and again, find it once.

    The finder has tests of its own. Only the name of the file in error messages is not compared.
    """
    known: dict[tuple[object, ...], GridPoints] = {}

    def found(image: np.ndarray, lines: object, pitch_mm: object, source: str, **how: object) -> GridPoints:
        key = (image.shape, image.tobytes(), lines, pitch_mm, *how.values())
        if key not in known:
            known[key] = find_grid(image, lines, pitch_mm, source, **how)
        return known[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("dic.targets.line_grid.find.find_grid", found)
        yield


@pytest.fixture
def correlated(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """A list to which one element is added for each image that is correlated."""
    seen: list[int] = []
    follow = Series.follow

    def counted(self: Series, *given: object, **named: object) -> object:
        seen.append(1)
        return follow(self, *given, **named)

    monkeypatch.setattr(Series, "follow", counted)
    return seen
