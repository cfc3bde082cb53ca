"""Records of tensile tests with known properties, computed from textbook laws without code of `dic`."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Drawn:
    """A record of a test (strain without unit, stress in MPa, time in s), and its true properties."""

    time_s: np.ndarray
    strain: np.ndarray
    stress: np.ndarray
    e_mpa: float
    yield_mpa: float
    kind: str


def strain_of_stress(stress, e_mpa, yield_mpa, exponent):
    """Return the strain by the law of Ramberg and Osgood, with 0.2 % plastic strain at the yield stress."""
    return stress / e_mpa + 0.002 * (stress / yield_mpa) ** exponent


def with_plateau(strain, e_mpa, yield_mpa, plateau, hardening_mpa):
    """Return a stress that is linear up to the yield stress, constant on a plateau, and then saturates."""
    plastic = strain - yield_mpa / e_mpa - plateau
    return np.where(
        plastic > 0,
        yield_mpa + hardening_mpa * (1 - np.exp(-20 * np.maximum(plastic, 0))),
        np.minimum(e_mpa * strain, yield_mpa),
    )


def with_toe(strain, toe):
    """Return the specimen's true strain for a measured strain, if the grips settle at the beginning."""
    return np.where(strain < 2 * toe, strain**2 / (4 * toe), strain - toe)


def draw(seed, *, points=None):
    """Return a random record of a metal, with random toe, slack and noise, with or without a plateau."""
    rng = np.random.default_rng(seed)
    e_mpa = rng.uniform(65e3, 215e3)
    yield_mpa = e_mpa * rng.uniform(0.0012, 0.0035)
    points = points or int(rng.integers(120, 500))
    elastic = yield_mpa / e_mpa
    kind = ("plateau", "smooth")[int(rng.integers(2))]
    toe = rng.choice([0.0, rng.uniform(0.01, 0.08)]) * elastic
    slack = rng.choice([0.0, rng.uniform(0.02, 0.3)]) * elastic
    seen = np.concatenate([np.linspace(0, 1.6 * elastic, points), elastic * np.linspace(1.61, 10, 400)])
    loaded = np.maximum(seen - slack, 0.0)
    loaded = with_toe(loaded, toe) if toe else loaded
    if kind == "plateau":
        stress = with_plateau(loaded, e_mpa, yield_mpa, rng.uniform(0.005, 0.02), 0.4 * yield_mpa)
    else:
        exponent = rng.uniform(12, 40)
        grid = np.linspace(0, 1.4 * yield_mpa, 20001)
        stress = np.interp(loaded, strain_of_stress(grid, e_mpa, yield_mpa, exponent), grid)
    seen = seen + rng.normal(0, 10 ** rng.uniform(-6.3, -5.0), len(seen))
    stress = stress + rng.normal(0, yield_mpa * 10 ** rng.uniform(-4.5, -3.0), len(stress))
    offset = rng.uniform(-5e-4, 5e-4), rng.uniform(0, 0.005) * yield_mpa
    return Drawn(np.arange(len(seen)) * 0.1, seen + offset[0], stress + offset[1], e_mpa, yield_mpa, kind)


def with_yield_point():
    """Return strain and stress of a steel with an upper yield point, linear between known points.

    Young's modulus is 200 GPa, and ReH is 400 MPa at 0.2 %. Then follow a transient minimum of 376 MPa and a
    plateau with a lowest stress of 380 MPa at 1.0 %. The stress hardens at 3 GPa up to 440 MPa at 3 %, where
    the extensometer is removed. Rm is 500 MPa, and the record ends with the break.
    """
    strain = [0.0, 0.002, 0.0025, 0.003, 0.006, 0.010, 0.030]
    stress = [0.0, 400.0, 376.0, 386.0, 384.0, 380.0, 440.0]
    seen = np.concatenate([np.arange(0.0, 0.002, 1e-5), np.arange(0.002, 0.030, 2e-5)])
    rest = np.concatenate([np.linspace(440, 500, 300), np.linspace(500, 350, 298), [150, 0]])
    loaded = np.interp(seen, strain, stress)
    return np.concatenate([seen, np.full(600, np.nan)]), np.concatenate([loaded, rest])


@dataclass(frozen=True)
class PowerLaw:
    """A bar with the true stress K εⁿ at the true plastic strain ε, Poisson's ratio nu and strain ratio r."""

    e_mpa: float = 70e3
    k_mpa: float = 500.0
    n: float = 0.22
    nu: float = 0.33
    r: float = 1.6

    def record(self):
        """Return the engineering strains along and across the bar, and the engineering stress."""
        plastic = np.concatenate(
            [[0.0], np.geomspace(1e-12, 1e-3, 700), np.linspace(1.05e-3, 1.3 * self.n, 3000)]
        )
        true = self.k_mpa * plastic**self.n
        # Up to 40 % of the yield strength the plastic strains are below 10⁻⁶.
        along = plastic + true / self.e_mpa
        across = -self.r / (1 + self.r) * plastic - self.nu * true / self.e_mpa
        return np.expm1(along), np.expm1(across), true / np.exp(along)
