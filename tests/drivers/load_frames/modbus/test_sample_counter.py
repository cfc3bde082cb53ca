import pytest

from drivers.load_frames.modbus.sample_counter import Freshness


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


def test_a_narrow_counter_may_go_round_while_nobody_reads():
    freshness = Freshness(0.5, 2**16)
    freshness.check(100, 0.0)
    freshness.check((100 + 60 * 1000) % 2**16, 60.0)
    freshness.check((100 + 61 * 1000) % 2**16, 61.0)


def test_a_wide_counter_tells_a_restart_after_any_silence():
    freshness = Freshness(0.5, 2**32)
    freshness.check(100_000, 0.0)
    with pytest.raises(ValueError, match="a restarted machine"):
        freshness.check(5, 60.0)


def test_a_narrow_counter_that_stood_still_all_the_time_is_stale():
    freshness = Freshness(0.5, 2**16)
    freshness.check(100, 0.0)
    with pytest.raises(ValueError, match="sample 100 again after 60 s"):
        freshness.check(100, 60.0)


def test_a_restart_is_not_forgotten_while_nobody_reads():
    freshness = Freshness(0.5, 2**16)
    freshness.check(1000, 0.0)
    for sample, now_s in ((3, 1.0), (500, 60.0)):
        with pytest.raises(ValueError, match="a restarted machine"):
            freshness.check(sample, now_s)
