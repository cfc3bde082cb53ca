"""Draw calibration targets by formulas, as the simulators' camera sees them, without code of `dic`."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import cv2
import numpy as np

from dic.targets.kinds import CharucoTarget
from dic.targets.points import GridPoints
from simulators.scene.optics import PinholeCamera
from simulators.scene.pose import Pose
from simulators.scene.render import render
from simulators.scene.scene import Surface
from simulators.scene.texture import LineGrid

# A pixel at an edge is divided into 4 × 4 squares, and of these, each at the edge into 5 × 5 squares.
_SQUARES, _PARTS, _AT_ONCE = 4, 5, 20000
SIZE_PX = 560
FOCAL_PX = 1560.0


@dataclass(frozen=True)
class Drawing:
    """A texture with two reflectances and sharp edges: dark where a formula of x and y (mm) is true."""

    formula: Callable[[np.ndarray, np.ndarray], np.ndarray]
    quadrature_order: ClassVar[int] = 4

    def reflectance(self, points_mm: np.ndarray) -> np.ndarray:
        return np.where(self.formula(points_mm[:, 0], points_mm[:, 1]), 0.1, 0.9)


def checkerboard(squares: tuple[int, int], pitch_mm: float) -> Drawing:
    half = np.array(squares) / 2 * pitch_mm

    def dark(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        column, row = np.floor((x + half[0]) / pitch_mm), np.floor((y + half[1]) / pitch_mm)
        return ((column + row) % 2 == 0) & (abs(x) < half[0]) & (abs(y) < half[1])

    return Drawing(dark)


def dots(dots: tuple[int, int], pitch_mm: float, radius_mm: float) -> Drawing:
    middle = (np.array(dots) - 1) / 2

    def dark(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        column = np.clip(np.rint(x / pitch_mm + middle[0]), 0, dots[0] - 1) - middle[0]
        row = np.clip(np.rint(y / pitch_mm + middle[1]), 0, dots[1] - 1) - middle[1]
        return np.hypot(x - column * pitch_mm, y - row * pitch_mm) < radius_mm

    return Drawing(dark)


def asymmetric_places(dots: tuple[int, int], pitch_mm: float) -> np.ndarray:
    """Return the positions of the dots (rows, dots in a row, 2), mm, by OpenCV's formula, but with y up.

    OpenCV's tutorial on calibration places dot j of row i at ``((2 j + i % 2) s, i s)``, with the size s of a
    square, which is half of the distance between the dots of a row.
    """
    row, j = np.mgrid[: dots[1], : dots[0]]
    places = np.stack([2 * j + row % 2, -row], axis=-1) * (pitch_mm / 2)
    return places - (places.min(axis=(0, 1)) + places.max(axis=(0, 1))) / 2


def asymmetric_dots(
    dots: tuple[int, int], pitch_mm: float, radius_mm: float, bright_dots: bool = False
) -> Drawing:
    from scipy.spatial import KDTree

    tree = KDTree(asymmetric_places(dots, pitch_mm).reshape(-1, 2))

    def dark(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return (tree.query(np.stack([x, y], axis=-1))[0] < radius_mm) ^ bright_dots

    return Drawing(dark)


@dataclass(frozen=True)
class HollowDots:
    """A plate of dots as for DICe and VIC: three dots are rings, at the origin, on X and on Y.

    The origin of x and y is the origin mark. `low` and `high` are the first and the last column and row.
    """

    low: tuple[int, int]
    high: tuple[int, int]
    pitch_mm: float
    radius_mm: float
    hole_mm: float
    marks: tuple[int, int] = (9, 5)
    bright_dots: bool = False
    quadrature_order: ClassVar[int] = 4

    def reflectance(self, points_mm: np.ndarray) -> np.ndarray:
        index = np.clip(np.rint(points_mm / self.pitch_mm), self.low, self.high)
        radius = np.hypot(*(points_mm - index * self.pitch_mm).T)
        marked = ((index == 0) | (index == np.array(self.marks))).all(axis=1) & ~(
            index == np.array(self.marks)
        ).all(axis=1)
        ink = (radius < self.radius_mm) & ~(marked & (radius < self.hole_mm))
        return np.where(ink ^ self.bright_dots, 0.1, 0.9)


def charuco(target: CharucoTarget, legacy: bool = False, first: int = 0) -> Drawing:
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, target.dictionary))
    numbers = np.arange(first, first + target.squares[0] * target.squares[1] // 2)
    board = cv2.aruco.CharucoBoard(target.squares, target.pitch_mm, target.marker_mm, dictionary, numbers)
    board.setLegacyPattern(legacy)
    px_per_square = 140
    columns, rows = (count * px_per_square for count in target.squares)
    picture = board.generateImage((columns, rows))

    def dark(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        column = np.floor(x / target.pitch_mm * px_per_square + columns / 2).astype(int)
        row = np.floor(-y / target.pitch_mm * px_per_square + rows / 2).astype(int)
        on = (column >= 0) & (row >= 0) & (column < columns) & (row < rows)
        return on & (picture[np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)] < 128)

    return Drawing(dark)


def area_sampled(camera: PinholeCamera, surface: Surface) -> np.ndarray:
    """Return the mean reflectance in each pixel of a surface with sharp edges, shape (height, width).

    Each Gauss point is either dark or bright. So with 4 × 4 points, the dark share of a pixel at an edge has
    an rms error of 0.04, which changes in steps along the edge. Pixels whose corners differ are therefore
    divided until the edge lies in squares of 1/20 px, which reduces the error to 0.003.
    """

    def light(px: np.ndarray) -> np.ndarray:
        return surface.texture.reflectance(surface.material(*camera.ray(px)))

    y, x = np.mgrid[: camera.height_px + 1, : camera.width_px + 1] - 0.5
    mean, cut = _of_corners(light(np.stack([x, y], axis=-1).reshape(-1, 2)).reshape(x.shape))
    pixels, at = np.argwhere(cut)[:, ::-1], (np.arange(_SQUARES + 1) / _SQUARES) - 0.5
    grid = np.stack(np.meshgrid(at, at), axis=-1)
    part = ((np.arange(_PARTS) + 0.5) / _PARTS - 0.5) / _SQUARES
    parts = np.stack(np.meshgrid(part, part), axis=-1).reshape(-1, 2)
    for some in np.array_split(pixels, len(pixels) * grid.size // _AT_ONCE + 1):
        corners = light((some[:, None, None] + grid).reshape(-1, 2)).reshape(-1, *grid.shape[:2])
        squares, edge = _of_corners(corners)
        which, row, column = np.nonzero(edge)
        middles = some[which] + (np.stack([column, row], axis=-1) + 0.5) / _SQUARES - 0.5
        samples = light((middles[:, None] + parts).reshape(-1, 2)).reshape(len(middles), -1)
        squares[which, row, column] = samples.mean(axis=1)
        mean[some[:, 1], some[:, 0]] = squares.mean(axis=(1, 2))
    return mean


def _of_corners(corner: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean of the corners of each square, and whether they differ, for corners on a grid."""
    four = np.stack([corner[..., i : i - 1 or None, j : j - 1 or None] for i in (0, 1) for j in (0, 1)])
    return four.mean(axis=0), np.ptp(four, axis=0) > 0


