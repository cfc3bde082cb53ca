"""Points of a grid: which are next to which."""

import numpy as np

from dic.correlation.solver import next_to


def test_next_to_an_element_is_up_down_left_or_right():
    mask = np.zeros((4, 5), bool)
    mask[1, 2] = True
    found = {tuple(map(int, place)) for place in np.argwhere(next_to(mask))}
    assert found == {(0, 2), (2, 2), (1, 1), (1, 3)}
