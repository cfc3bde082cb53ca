"""The comparison of travel and confirmed speed: true motions pass, and wrong ones do not."""

import numpy as np
import pytest

from drivers.load_frames.travel import Travel

PERIOD_S = 0.05


def drive(travel, speeds, true_speed=lambda speed: speed, noise_mm=0.0, ramp_s=0.0, seed=3):
    """Read during changes of speed, given as (duration in s, speed); return the time of the first error."""
    rng = np.random.default_rng(seed)
    now_s = place_mm = 0.0
    real = target = true_speed(speeds[0][1])
    travel.begin(1e6, speeds[0][1])
    for number, (duration_s, speed) in enumerate(speeds):
        target = true_speed(speed)
        if number:
            travel.change(speed, place_mm + noise_mm * rng.standard_normal(), now_s, now_s)
        for _ in range(round(duration_s / PERIOD_S)):
            share = 1.0 if ramp_s == 0.0 else PERIOD_S / ramp_s
            real += share * (target - real)
            now_s += PERIOD_S
            place_mm += real * PERIOD_S
            try:
                travel.check(place_mm + noise_mm * rng.standard_normal(), now_s - 0.02, now_s)
            except ValueError:
                return now_s
    return None


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("scale", [1e-4, 0.015, 1.0])
def test_a_true_motion_with_noise_ramps_and_many_changes_is_never_accused(seed, scale):
    rng = np.random.default_rng(seed)
    speeds = [
        (duration_s, scale * factor)
        for duration_s, factor in zip(rng.uniform(0.1, 5.0, 200), rng.uniform(0.1, 10.0, 200), strict=True)
    ]
    assert drive(Travel(), speeds, noise_mm=0.5e-3, ramp_s=0.2, seed=seed) is None


@pytest.mark.parametrize(("factor", "within_s"), [(0.5, 6.0), (2.0, 4.0), (5.0, 1.5)])
def test_a_crosshead_that_keeps_its_speed_is_found_within_seconds(factor, within_s):
    found_s = drive(Travel(), [(5.0, 0.02), (60.0, 0.02 * factor)], true_speed=lambda speed: 0.02)
    assert 5.0 < found_s < 5.0 + within_s


def test_a_crosshead_that_keeps_its_speed_while_the_control_goes_slower_and_slower_is_found():
    falling = [(0.2, 0.02 * 0.98**number) for number in range(300)]
    assert drive(Travel(), falling, true_speed=lambda speed: 0.02) < 15.0


def test_nothing_is_compared_before_the_first_change_and_after_the_end():
    travel = Travel()
    assert not travel.begun
    travel.begin(1.0, 0.1)
    assert travel.begun
    travel.check(500.0, 0.0, 0.0)
    travel.change(0.2, 0.0, 1.0, 1.0)
    travel.end()
    travel.check(500.0, 2.0, 2.0)
    assert not travel.begun


def test_a_crosshead_that_brakes_before_its_target_is_not_accused():
    travel = Travel()
    travel.begin(10.0, 1.0)
    travel.change(5.0, 0.0, 0.0, 0.0)
    travel.check(8.0, 2.0, 2.0)
    travel.check(9.9, 3.0, 3.0)
    travel.check(9.99, 10.0, 10.0)


def test_an_inward_motion_is_compared_by_its_way():
    travel = Travel()
    travel.begin(-10.0, 0.1)
    travel.change(0.2, 0.0, 0.0, 0.0)
    travel.check(-0.4, 2.0, 2.0)
    with pytest.raises(ValueError, match=r"-0\.4 mm in 4 s, not"):
        travel.check(0.4, 4.0, 4.0)
