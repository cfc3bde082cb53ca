"""The voltage outputs: each disturbance alone has the declared size."""

import numpy as np
import pytest

from simulators.closed_machine.output import Draws, VoltageOutput
from simulators.closed_machine.settings import OutputSettings

TIMES_S = np.arange(0.0, 40.0, 0.0037) + 10.0


def volts(quantity=lambda time_s: 0.0, times_s=TIMES_S, seed=1, **settings):
    output = VoltageOutput(OutputSettings(full_scale=100.0, **settings), quantity, Draws(seed, 0))
    return np.array([output.volts(time_s) for time_s in times_s])


def test_full_scale_is_ten_volts():
    assert volts(lambda _: 100.0) == pytest.approx(10.0)
    assert volts(lambda _: -25.0, offset_v=0.5) == pytest.approx(-2.0)


@pytest.mark.parametrize(("delay_s", "jitter_s"), [(0.0, 0.0), (0.2, 0.0), (0.2, 0.02), (0.01, 0.02)])
def test_voltages_are_late_by_the_delay_and_its_jitter(delay_s, jitter_s):
    late_s = TIMES_S - 10.0 * volts(lambda time_s: time_s, delay_s=delay_s, jitter_s=jitter_s)
    assert np.abs(late_s - delay_s).max() <= jitter_s / 2 + 1e-9
    assert late_s.min() >= -1e-9
    assert late_s.mean() == pytest.approx(delay_s, abs=jitter_s / 50 + 1e-9)
    declared = OutputSettings(full_scale=1.0, delay_s=delay_s, jitter_s=jitter_s).delay_std_s
    assert late_s.std() == pytest.approx(declared, rel=0.05, abs=1e-9)


def test_nothing_is_shown_before_the_machine_was_switched_on():
    assert volts(lambda time_s: time_s, times_s=[0.0, 0.1], delay_s=1.0).tolist() == [0.0, 0.0]


def test_noise_is_white_and_has_its_standard_deviation():
    noise = volts(noise_v=0.01)
    assert noise.std() == pytest.approx(0.01, rel=0.03)
    assert np.corrcoef(noise[:-1], noise[1:])[0, 1] == pytest.approx(0.0, abs=0.03)


def test_hum_has_the_frequency_of_the_mains():
    hum = volts(hum_v=0.02)
    waves = np.column_stack([np.sin(2 * np.pi * 50.0 * TIMES_S), np.cos(2 * np.pi * 50.0 * TIMES_S)])
    parts, *_ = np.linalg.lstsq(waves, hum, rcond=None)
    assert np.hypot(*parts) == pytest.approx(0.02)
    assert waves @ parts == pytest.approx(hum, abs=1e-9)


def test_drift_is_per_hour():
    slope_v_s = np.polyfit(TIMES_S, volts(drift_v_h=3.6), 1)[0]
    assert slope_v_s == pytest.approx(0.001)


def test_the_amplifier_has_an_end_on_both_sides():
    ramp = volts(lambda time_s: 30.0 * (time_s - 30.0))
    assert (ramp.min(), ramp.max()) == (-10.5, 10.5)
    assert 0.1 < np.mean(np.abs(ramp) == 10.5) < 0.95


def test_values_depend_on_seed_and_time_alone():
    disturbed = {"noise_v": 0.1, "hum_v": 0.1, "delay_s": 0.1, "jitter_s": 0.02}
    forward = volts(lambda time_s: time_s, **disturbed)
    backward = volts(lambda time_s: time_s, times_s=TIMES_S[::-1], **disturbed)[::-1]
    assert forward.tolist() == backward.tolist()
    assert volts(lambda time_s: time_s, seed=2, **disturbed).tolist() != forward.tolist()
