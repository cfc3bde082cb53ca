"""A load cell that begins to lie while a specimen is loaded: without a stop, or in steps of load."""

import random
from dataclasses import dataclass
from pathlib import Path

from tests.continuous.pulls import AREA_MM2, TINY, drive, protocol_text, rig_text

MODULUS_MPA, YIELD_MPA, LENGTH_MM = 205_000.0, 360.0, 60.0
YIELD_N = YIELD_MPA * AREA_MM2
INCREMENT_N = round(YIELD_N / 8.0)
STEPS = """
[[phases]]
do = "to-load"
load_n = {end_n:.0f}
images.every_n = {increment_n:.0f}
rate_n_s = {rate_n_s:.0f}
"""
PULL = """
[[phases]]
do = "pull"
displacement_mm = {end_mm:.3f}
elastic_n = {elastic_n:.0f}
images.every_s = 0.5
[[phases.stages]]
speed_mm_s = {speed_mm_s:.5f}
until.load_n = {end_n:.0f}
"""


@dataclass
class Overload:
    """How far the true load went after the load cell began to lie.

    `beyond_n` is the largest true load above that at the beginning, `highest_n` the largest one.
    """

    status: str
    reason: str
    begun_n: float
    beyond_n: float
    highest_n: float


def drive_lying(folder: Path, lie: str, seed: int, *, steps: bool) -> Overload:
    """Execute a test whose load cell begins to lie at a random load below the yield load."""
    rng = random.Random(seed)
    machine_n_mm, begin_n = rng.uniform(15_000.0, 80_000.0), rng.uniform(0.15, 0.8) * YIELD_N
    of_specimen_n_mm = MODULUS_MPA * AREA_MM2 / LENGTH_MM
    stiffness_n_mm = 1.0 / (1.0 / machine_n_mm + 1.0 / of_specimen_n_mm)
    rate_n_s = INCREMENT_N / 10.0
    values = {
        "end_n": 0.95 * YIELD_N,
        "increment_n": INCREMENT_N,
        "rate_n_s": rate_n_s,
        "speed_mm_s": rate_n_s / stiffness_n_mm,
        "elastic_n": 0.9 * YIELD_N,
        "end_mm": 1.2 * YIELD_N / stiffness_n_mm + 0.3,
    }
    begun: list[float] = []

    def look(rig) -> None:
        load_n = rig.load_frame.load_n()
        if not begun and load_n >= begin_n:
            rig.faults.switch_on(f"load_frame.{lie}")
            begun.append(load_n)

    text = rig_text(
        {"front": TINY}, {"machine_stiffness_n_mm": machine_n_mm, "grip_slip_mm": 0.02}, seed=seed
    )
    pulled = drive(folder, protocol_text((STEPS if steps else PULL).format(**values)), text, look=look)
    assert begun, f"the test ended before the load cell lied: {pulled.outcome.reason}"
    highest_n = max(load_n for _, load_n, _ in pulled.states)
    return Overload(pulled.outcome.status, pulled.outcome.reason, begun[0], highest_n - begun[0], highest_n)
