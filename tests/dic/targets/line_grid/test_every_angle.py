"""A line grid at every angle to the rows of pixels, with sharp or blurred, thin or wide lines.

The images are drawn from exact areas: small squares of a pixel at the edge of a line are covered in
proportion to the place of the edge. Without blur, and for lines nearly parallel to the rows, grey levels
cannot be interpolated between pixels.
"""

import numpy as np
import pytest
from scipy.special import erf

from dic.targets.line_grid.find import find_grid

LINES, SIZE_PX, PARTS = (13, 13), 540, 8
MOST_RMS_PX, MOST_MEAN_PX = 0.004, 0.001


def _places(angle_deg: float, pitch_px: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the matrix (2, 2) from the lattice to px, and the place of the middle intersection, px."""
    turn = np.radians(angle_deg)
    cos, sin = np.cos(turn), np.sin(turn)
    return pitch_px * np.array([[cos, sin], [sin, -cos]]), np.array([270.3, 269.6])


def _drawn(angle_deg: float, pitch_px: float, width_px: float, blur_px: float) -> np.ndarray:
    matrix, middle = _places(angle_deg, pitch_px)
    inverse = np.linalg.inv(matrix)
    at = (np.arange(SIZE_PX * PARTS) + 0.5) / PARTS - 0.5
    cell = np.abs(inverse).sum(axis=1) * pitch_px / PARTS

    def behind(distance_px: np.ndarray, axis: int) -> np.ndarray:
        if blur_px:
            return 0.5 * (1 + erf(distance_px / (blur_px * np.sqrt(2))))
        return np.clip(distance_px / cell[axis] + 0.5, 0, 1)

    rows = []
    for y in range(SIZE_PX):
        fine = np.stack(np.meshgrid(at, at[y * PARTS : (y + 1) * PARTS]), axis=-1) - middle
        lattice = fine @ inverse.T
        covered = []
        for axis in (0, 1):
            nearest = np.clip(np.rint(lattice[..., axis]), -(LINES[axis] // 2), LINES[axis] // 2)
            off = pitch_px * (lattice[..., axis] - nearest)
            end = pitch_px * (LINES[1 - axis] // 2 + 0.2 - np.abs(lattice[..., 1 - axis]))
            line = behind(width_px / 2 - off, axis) + behind(width_px / 2 + off, axis) - 1
            covered.append(line * behind(end, 1 - axis))
        dark = 1 - (1 - covered[0]) * (1 - covered[1])
        rows.append(dark.reshape(PARTS, SIZE_PX, PARTS).mean(axis=(0, 2)))
    grey = 200 - 160 * np.array(rows) + np.random.default_rng(1).normal(0, 0.5, (SIZE_PX, SIZE_PX))
    return np.rint(grey).astype(np.float32)


@pytest.mark.parametrize(
    ("angle_deg", "pitch_px", "width_px", "blur_px"),
    [
        pytest.param(0.0, 40.0, 6.0, 0.0, id="parallel to the rows, pitch of whole pixels"),
        pytest.param(0.3, 36.4, 2.0, 0.0, id="nearly parallel, thin"),
        *(
            pytest.param(*case, marks=pytest.mark.extended, id=f"{case[0]} deg")
            for case in (
                (0.0, 38.3, 12.0, 0.8),
                (0.05, 40.0, 20.0, 0.4),
                (1.0, 25.3, 2.5, 0.3),
                (40.0, 28.0, 4.0, 0.0),
            )
        ),
    ],
)
def test_intersections_are_found_to_a_few_thousandths_of_a_pixel(
    angle_deg: float, pitch_px: float, width_px: float, blur_px: float
) -> None:
    image = _drawn(angle_deg, pitch_px, width_px, blur_px)
    grid = find_grid(image, LINES, 0.5, x_axis=-angle_deg)
    matrix, middle = _places(angle_deg, pitch_px)
    error_px = grid.uv_px - ((grid.index - np.array(LINES) // 2) @ matrix.T + middle)

    assert len(error_px) > 0.9 * LINES[0] * LINES[1]
    assert error_px.std(axis=0).max() < MOST_RMS_PX
    assert np.abs(error_px.mean(axis=0)).max() < MOST_MEAN_PX
