"""Pictures of a grid and of a specimen that is stretched, for cameras of other makers to show.

They are rendered beforehand, because a test camera must show them in no time. Each picture that is shown
contains its own number and that of its strain, so that the truth of each recorded frame is known.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from simulators.scene.optics import PinholeCamera
from simulators.scene.pose import Pose
from simulators.scene.render import render
from simulators.scene.scene import Surface
from simulators.scene.sensor import Sensor
from simulators.scene.texture import LineGrid, Speckle

STRAINS = np.arange(0.0, 0.0101, 0.0005)
LINES, PITCH_MM = 15, 0.36
POISSON_RATIO = 0.33
GRID = 0
"""Number of the picture of the grid; the following ones are those of the strains."""
SIDE_PX = 400
_NUMBER_BITS = 24
_NOISES = 8
_SENSOR = Sensor(bits=8, full_well_e=32_500.0, read_noise_e=20.0, saturation_exposure_us=12_000.0)

Pictures = NDArray[np.uint8]


def prepare(path: Path) -> None:
    """Render all pictures, each with some noises, shape (pictures, noises, y, x)."""
    camera, speckle, rng = PinholeCamera(SIDE_PX, SIDE_PX), Speckle.sprayed(5), np.random.default_rng(1)
    shown = [Surface(LineGrid(lines=LINES, pitch_mm=PITCH_MM), Pose())]
    shown += [
        Surface(speckle, Pose(), np.diag([1.0 - POISSON_RATIO * strain, 1.0 + strain])) for strain in STRAINS
    ]
    light = [render(camera, surface) for surface in shown]
    np.save(path, [[_SENSOR.expose(each, 10_000.0, 1.0, rng) for _ in range(_NOISES)] for each in light])


def picture_of(*, grid_attached: bool, axial_strain: float) -> int:
    """Return the number of the picture that is nearest to a true state."""
    return GRID if grid_attached else 1 + int(np.abs(STRAINS - axial_strain).argmin())


def drawn(pictures: Pictures, picture: int, number: int) -> Pictures:
    """Return a picture with its own number and that of the frame in its first row."""
    image = pictures[picture, number % _NOISES].copy()
    for place, value in enumerate((picture, number)):
        bits = value >> np.arange(_NUMBER_BITS) & 1
        image[0, place * _NUMBER_BITS : (place + 1) * _NUMBER_BITS] = 255 * bits
    return image


def shown_in(image: Pictures) -> tuple[int, int]:
    """Return the number of the picture that a frame shows, and that of the frame at the camera."""
    bits = (image[0, : 2 * _NUMBER_BITS] > 127).reshape(2, _NUMBER_BITS)
    picture, number = bits @ (1 << np.arange(_NUMBER_BITS))
    return int(picture), int(number)
