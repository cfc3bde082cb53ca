"""Polygons that cover each other in part are found, also if their edges lie on the same lines."""

import numpy as np
import pytest

from dic.errors import CorrelationError
from dic.regions.drawn import DrawnRegion, Outline
from dic.regions.overlaps import find_overlaps


def rectangle(left, top, right, bottom):
    return np.array([[left, top], [right, top], [right, bottom], [left, bottom]], float)


WHOLE = rectangle(0, 0, 100, 100)


@pytest.mark.parametrize(
    ("other", "overlaps"),
    [
        (rectangle(50, 0, 150, 100), True),
        (rectangle(0, 50, 100, 150), True),
        (WHOLE, True),
        (WHOLE[::-1], True),
        (rectangle(100, 0, 200, 100), False),
        (rectangle(0, 0, 50, 100), False),
        (rectangle(20, 30, 60, 70), False),
        (rectangle(-20, -20, 120, 120), False),
        (rectangle(300, 0, 400, 100), False),
    ],
)
def test_only_polygons_that_share_a_part_overlap(other, overlaps):
    assert find_overlaps([WHOLE, other]) == ([(0, 1)] if overlaps else [])
    assert find_overlaps([other, WHOLE]) == ([(0, 1)] if overlaps else [])


def test_an_overlap_is_refused_once_and_a_hole_may_cross():
    side_by_side = [Outline("a", WHOLE), Outline("b", rectangle(50, 0, 150, 100))]
    with pytest.raises(CorrelationError, match="an overlap with b") as caught:
        DrawnRegion(side_by_side).mask((200, 200))
    assert str(caught.value).count("draw one polygon around both") == 1
    with pytest.raises(CorrelationError, match="a crossing with b at") as caught:
        DrawnRegion([side_by_side[0], Outline("b", rectangle(50, 50, 150, 150))]).mask((200, 200))
    assert "overlap" not in str(caught.value)
    assert DrawnRegion(side_by_side[:1], side_by_side[1:]).mask((200, 200)).sum() == 50 * 100


def test_nothing_is_compared_without_polygons():
    assert find_overlaps([]) == []
