"""The root is the number that `scipy.optimize.brentq` finds."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from dic.strain.root import root


@pytest.mark.parametrize(
    "function",
    [
        lambda x: math.cos(x) - x,
        lambda x: x**3 - 2 * x - 5,
        lambda x: math.tanh(9 * (x - 2)),
        lambda x: x - 2.5,
    ],
)
def test_each_step_is_that_of_scipy(function):
    random = np.random.default_rng(6)
    for first, last in zip(random.uniform(-3, 0, 40), random.uniform(3, 9, 40), strict=True):
        assert root(function, first, last) == brentq(function, first, last)


def test_a_function_without_a_change_of_sign_is_refused():
    with pytest.raises(ValueError, match="the same sign at 1 and 2"):
        root(lambda x: x * x, 1.0, 2.0)
