"""A signal at given times: the truth is within the stated uncertainty, also at bends, jumps and steps."""

import numpy as np
import pytest

from dic.runfile.at_time import SignalRecord, estimate


def std_of(found):
    return np.hypot(found.noise, found.course)


def noisy(truth, rate_hz, seed, *, length_s=60.0, noise=5.0, hum=0.0, hum_hz=50.0):
    rng = np.random.default_rng(seed)
    time_s = np.arange(0.0, length_s, 1.0 / rate_hz)
    values = truth(time_s) + noise * rng.normal(size=len(time_s))
    return time_s, values + hum * np.sin(2.0 * np.pi * hum_hz * time_s + rng.uniform(0.0, 6.0))


def tension(time_s):
    return 20_000.0 * (1.0 - np.exp(-time_s / 20.0))


@pytest.mark.parametrize(
    ("rate_hz", "hum", "hum_hz"), [(1000, 20.0, 50.0), (1000, 20.0, 60.0), (100, 20.0, 50.0), (10, 0.0, 50.0)]
)
def test_noise_is_stated_as_it_is_and_hum_cancels(rate_hz, hum, hum_hz):
    found, off = [], []
    for seed in range(3):
        record = SignalRecord.of(*noisy(tension, rate_hz, seed, hum=hum, hum_hz=hum_hz))
        at_s = np.sort(np.random.default_rng(seed + 50).uniform(0.5, 59.0, 400))
        found.append(estimate(record, at_s))
        off.append((found[-1].value - tension(at_s)) / std_of(found[-1]))
    z = np.concatenate(off)
    assert 0.85 < z.std() < 1.1
    assert 0.93 < np.mean(np.abs(z) < 1.96) < 0.985
    # The mean of 100 samples, or the line between two.
    expected = 5.0 / np.sqrt(0.1 * rate_hz) if rate_hz >= 100 else 5.0 * np.sqrt(2.0 / 3.0)
    assert np.median(found[0].noise) == pytest.approx(expected, rel=0.2)


def test_slope_is_that_of_the_signal():
    record = SignalRecord.of(*noisy(tension, 1000, 1))
    at_s = np.linspace(1.0, 50.0, 100)
    slope = 1000.0 * np.exp(-at_s / 20.0)
    # A line over 0.5 s with a noise of 5 in each of 500 samples.
    noise = 5.0 * np.sqrt(12.0) / 0.5 / np.sqrt(500.0)
    np.testing.assert_allclose(estimate(record, at_s).slope, slope, atol=4.0 * noise)


@pytest.mark.parametrize("rate_hz", [1000, 100, 50, 10])
def test_a_jump_and_a_bend_are_within_the_widened_uncertainty(rate_hz):
    at_jump, at_bend, widths = [], [], []
    for seed in range(40 if rate_hz < 1000 else 12):
        rng = np.random.default_rng(seed)
        jump_s, bend_s = rng.uniform(25.0, 35.0), rng.uniform(10.0, 20.0)

        def truth(t, jump_s=jump_s, bend_s=bend_s):
            value = 200.0 * t - 150.0 * np.maximum(t - bend_s, 0.0)
            return np.where(t < jump_s, value, 0.05 * value)

        record = SignalRecord.of(*noisy(truth, rate_hz, seed, hum=10.0 * (rate_hz > 50)))
        for event_s, scores in ((jump_s, at_jump), (bend_s, at_bend)):
            at_s = event_s + rng.uniform(-0.06, 0.06, 8)
            found = estimate(record, at_s)
            scores.append((found.value - truth(at_s)) / std_of(found))
            widths.append(std_of(found).max())
    for z in (np.concatenate(at_jump), np.concatenate(at_bend)):
        assert np.mean(np.abs(z) < 1.96) > 0.92
        assert np.abs(z).max() < 4.5
    # The jump is 2000 or more.
    assert max(widths) > 200.0


