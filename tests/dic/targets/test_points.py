"""Tests of the outline of the found points, which is the edge of the calibrated area."""

import numpy as np

from dic.targets.points import GridPoints


def _points(index: list[tuple[int, int]]) -> GridPoints:
    """Return points with the given indices at 10 px per pitch in the image, with y down."""
    numbers = np.array(index)
    return GridPoints.on_lattice(numbers, numbers * [10.0, -10.0], (4, 3), 0.5)


def test_the_outline_of_a_whole_target_is_its_outer_rows_and_columns() -> None:
    whole = _points([(i, j) for i in range(4) for j in range(3)])
    outline = whole.outline_px()

    assert len(outline) == 10
    steps = np.linalg.norm(np.diff(np.vstack([outline, outline[:1]]), axis=0), axis=1)
    np.testing.assert_allclose(steps, 10.0)


def test_the_outline_of_a_part_stays_within_the_points_found() -> None:
    # The corner (3, 2) and the whole side beside it are out of the picture.
    part = _points([(0, 0), (1, 0), (2, 0), (3, 0), (0, 1), (1, 1), (2, 1), (0, 2), (1, 2)])
    outline = {tuple(point) for point in part.outline_px()}

    assert outline == {(0, 0), (10, 0), (20, 0), (30, 0), (20, -10), (10, -20), (0, -20), (0, -10)}
