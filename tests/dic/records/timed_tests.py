"""Tensile tests with the clocks of a machine and a camera, simulated without code of `dic`.

The crosshead moves at one speed. Its motion is the strain of the specimen plus that of the machine, which is
proportional to the stress. Before the test, everything is at rest; after it, the specimen may be unloaded.
"""

from dataclasses import dataclass

import numpy as np

AREA_MM2 = 20.0


@dataclass(frozen=True)
class TimedTest:
    """A test as the machine and the camera recorded it, and its true properties.

    `machine_s`, `load_n`: the machine's record. `image_s`, `strain`: images at the times 1, 2, ... intervals.
    A machine's time is `offset_s` plus `rate` times the time after the first image, plus its time.
    """

    machine_s: np.ndarray
    load_n: np.ndarray
    image_s: np.ndarray
    strain: np.ndarray
    interval_s: float
    offset_s: float
    rate: float
    e_gpa: float
    rp02_mpa: float

    def kept(self, images):
        """Return the test without the other images."""
        return TimedTest(**{**vars(self), "image_s": self.image_s[images], "strain": self.strain[images]})


def curve(kind, e_mpa, rng):
    """Return points of strain and stress, and the proof strength Rp0.2."""
    yield_mpa = e_mpa * rng.uniform(0.0015, 0.003)
    if kind == "ramberg-osgood":
        exponent = rng.uniform(12, 30)
        stress = np.linspace(0.0, yield_mpa * 25 ** (1 / exponent), 60_001)
        return stress / e_mpa + 0.002 * (stress / yield_mpa) ** exponent, stress, yield_mpa
    bend = yield_mpa / e_mpa
    if kind == "bilinear":
        hardening = rng.uniform(0.005, 0.05) * e_mpa
        # E (strain - 0.002) = yield + H (strain - bend)
        strain = (yield_mpa - hardening * bend + 0.002 * e_mpa) / (e_mpa - hardening)
        end_mpa = yield_mpa + hardening * (0.05 - bend)
        return np.array([0.0, bend, 0.05]), np.array([0.0, yield_mpa, end_mpa]), e_mpa * (strain - 0.002)
    upper = rng.uniform(1.02, 1.08)
    strain = np.array([0.0, upper * bend, upper * bend + 3e-4, bend + rng.uniform(0.008, 0.02), 0.06])
    return strain, yield_mpa * np.array([0.0, upper, 1.0, 1.0, 1.4]), yield_mpa


def timed_test(seed, *, unloaded=None, rate_error=0.01, late=(0.0, 1.0)):
    """Return a random test; the load is late by `late` intervals between images."""
    rng = np.random.default_rng(seed)
    e_mpa, kind = rng.choice([70e3, 200e3]), ("ramberg-osgood", "bilinear", "plateau")[seed % 3]
    strains, stresses, rp02_mpa = curve(kind, e_mpa, rng)
    interval_s, soft = rng.uniform(1.0, 5.0), rng.uniform(0.5, 6.0)
    ways = strains + soft * stresses / e_mpa
    speed = (1 + soft) * rp02_mpa / e_mpa / (rng.uniform(25, 60) * interval_s)
    rest_s, top = rng.uniform(3, 10) * interval_s, rng.uniform(0.008, 0.02)
    highest = np.interp(top, strains, stresses)
    end_s = rest_s + np.interp(top, strains, ways) / speed
    back_s = 0.9 * highest / e_mpa * (1 + soft) / speed
    unloaded = bool(rng.integers(2)) if unloaded is None else unloaded
    last_s = end_s + unloaded * (back_s + 5 * interval_s)

    def state(time_s):
        strain = np.interp(speed * np.clip(time_s - rest_s, 0.0, end_s - rest_s), ways, strains)
        fall = 0.9 * highest * np.clip((time_s - end_s) / back_s, 0.0, 1.0) * unloaded
        return strain - fall / e_mpa, np.interp(strain, strains, stresses) - fall

    rate, offset_s = 1 + rng.uniform(-rate_error, rate_error), rng.uniform(*late) * interval_s
    machine_s = np.arange(-3 * interval_s, last_s + 6 * interval_s, 1 / rng.uniform(10, 100))
    load_n = AREA_MM2 * state(np.minimum(machine_s, last_s))[1]
    load_n += AREA_MM2 * rp02_mpa * rng.uniform(3e-4, 2e-3) * rng.normal(size=len(machine_s))
    image_s = interval_s * np.arange(1, int(last_s / (interval_s * rate)))
    strain = state(image_s[0] + rate * (image_s - image_s[0]))[0]
    strain += rng.uniform(10e-6, 50e-6) * rng.normal(size=len(image_s))
    return TimedTest(
        machine_s + offset_s, load_n, image_s, strain, interval_s, offset_s, rate, e_mpa / 1e3, rp02_mpa
    )
