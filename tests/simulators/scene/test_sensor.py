import numpy as np
import pytest

from simulators.scene.sensor import Sensor


def sensor(bits=8, **changes):
    values = {"full_well_e": 32_500.0, "read_noise_e": 20.0, "saturation_exposure_us": 12_000.0, **changes}
    return Sensor(bits=bits, **values)


def flat(reflectance, shape=(400, 400)):
    return np.full(shape, reflectance)


@pytest.mark.parametrize(("bits", "reflectance"), [(8, 0.6), (8, 0.2), (12, 0.6), (12, 0.02)])
def test_noise_follows_photon_statistics(bits, reflectance):
    grey = sensor(bits).expose(flat(reflectance), 10_000, 1.0, np.random.default_rng(1)).astype(float)
    electrons = reflectance * 32_500 * 10 / 12
    grey_per_electron = (2**bits - 1) / 32_500
    variance = (electrons + 20**2) * grey_per_electron**2 + 1 / 12
    assert grey.mean() == pytest.approx(electrons * grey_per_electron, abs=5 * np.sqrt(variance) / 400)
    assert grey.var() == pytest.approx(variance, rel=0.03)


def test_noise_is_one_grey_level_in_mid_grey():
    grey = sensor().expose(flat(0.6), 10_000, 1.0, np.random.default_rng(2)).astype(float)
    assert grey.mean() == pytest.approx(127.5, abs=1)
    assert 0.9 < grey.std() < 1.15


@pytest.mark.parametrize(("bits", "dtype", "highest"), [(8, np.uint8, 255), (12, np.uint16, 4095)])
def test_too_much_light_saturates_at_the_highest_level(bits, dtype, highest):
    grey = sensor(bits).expose(flat(0.9), 100_000, 1.0, np.random.default_rng(3))
    assert grey.dtype == dtype
    assert np.all(grey == highest)


def test_darkness_ends_at_zero():
    grey = sensor(read_noise_e=2000).expose(flat(0.0), 10_000, 1.0, np.random.default_rng(4))
    assert 0.4 < np.mean(grey == 0) < 0.6
    assert grey.max() < 120


def test_gain_brightens_what_the_well_did_not_fill():
    rng = np.random.default_rng(5)
    once = sensor().expose(flat(0.3), 6_000, 1.0, rng).mean()
    twice = sensor().expose(flat(0.3), 6_000, 2.0, rng).mean()
    longer = sensor().expose(flat(0.3), 12_000, 1.0, rng).mean()
    assert twice == pytest.approx(2 * once, rel=1e-3)
    assert longer == pytest.approx(2 * once, rel=1e-3)
