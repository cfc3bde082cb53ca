import numpy as np
import pytest

from dic.strain.convolution import convolved


@pytest.mark.parametrize(
    ("one", "other"), [((7, 4), (3, 5)), ((1, 6), (4, 1)), ((6, 5, 3, 2), (11, 9, 1, 1))], ids=str
)
def test_convolution_is_the_sum_of_shifted_products(one, other):
    rng = np.random.default_rng(1)
    a, b = rng.normal(size=one), rng.normal(size=other)
    rows, columns = one[0] + other[0] - 1, one[1] + other[1] - 1
    expected = np.zeros((rows, columns, *np.broadcast_shapes(one[2:], other[2:])))
    for row in range(other[0]):
        for column in range(other[1]):
            expected[row : row + one[0], column : column + one[1]] += a * b[row, column]
    np.testing.assert_allclose(convolved(a, b), expected, atol=1e-12)