@dataclass(frozen=True)
class View:
    """A target in front of a camera."""

    camera: PinholeCamera
    surface: Surface

    @classmethod
    def of(
        cls,
        texture: Any,
        roll_deg: float = 0.0,
        size_px: tuple[int, int] = (SIZE_PX, SIZE_PX),
        focal_px: float = FOCAL_PX,
        shift_mm: tuple[float, float] = (0.0, 0.0),
        **camera: float,
    ) -> "View":
        """Return a view of a target turned by `roll_deg` and shifted; `camera` holds pan_deg and tilt_deg."""
        pose = Pose.turned(np.array([0.0, 0.0, 1.0]), roll_deg, np.zeros(3))
        moved = Pose(pose.rotation, np.array([*shift_mm, 0.0]))
        return cls(PinholeCamera(*size_px, focal_px=focal_px, **camera), Surface(texture, moved))

    def image(
        self, noise: float = 2.0, blur_px: float = 0.8, seed: int = 8, glare: float = 0.0
    ) -> np.ndarray:
        """Return grey levels from 0 to 255; `glare` is the height of a reflection, which saturates from 75.

        The blur of sharp edges is applied to whole pixels. So at edges parallel to the rows it differs from
        the blur of a lens. The blur of a line grid is applied to quarters of pixels.
        """
        smooth = isinstance(self.surface.texture, LineGrid)
        light = 200 * (self._through_a_lens(blur_px) if smooth else area_sampled(self.camera, self.surface))
        blur_px = 0.0 if smooth else blur_px
        rng = np.random.default_rng(seed)
        if glare:
            y, x = np.mgrid[: light.shape[0], : light.shape[1]]
            place = rng.uniform(0.2, 0.8, 2) * light.shape
            width = rng.uniform(0.08, 0.2) * max(light.shape)
            light = light + glare * np.exp(-((y - place[0]) ** 2 + (x - place[1]) ** 2) / (2 * width**2))
        blurred = cv2.GaussianBlur(light, (0, 0), blur_px) if blur_px else light
        return np.clip(np.rint(blurred + rng.normal(0, noise, light.shape)), 0, 255).astype(np.float32)

    def _through_a_lens(self, blur_px: float) -> np.ndarray:
        camera, parts = self.camera, 4
        height_px, width_px = camera.height_px, camera.width_px
        sizes = {
            "width_px": parts * width_px,
            "height_px": parts * height_px,
            "focal_px": parts * camera.focal_px,
        }
        light = render(replace(camera, **sizes, k1_per_px2=camera.k1_per_px2 / parts**2), self.surface)
        blurred = cv2.GaussianBlur(light, (0, 0), parts * blur_px) if blur_px else light
        return blurred.reshape(height_px, parts, width_px, parts).mean(axis=(1, 3))

    def project(self, xy_mm: np.ndarray) -> np.ndarray:
        """Return the image positions, px, of points (n, 2), mm, of the target."""
        return self.camera.project(self.surface.world(xy_mm))

    def errors_px(self, grid: GridPoints) -> np.ndarray:
        return grid.uv_px - self.project(grid.xy_mm)

    def rms_px(self, grid: GridPoints) -> float:
        return float(np.sqrt((self.errors_px(grid) ** 2).sum(axis=1).mean()))


