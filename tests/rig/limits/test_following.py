"""The load must follow the crosshead. This check passes correct specimens and finds stuck load cells."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from rig.errors import ImplausibleReading
from rig.limits.following import Following, History
from rig.protocol.step import RigReading

NOISE_N, NOISE_MM = 2.0, 0.2e-3
STIFFNESS_N_MM = 12_000.0


def following(increment_n: float, start: RigReading, **settings) -> Following:
    known = {"history": History(STIFFNESS_N_MM), "elastic_n": 0.0, "flow_mm": 0.0} | settings
    return Following(start, outward=1.0, increment_n=increment_n, noise_n=NOISE_N, noise_mm=NOISE_MM, **known)


def pull(
    check: Following,
    displacement_mm: Callable[[float], float],
    increment_n: float,
    seed: int = 0,
    stuck_from_n: float = math.inf,
) -> float:
    """Check noisy readings of a load increment; return the true load, N, at which an error stops it."""
    rng = np.random.default_rng(seed)
    for load_n in np.arange(0.0, 1.2 * increment_n, 0.003 * increment_n):
        shown_n = min(load_n, stuck_from_n) + NOISE_N * rng.standard_normal()
        shown_mm = displacement_mm(load_n) + NOISE_MM * rng.standard_normal()
        try:
            check.check(RigReading(0.0, shown_n, shown_mm), "step 3")
        except ImplausibleReading:
            return float(load_n)
    return math.inf


def linear(load_n: float) -> float:
    return load_n / STIFFNESS_N_MM


def bilinear(ratio: float, yield_n: float) -> Callable[[float], float]:
    """Return the displacement function of a specimen that keeps `ratio` of its stiffness above `yield_n`."""
    return lambda load_n: linear(load_n) + max(load_n - yield_n, 0.0) * (1.0 / ratio - 1.0) / STIFFNESS_N_MM


@pytest.mark.parametrize(
    "increment_n", [250.0, *(pytest.param(each, marks=pytest.mark.extended) for each in (500.0, 2000.0))]
)
def test_noise_stops_no_elastic_specimen(increment_n):
    for seed in range(100):
        check = following(increment_n, RigReading(0.0, 0.0, 0.0))
        assert pull(check, linear, increment_n, seed) == math.inf, seed
        assert check.stiffness_n_mm == pytest.approx(STIFFNESS_N_MM, rel=0.25)


@pytest.mark.parametrize(("increment_n", "overload_max"), [(500.0, 0.13), (2000.0, 0.10)])
def test_a_load_cell_that_is_stuck_is_noticed_in_spite_of_its_noise(increment_n, overload_max):
    for seed in range(100):
        stuck_n = (0.1 + 0.008 * seed) * increment_n
        highest_n = pull(
            following(increment_n, RigReading(0.0, 0.0, 0.0)), linear, increment_n, seed, stuck_n
        )
        assert highest_n - stuck_n < overload_max * increment_n, seed


def test_a_specimen_that_hardens_to_its_ultimate_stress_is_not_stopped():
    # Ramberg and Osgood with an exponent of 25, as polycarbonate, to 1.15 of the yield load
    increment_n, yield_n = 600.0, 3000.0
    start_n = 1.15 * yield_n - increment_n

    def curve(load_n: float) -> float:
        return load_n / 1200.0 + 0.1 * (load_n / yield_n) ** 25

    for seed in range(100):
        check = following(
            increment_n,
            RigReading(0.0, 0.0, 0.0),
            history=History(1200.0),
        )
        moved = lambda load_n: curve(start_n + min(load_n, increment_n)) - curve(start_n)  # noqa: E731
        assert pull(check, moved, increment_n / 1.2, seed) == math.inf, seed


def test_a_metal_that_yields_suddenly_is_not_stopped():
    for seed in range(100):
        check = following(2000.0, RigReading(0.0, 0.0, 0.0))
        assert pull(check, bilinear(0.15, 800.0), 2000.0, seed) == math.inf, seed


def test_a_specimen_that_is_loaded_again_yields_as_softly_as_before():
    history = History(STIFFNESS_N_MM, highest_n=800.0, beyond_n_mm=0.03 * STIFFNESS_N_MM)
    for seed in range(100):
        check = following(2000.0, RigReading(0.0, 0.0, 0.0), history=history)
        assert pull(check, bilinear(0.03, 800.0), 2000.0, seed) == math.inf, seed


def test_a_yield_plateau_is_allowed_by_the_protocol_only():
    plateau = lambda load_n: linear(load_n) + (0.5 if load_n > 800.0 else 0.0)  # noqa: E731
    assert pull(following(2000.0, RigReading(0.0, 0.0, 0.0)), plateau, 2000.0) < 0.5 * 2000.0
    allowed = following(2000.0, RigReading(0.0, 0.0, 0.0), flow_mm=0.6)
    assert pull(allowed, plateau, 2000.0) == math.inf
