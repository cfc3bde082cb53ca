"""Numbers of the report: two significant digits of each standard deviation, and no zero that is none."""

import pytest

from dic.report.numbers import micro_with_std, with_std


@pytest.mark.parametrize(
    ("value", "std", "text"),
    [
        (34.6473, 0.19294, "34.65 ± 0.19"),
        (0.33, 1.234e-5, "0.330000 ± 0.000012"),
        (73.1, 0.0996, "73.10 ± 0.10"),
        (62.3, 11.4, "62 ± 11"),
        (2.0, 1.23e-12, "2.0000 ± 1.2e-12"),
        (-0.1, 0.0, "−0.1000 ± 0"),
        (1.0, float("nan"), "1.0000 ± –"),
    ],
)
def test_standard_deviation_has_two_significant_digits(value, std, text):
    assert with_std(value, std) == text


@pytest.mark.parametrize(
    ("value", "std", "text"),
    [
        (-362.13, 0.44, "−362.1 ± 0.4"),
        (1234.5, 12.3, "1234 ± 12"),
        (0.02, 0.013, "0.020 ± 0.013"),
        (3.0, 0.0, "3.0000 ± 0"),
    ],
)
def test_small_standard_deviation_of_strain_is_not_rounded_to_zero(value, std, text):
    assert micro_with_std(value, std) == text
