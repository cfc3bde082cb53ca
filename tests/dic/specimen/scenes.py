"""Ten kinds of random scenes with a specimen, with the exact mask of the specimen."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tests.dic.specimen.canvas import Camera, Canvas, Speckles, brushed, uneven

Draw = Callable[[Canvas, np.random.Generator], tuple[Camera, np.ndarray | float]]
"""Type of a function that draws a scene, and returns the camera and the light."""


@dataclass(frozen=True)
class Scene:
    """Images of a scene before and after a shift of the specimen by `shift_px`; other objects do not move."""

    name: str
    seed: int
    reference: np.ndarray
    moved: np.ndarray
    mask: np.ndarray
    shift_px: tuple[float, float]


def scene(name: str, seed: int, shape: tuple[int, int] = (320, 400)) -> Scene:
    """Return a scene; equal names, seeds and shapes give equal scenes."""
    shift_px = (1.4, -0.7)
    pictures, mask = [], None
    for number, shift in enumerate(((0.0, 0.0), shift_px)):
        rng = np.random.default_rng([seed, sorted(SCENES).index(name)])
        canvas = Canvas(shape, shift)
        camera, light = SCENES[name](canvas, rng)
        pictures.append(camera.take(canvas, light, np.random.default_rng([seed, 77, number])))
        mask = canvas.mask() if mask is None else mask
    return Scene(name, seed, *pictures, mask, shift_px)


def dark_room(canvas: Canvas, rng: np.random.Generator) -> tuple[Camera, np.ndarray]:
    """Draw a bright specimen in front of a black background, with light that decreases to one side."""
    canvas.fill(rng.uniform(0.0, 0.03))
    canvas.paint([_bar(canvas, rng)], _paint(rng), rng)
    return _camera(rng), _sloping_light(canvas, rng, 0.4)


def bright_wall(canvas: Canvas, rng: np.random.Generator) -> tuple[Camera, float]:
    """Draw a specimen in front of a white wall, whose photon noise is the strongest noise of the image."""
    canvas.fill(uneven(rng, canvas.shape, 80, 0.85, rng.uniform(0.95, 1.3)))
    canvas.paint([_bar(canvas, rng)], _paint(rng), rng)
    return _camera(rng, photon_noise=rng.uniform(2, 5)), 1.0


def small_dark(canvas: Canvas, rng: np.random.Generator) -> tuple[Camera, float]:
    """Draw a small dark specimen with little contrast in front of a bright background."""
    canvas.fill(uneven(rng, canvas.shape, 60, 0.6, 0.95))
    ground = rng.uniform(0.12, 0.2)
    speckles = Speckles(_radius(rng), 0.5, ground * rng.uniform(0.2, 0.4), ground)
    canvas.paint([_bar(canvas, rng, 0.3)], speckles, rng)
    return _camera(rng, photon_noise=rng.uniform(1, 2.5)), 1.0


def blurred_laboratory(canvas: Canvas, rng: np.random.Generator) -> tuple[Camera, float]:
    """Draw a specimen in front of objects that are out of focus."""
    canvas.fill(rng.uniform(0.1, 0.6))
    _clutter(canvas, rng, 14)
    canvas.soften(rng.uniform(4, 9))
    canvas.paint([_bar(canvas, rng)], _paint(rng), rng)
    return _camera(rng), 1.0


def cluttered(canvas: Canvas, rng: np.random.Generator) -> tuple[Camera, float]:
    """Draw a specimen in front of boxes, cables and texts that are in focus."""
    canvas.fill(rng.uniform(0.1, 0.6))
    _clutter(canvas, rng, 9)
    for _ in range(3):
        _cable(canvas, rng)
    canvas.paint([_bar(canvas, rng)], _paint(rng), rng)
    return _camera(rng), 1.0


def gripped(canvas: Canvas, rng: np.random.Generator) -> tuple[Camera, np.ndarray]:
    """Draw a tensile specimen in grips of brushed metal with bolts, with cables beside and in front of it."""
    height, width = canvas.shape
    canvas.fill(rng.uniform(0.02, 0.5))
    _cable(canvas, rng)
    middle, wide, narrow = width * rng.uniform(0.42, 0.58), width * 0.24, width * rng.uniform(0.13, 0.17)
    canvas.paint([_waisted(middle, wide, narrow, height)], _paint(rng), rng)
    for top in (0.0, height * rng.uniform(0.82, 0.86)):
        grip = _box(middle - width * 0.3, top - 5, middle + width * 0.3, top + height * 0.19)
        canvas.shade(grip, brushed(rng, canvas.shape, rng.uniform(0.2, 0.6), rng.uniform(0.03, 0.1)))
        for side in (-0.2, 0.2):
            _bolt(canvas, (middle + side * width, top + height * 0.09), height * 0.035)
    x = middle + width * rng.uniform(-0.05, 0.05)
    hanging = np.array([[x, 0], [x + 8, height * 0.1], [x + 30, height * 0.16], [width, height * 0.3]])
    canvas.line(hanging, rng.uniform(2, 4), rng.choice([0.03, 0.9]))
    return _camera(rng), _sloping_light(canvas, rng, 0.6)


def two_specimens(canvas: Canvas, rng: np.random.Generator) -> tuple[Camera, float]:
    """Draw two specimens side by side with different paint."""
    height, width = canvas.shape
    canvas.fill(rng.choice([0.03, 0.4, 0.9]))
    for left in (0.1, 0.56):
        left, right = width * left, width * (left + rng.uniform(0.28, 0.34))
        canvas.paint([_box(left, height * 0.12, right, height * rng.uniform(0.7, 1.1))], _paint(rng), rng)
    return _camera(rng), 1.0


def plate_with_hole(canvas: Canvas, rng: np.random.Generator) -> tuple[Camera, float]:
    """Draw a plate with a round hole, through which the background is visible."""
    height, width = canvas.shape
    canvas.fill(uneven(rng, canvas.shape, 70, 0.0, 0.08) + np.float32(rng.choice([0.0, 0.4, 0.85])))
    angle = np.linspace(0, 2 * np.pi, 90, endpoint=False)
    centre = np.array([width * rng.uniform(0.4, 0.6), height * rng.uniform(0.4, 0.6)])
    hole = centre + height * rng.uniform(0.09, 0.15) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    canvas.paint([_box(width * 0.14, -20, width * 0.86, height + 20), hole], _paint(rng), rng)
    return _camera(rng), 1.0


def whole_picture(canvas: Canvas, rng: np.random.Generator) -> tuple[Camera, np.ndarray]:
    """Draw a specimen that fills the image, in uneven light."""
    height, width = canvas.shape
    canvas.paint([_box(-20, -20, width + 20, height + 20)], _paint(rng), rng)
    return _camera(rng, jpeg=int(rng.choice([0, 90]))), _sloping_light(canvas, rng, 0.3)


def ruler_and_glare(canvas: Canvas, rng: np.random.Generator) -> tuple[Camera, np.ndarray]:
    """Draw an oblique specimen beside a ruler, a printed label and reflections, for a JPEG file."""
    height, width = canvas.shape
    canvas.fill(uneven(rng, canvas.shape, 50, 0.1, 0.45))
    left = width * 0.03
    canvas.shade(_box(left, -5, left + width * 0.13, height + 5), 0.75)
    for number, y in enumerate(np.arange(6, height, 6.0)):
        length = width * (0.06 if number % 5 == 0 else 0.035)
        canvas.line(np.array([[left, y], [left + length, y]]), 1.3, 0.05)
        if number % 10 == 5:
            canvas.print(str(number), (left + width * 0.07, y), 8, 0.05)
    canvas.shade(_box(width * 0.77, height * 0.1, width * 0.98, height * 0.4), 0.9)
    for line in range(4):
        canvas.print("S355 No. 7", (width * 0.78, height * (0.17 + 0.06 * line)), 9, 0.1)
    angle_deg = rng.uniform(0, 50)
    speckles = _paint(rng, squeeze=float(np.cos(np.radians(angle_deg))))
    canvas.paint([_bar(canvas, rng, 0.36, 0.46)], speckles, rng)
    light = np.ones(canvas.shape, np.float32)
    y, x = np.mgrid[:height, :width]
    for _ in range(3):
        at_x, at_y, size = width * rng.uniform(0.7, 1.0), height * rng.uniform(0.5, 1.0), rng.uniform(6, 15)
        light += 4 * np.exp(-((x - at_x) ** 2 + (y - at_y) ** 2) / (2 * size**2)).astype(np.float32)
    return _camera(rng, jpeg=int(rng.choice([80, 90, 95]))), light


SCENES: dict[str, Draw] = {
    draw.__name__: draw
    for draw in (
        dark_room, bright_wall, small_dark, blurred_laboratory, cluttered, gripped, two_specimens,
        plate_with_hole, whole_picture, ruler_and_glare,
    )
}  # fmt: skip


def _camera(rng: np.random.Generator, **given: float) -> Camera:
    drawn = {
        "white": rng.uniform(160, 240),
        "blur_px": rng.uniform(0.45, 1.1),
        "photon_noise": rng.uniform(0.8, 3.0),
        "read_noise": rng.uniform(0.5, 1.5),
    }
    return Camera(**(drawn | given))


def _radius(rng: np.random.Generator) -> float:
    return float(rng.uniform(1.6, 3.2))


def _paint(rng: np.random.Generator, squeeze: float = 1.0) -> Speckles:
    """Return black dots on white or white dots on black, of good or poor contrast."""
    dark, bright = rng.uniform(0.04, 0.2), rng.uniform(0.5, 0.9)
    dots, ground = (dark, bright) if rng.random() < 0.7 else (bright, dark)
    return Speckles(_radius(rng), rng.uniform(0.4, 0.6), dots, ground, squeeze)


def _sloping_light(canvas: Canvas, rng: np.random.Generator, least: float) -> np.ndarray:
    """Return light that falls from 1 to `least` across the picture."""
    height, width = canvas.shape
    y, x = np.mgrid[:height, :width]
    angle = rng.uniform(0, 2 * np.pi)
    along = np.cos(angle) * x / width + np.sin(angle) * y / height
    part = (along - along.min()) / (along.max() - along.min())
    return (least + (1.0 - least) * part).astype(np.float32)


def _box(left: float, top: float, right: float, bottom: float) -> np.ndarray:
    return np.array([[left, top], [right, top], [right, bottom], [left, bottom]])


def _bar(canvas: Canvas, rng: np.random.Generator, width: float = 0.4, centre: float = 0.5) -> np.ndarray:
    """Return the outline of a slightly turned bar, whose ends are inside or outside the image."""
    height, length = canvas.shape[0], canvas.shape[1]
    half = np.array([length * width / 2, height * rng.choice([0.36, 0.42, 0.8])])
    middle = np.array([length * centre + rng.uniform(-10, 10), height * 0.5])
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
    angle = np.radians(rng.uniform(-12, 12))
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return middle + corners @ turn.T


def _waisted(middle: float, wide: float, narrow: float, height: float) -> np.ndarray:
    """Return the outline of a tensile specimen whose shoulders are circular arcs."""
    y = np.linspace(-20, height + 20, 120)
    from_middle = np.abs(y - height / 2) / (height / 2)
    half = narrow + (wide - narrow) * np.clip((from_middle - 0.45) / 0.3, 0, 1) ** 2
    return np.concatenate([np.stack([middle - half, y], 1), np.stack([middle + half, y], 1)[::-1]])


def _clutter(canvas: Canvas, rng: np.random.Generator, count: int) -> None:
    """Draw boxes, some with texts, and frames with bolts."""
    height, width = canvas.shape
    for number in range(count):
        at = rng.uniform(-0.1, 0.95, 2) * (width, height)
        size = rng.uniform(0.1, 0.4, 2) * (width, height)
        corners = _box(*at, *(at + size)) @ _turn(rng.uniform(-0.3, 0.3)).T
        canvas.shade(corners, rng.uniform(0.02, 0.95))
        if number % 3 == 0:
            canvas.print(
                "LOAD 25 kN", (at[0] + 5, at[1] + size[1] / 2), rng.uniform(8, 16), rng.uniform(0, 1)
            )
        if number % 3 == 1:
            _bolt(canvas, (at[0] + size[0] / 2, at[1] + size[1] / 2), height * rng.uniform(0.02, 0.05))


def _turn(angle: float) -> np.ndarray:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def _bolt(canvas: Canvas, at: tuple[float, float], radius_px: float) -> None:
    for radius, corners, grey in (
        (radius_px, 40, 0.7),
        (0.8 * radius_px, 40, 0.3),
        (0.5 * radius_px, 6, 0.03),
    ):
        angle = np.linspace(0, 2 * np.pi, corners, endpoint=False)
        canvas.shade(np.array(at) + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1), grey)


def _cable(canvas: Canvas, rng: np.random.Generator) -> None:
    height, width = canvas.shape
    x = np.linspace(0, width, 30)
    y = height * (rng.uniform(0, 1) + 0.15 * np.sin(x / width * rng.uniform(3, 9) + rng.uniform(0, 6)))
    canvas.line(np.stack([x, y], axis=1), rng.uniform(2, 7), rng.choice([0.03, 0.3, 0.9]))
