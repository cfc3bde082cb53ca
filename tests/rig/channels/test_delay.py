"""The delay of a channel against a camera is that of a simulated light, camera and box."""

import numpy as np
import pytest

from rig.channels.delay import Delay, find_delay
from rig.channels.edges import LEAST_CONTRAST, Edges, edges_of_light, edges_of_signal, levels_of

LENGTH_S = 40.0


def switching(rng, every_s=0.5) -> np.ndarray:
    """Return irregular times at which a light is switched; it is off before the first one."""
    return np.cumsum(rng.uniform(0.3, 1.7, int(LENGTH_S / every_s)) * every_s)


def light_in(times_s, begin_s, length_s):
    """Return the part of each interval during which the light is on, without any code of the product."""
    shares = []
    for begin, length in zip(begin_s, length_s, strict=True):
        edges = np.clip(times_s, begin, begin + length)
        on = np.diff(np.append(edges, begin + length))[::2].sum()
        shares.append(on / length)
    return np.array(shares)


def filmed(rng, times_s, period_s=0.037, exposure_s=0.005, noise=0.01, top=None):
    begin_s = 0.011 + period_s * np.arange(int(LENGTH_S / period_s))
    values = 40.0 + 100.0 * light_in(times_s, begin_s, np.full(len(begin_s), exposure_s))
    values = values * (1.0 + noise * rng.normal(size=len(values)))
    if top is not None:
        values = np.minimum(values, top)
    middle_s, length_s = begin_s + exposure_s / 2, np.full(len(begin_s), exposure_s)
    levels = levels_of(values)
    assert levels.contrast > LEAST_CONTRAST
    return edges_of_light(middle_s, length_s, values, levels, saturated=top is not None)


def sampled(rng, times_s, delay_s=0.123, jitter_s=0.0, rate_hz=1000.0, noise_v=0.05, hum_v=0.1):
    at_s = np.arange(int(LENGTH_S * rate_hz)) / rate_hz + 0.0003
    lag_s = delay_s + jitter_s * np.sqrt(12.0) * (rng.uniform(size=len(times_s)) - 0.5)
    on = np.searchsorted(times_s + lag_s, at_s) % 2
    values = 3.0 * on + noise_v * rng.normal(size=len(at_s)) + hum_v * np.sin(100.0 * np.pi * at_s)
    return edges_of_signal(at_s, values, levels_of(values)), (at_s[0], at_s[-1])


@pytest.mark.parametrize("delay_s", [0.0, 0.0123, 0.2, 3.7])
@pytest.mark.parametrize("jitter_s", [0.0, 0.01])
def test_the_delay_is_found_within_its_standard_deviation(delay_s, jitter_s):
    """A camera whose phase rolls against the light, at 27 images per second."""
    rng = np.random.default_rng(1)
    times_s = switching(rng)
    found = find_delay(filmed(rng, times_s), *sampled(rng, times_s, delay_s, jitter_s))
    assert isinstance(found, Delay)
    assert found.edges > 60
    assert abs(found.delay_s - delay_s) < 3.5 * found.mean_std_s
    assert found.mean_std_s < 0.002
    assert found.jitter_s == pytest.approx(jitter_s, abs=0.004)
    assert found.others_s == ()


def test_the_standard_deviation_of_the_delay_is_right():
    scores = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        times_s = switching(rng)
        found = find_delay(filmed(rng, times_s), *sampled(rng, times_s, 0.1, 0.005))
        scores.append((found.delay_s - 0.1) / found.mean_std_s)
    assert np.std(scores) == pytest.approx(1.0, abs=0.3)
    assert abs(np.mean(scores)) < 0.4


@pytest.mark.parametrize("exposure_s", [0.0005, 0.03])
def test_exposures_during_which_the_light_switches_count_in_part(exposure_s):
    rng = np.random.default_rng(3)
    times_s = switching(rng)
    found = find_delay(filmed(rng, times_s, exposure_s=exposure_s), *sampled(rng, times_s))
    assert found.delay_s == pytest.approx(0.123, abs=4.0 * found.mean_std_s)


def test_images_that_are_saturated_by_a_part_of_their_exposure_shift_nothing():
    rng = np.random.default_rng(4)
    times_s = switching(rng)
    light = filmed(rng, times_s, exposure_s=0.03, top=45.0)
    found = find_delay(light, *sampled(rng, times_s))
    assert found.delay_s == pytest.approx(0.123, abs=4.0 * found.mean_std_s)


def test_slow_samples_and_a_slow_camera_still_give_a_delay():
    rng = np.random.default_rng(5)
    times_s = switching(rng, every_s=2.0)
    found = find_delay(filmed(rng, times_s, period_s=0.2), *sampled(rng, times_s, 0.3, rate_hz=10.0))
    assert found.delay_s == pytest.approx(0.3, abs=4.0 * found.mean_std_s)


def test_regular_switching_gives_the_shortest_delay_and_names_the_others():
    rng = np.random.default_rng(6)
    times_s = 0.5 + 0.5 * np.arange(79)
    found = find_delay(filmed(rng, times_s), *sampled(rng, times_s, 0.6))
    assert found.delay_s == pytest.approx(0.6, abs=0.01)
    assert found.others_s[0] == pytest.approx(1.6, abs=0.05)


def test_a_light_that_the_channel_does_not_show_gives_one_sentence():
    rng = np.random.default_rng(7)
    light = filmed(rng, switching(rng))
    found = find_delay(light, *sampled(rng, switching(rng)))
    assert "the channel must show the voltage of the light" in found
    few = Edges(light.time_s[:5], light.std_s[:5], light.rising[:5])
    assert find_delay(few, *sampled(rng, switching(rng))).startswith("5 edges in the images")
    assert find_delay(light, few, (0.0, LENGTH_S)).startswith("5 edges in the channel")
    assert "0 edges" in find_delay(Edges.between([], []), few, (0.0, 1.0))


@pytest.mark.parametrize(
    "values",
    [
        np.random.default_rng(8).normal(size=5000),
        np.sin(np.linspace(0.0, 300.0, 5000)),
        np.full(100, 3.0),
        np.linspace(0.0, 1.0, 500),
    ],
    ids=["noise", "hum", "constant", "ramp"],
)
def test_what_does_not_switch_has_no_contrast(values):
    assert levels_of(values).contrast < LEAST_CONTRAST