def seen(
    texture: Drawing | LineGrid, noise: float = 2.0, roll_deg: float = 0.0, **swing: float
) -> tuple[np.ndarray, PinholeCamera, Surface]:
    """Return the image of a target, the camera and the target's surface."""
    view = View.of(texture, roll_deg, **swing)
    return view.image(noise), view.camera, view.surface


def bound_px(view: View, radius_mm: float, xy_mm: np.ndarray, blur_px: float, noise: float) -> float:
    """Return the Cramér-Rao bound of the 2-D rms error of dots' centres, if all other values are known.

    Take an edge with the contrast C and a blur of standard deviation s. Each px of its length gives the
    Fisher information ``C²/(2√π s σ²)`` about the position across the edge. This is the integral of the
    squared slope of the edge, divided by the variance σ² of the noise. The area of a pixel adds 1/12 px² to
    s², and rounding adds 1/12 to σ².
    """
    angle = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    circle = radius_mm * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    rims = np.stack([view.project(centre + circle) for centre in xy_mm])
    steps = np.roll(rims, -1, axis=1) - rims
    lengths = np.linalg.norm(steps, axis=-1)
    normals = np.stack([steps[..., 1], -steps[..., 0]], axis=-1) / lengths[..., None]
    per_px = 160.0**2 / (2 * np.sqrt(np.pi) * np.sqrt(blur_px**2 + 1 / 12) * (noise**2 + 1 / 12))
    information = per_px * np.einsum("kni,knj,kn->kij", normals, normals, lengths)
    return float(np.sqrt(np.trace(np.linalg.inv(information), axis1=1, axis2=2).mean()))
