"""Check that the parts of a figure are inside the figure and do not overlap."""

from collections.abc import Sequence
from itertools import combinations

from matplotlib.figure import Figure
from matplotlib.transforms import BboxBase


def assert_apart_inside(figure: Figure, boxes: Sequence[BboxBase]) -> None:
    """Check that all boxes are inside the figure, and that no box overlaps another box."""
    for box in boxes:
        assert box.x0 >= 0.0
        assert box.y0 >= 0.0
        assert box.x1 <= figure.bbox.x1
        assert box.y1 <= figure.bbox.y1
    for one, other in combinations(boxes, 2):
        assert not one.overlaps(other)