def test_a_value_between_two_steps_is_not_known_better_than_the_resolution():
    def slow(t):
        return 100.0 + 1.3 * t

    time_s, values = noisy(slow, 1000, 2, noise=0.2)
    record = SignalRecord.of(time_s, 10.0 * np.round(values / 10.0))
    assert record.resolution == 10.0
    at_s = np.linspace(1.0, 58.0, 500)
    found = estimate(record, at_s)
    z = (found.value - slow(at_s)) / std_of(found)
    assert np.mean(np.abs(z) < 1.96) > 0.95
    # A change from one step to the next looks like a bend, too.
    assert 10.0 / np.sqrt(12.0) <= np.median(std_of(found)) <= std_of(found).max() < 3.5
    # Noise of one step makes the mean as good as without steps.
    time_s, values = noisy(slow, 1000, 2, noise=10.0)
    fine = estimate(SignalRecord.of(time_s, 10.0 * np.round(values / 10.0)), at_s)
    assert np.median(std_of(fine)) == pytest.approx(np.hypot(10.0, 10.0 / np.sqrt(12.0)) / 10.0, rel=0.2)


def test_the_noise_of_a_signal_that_never_changes_is_unknown_or_declared():
    time_s, at_s = np.arange(0.0, 10.0, 0.01), np.array([5.0])
    flat = estimate(SignalRecord.of(time_s, np.full(1000, 23.5)), at_s)
    assert flat.value == 23.5
    assert np.isnan(std_of(flat)).all()
    declared = estimate(SignalRecord.of(time_s, np.full(1000, 23.5), std=0.3), at_s)
    assert declared.noise == pytest.approx(0.3 / np.sqrt(11.0), rel=0.1)


def test_noise_that_is_declared_or_comes_from_single_times_is_a_least_one():
    time_s = np.arange(0.0, 10.0, 0.01)
    record = SignalRecord.of(time_s, 50.0 * time_s, 0.02, std=2.0)
    found = estimate(record, np.array([5.0]))
    # Eleven samples, each wrong by a noise of 2 and by 0.02 s at a slope of 50.
    assert found.noise == pytest.approx(np.hypot(2.0, 50.0 * 0.02) / np.sqrt(11.0), rel=0.1)


def test_nothing_is_extrapolated_or_read_across_a_gap_or_an_invalid_sample():
    time_s = np.concatenate([np.arange(0.0, 10.0, 0.01), np.arange(15.0, 20.0, 0.01)])
    values = 3.0 * time_s + np.random.default_rng(1).normal(size=len(time_s))
    values[np.abs(time_s - 17.0) < 0.05] = np.nan
    at_s = np.array([-0.01, 5.0, 9.995, 12.0, 17.02, 17.3, 19.98, 20.1])
    found = estimate(SignalRecord.of(time_s, values), at_s)
    assert np.isfinite(found.value).tolist() == [False, True, False, False, False, True, True, False]
    empty = SignalRecord.of(np.zeros(0), np.zeros(0))
    assert np.isnan(estimate(empty, at_s).value).all()


def test_a_long_exposure_sees_the_mean_over_its_length():
    time_s = np.arange(0.0, 20.0, 0.001)
    wave = np.sin(2.0 * np.pi * time_s)
    # Over a whole period the mean of the wave is 0, whatever its phase; over 0.1 s it is near the wave.
    found = estimate(SignalRecord.of(time_s, wave), np.array([10.25, 10.25]), np.array([1.0, 0.01]))
    np.testing.assert_allclose(found.value, [0.0, 1.0], atol=0.02)


def test_samples_may_come_in_any_order():
    time_s, values = noisy(tension, 100, 3)
    mixed = np.random.default_rng(3).permutation(len(time_s))
    at_s = np.linspace(1.0, 50.0, 20)
    straight, shuffled = (
        estimate(SignalRecord.of(time_s[order], values[order]), at_s) for order in (slice(None), mixed)
    )
    np.testing.assert_array_equal(straight.value, shuffled.value)
