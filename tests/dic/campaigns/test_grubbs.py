"""Grubbs' test, compared with a published example and published tables."""

import pytest

from dic.campaigns.grubbs import grubbs_test

URANIUM = [199.31, 199.53, 200.19, 200.82, 201.92, 201.95, 202.18, 245.57]
"""Measurements of a mass spectrometer (Tietjen and Moore, 1972; NIST/SEMATECH e-Handbook, 1.3.5.17.1)."""


def test_the_example_of_nist_has_its_outlier():
    found = grubbs_test(URANIUM)
    assert found.place == 7
    assert found.is_outlier
    assert found.statistic == pytest.approx(2.4687, abs=1e-4)
    # stdlib-js, @stdlib/stats-incr-grubbs, states 2.1266 for the two-sided test at 5 %
    assert found.critical == pytest.approx(2.1266, abs=5e-5)


def test_a_value_far_below_the_others_is_found_too():
    found = grubbs_test([-value for value in URANIUM])
    assert (found.place, found.is_outlier) == (7, True)


def test_values_without_an_outlier_have_none():
    found = grubbs_test(URANIUM[:-1])
    assert found.place is not None
    assert not found.is_outlier


# Two-sided values at 5 % are one-sided ones at 2.5 %: F. E. Grubbs and G. Beck, Technometrics 14, 1972.
@pytest.mark.parametrize(
    ("count", "critical"),
    [(3, 1.155), (4, 1.481), (5, 1.715), (6, 1.887), (8, 2.126), (10, 2.290), (14, 2.507)],
)
def test_critical_values_are_those_of_the_tables(count, critical):
    assert grubbs_test(range(count)).critical == pytest.approx(critical, abs=1.1e-3)


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ([], "too few"),
        ([1.0, 9.0], "too few"),
        ([2.0, 2.0, 2.0], "all values are equal"),
        ([0.3, 0.3, 0.3, 0.1 + 0.2], "all values are equal"),
    ],
)
def test_what_cannot_be_tested_is_said(values, reason):
    found = grubbs_test(values)
    assert reason in found.reason
    assert (found.place, found.is_outlier) == (None, False)
