"""Times of samples on the rig's clock, against a device whose clock and transport are known."""

import numpy as np
import pytest

from drivers.errors import DeviceFault
from drivers.signals import Samples
from rig.channels.time_line import TimeLine

RATE_HZ, BLOCK_S = 100.0, 0.1


def errors_in_std(drift, transport_s, seconds, rng):
    """Return the errors of the times of all blocks in their standard deviations, and the errors in s.

    The device's clock is off by 1000 s at the beginning, and goes wrong by `drift`. A block arrives
    ``transport_s(rng)`` after its last sample.
    """
    line, found, errors_s = TimeLine("channels.box"), [], []
    for first in range(0, round(seconds * RATE_HZ), round(BLOCK_S * RATE_HZ)):
        true_s = (first + np.arange(round(BLOCK_S * RATE_HZ))) / RATE_HZ
        device_s = 1000.0 + true_s * (1.0 + drift)
        received_s = true_s[-1] + transport_s(rng)
        values = np.zeros((len(true_s), 1))
        time_s, std_s = line.of(Samples(values, first, received_s, device_s=device_s))
        errors_s.append(time_s[-1] - true_s[-1])
        found.append(errors_s[-1] / std_s[-1])
    return np.array(found), np.array(errors_s)


TRANSPORTS = {
    "USB": lambda rng: 0.001 + rng.exponential(0.004),
    "network with jitter of 20 ms": lambda rng: 0.0005 + abs(rng.normal(0.0, 0.02)),
    "a busy computer": lambda rng: (
        0.001 + rng.exponential(0.002) + (rng.random() < 0.1) * rng.uniform(0.0, 0.3)
    ),
}


@pytest.mark.parametrize("transport", TRANSPORTS)
@pytest.mark.parametrize("drift", [0.0, 5e-5, -2e-4])
def test_times_are_within_their_standard_deviations(transport, drift):
    rng = np.random.default_rng(5)
    z, errors_s = errors_in_std(drift, TRANSPORTS[transport], 90.0, rng)
    assert np.mean(np.abs(z) <= 2.0) >= 0.95
    assert np.abs(errors_s[200:]).max() < 0.01


def test_a_sample_that_was_asked_for_lies_between_question_and_answer():
    rng, line = np.random.default_rng(6), TimeLine("channels.meter")
    z = []
    for k in range(500):
        asked_s, received_s = k * 0.1, k * 0.1 + rng.uniform(0.002, 0.05)
        true_s = rng.uniform(asked_s, received_s)
        (time_s,), (std_s,) = line.of(Samples(np.zeros((1, 1)), k, received_s, asked_s))
        z.append((time_s - true_s) / std_s)
    assert np.std(z) == pytest.approx(1.0, abs=0.1)


def test_a_clock_that_runs_backwards_is_a_fault():
    line = TimeLine("channels.box")
    line.of(Samples(np.zeros((1, 1)), 0, 5.0, device_s=np.array([100.0])))
    with pytest.raises(DeviceFault, match="switched off and on"):
        line.of(Samples(np.zeros((1, 1)), 1, 6.0, device_s=np.array([0.0])))
