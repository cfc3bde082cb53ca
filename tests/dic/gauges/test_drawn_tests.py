"""E, Poisson's ratio and Rp0.2 of random tension tests agree with the truth within their stated errors."""

import numpy as np
import pytest

from tests.dic.gauges.drawn_tests import NAMES, SHORT_COURSE, drawn_test


def root_mean_square(values):
    return float(np.sqrt(np.mean(np.square(values))))


@pytest.mark.extended
@pytest.mark.timeout(600)
@pytest.mark.parametrize("seeds", [[2], pytest.param(range(6), marks=pytest.mark.extended)], ids=len)
def test_drawn_tests_give_the_true_properties_and_the_uncorrected_camera_does_not(seeds):
    # Of the first tests, test 2 has the largest false strain. The objective window needs ten points, which
    # cost twice the time.
    found = [drawn_test(seed, course=SHORT_COURSE, window=(0.04, 0.76)) for seed in seeds]
    corrected = [test.error_percent("E_gpa") for test in found]
    # Load cell and area alone have 0.43 %. One in 150 000 normal errors lies beyond 4.5 deviations.
    assert root_mean_square(corrected) < 1.0
    uncorrected = [test.error_percent("E_gpa", "uncorrected") for test in found]
    assert root_mean_square(uncorrected) > 3.0 * root_mean_square(corrected)
    for name in NAMES:
        assert all(abs(test.z(name)) < 4.5 for test in found), name


@pytest.mark.long
@pytest.mark.timeout(14_400)
def test_intervals_of_200_drawn_tests_hold_the_truth():
    found = [drawn_test(seed) for seed in range(1000, 1200)]
    within = {name: np.mean([abs(test.z(name)) < 1.96 for test in found]) for name in NAMES}
    # 95 % of 200 tests is known to 1.5 %.
    assert all(0.93 <= share <= 0.97 for share in within.values()), within
    errors = np.abs([test.error_percent("E_gpa") for test in found])
    # Load cell and area alone have 0.43 %, which no correction of the images can change.
    assert np.mean(errors < 1.0) >= 0.9
    assert np.mean(np.abs([test.strain_error_percent() for test in found]) < 1.0) >= 0.98
