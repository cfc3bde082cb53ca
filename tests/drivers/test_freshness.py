import pytest

from drivers.freshness import Freshness


def test_a_counter_that_grows_is_fresh():
    freshness = Freshness(0.5, 2**16)
    for second in range(10):
        freshness.check(50 * second, float(second))


def test_a_counter_may_stand_still_for_a_while_only():
    freshness = Freshness(0.5, 2**16)
    freshness.check(7, 0.0)
    freshness.check(7, 0.5)
    with pytest.raises(ValueError, match=r"sample 7 again after 0\.51 s"):
        freshness.check(7, 0.51)
    freshness.check(8, 0.6)


def test_a_counter_that_wraps_has_grown():
    freshness = Freshness(0.5, 2**16)
    freshness.check(65530, 0.0)
    freshness.check(4, 1.0)


def test_a_counter_that_goes_back_is_a_restart_for_good():
    freshness = Freshness(0.5, 2**32)
    freshness.check(1000, 0.0)
    for sample in (3, 4, 2000):
        with pytest.raises(ValueError, match="restarted"):
            freshness.check(sample, 1.0)
