"""Simulated tension tests whose load cell reads wrong values. The simulated machine knows the true load."""

import random
import tomllib
from collections.abc import Callable
from dataclasses import dataclass, field
from math import exp, log, nan
from pathlib import Path

import pytest

from drivers.settings import toml_table
from rig import Outcome, run_protocol
from simulators.rig.virtual_rig import VirtualRig
from tests.places import example

LIES = ("zero-load", "tenth-load", "reversed-load", "stuck-load", "drifting-load")
ALL_LOADS = [
    *LIES[1:3],
    *(pytest.param(lie, marks=pytest.mark.extended) for lie in (LIES[0], LIES[3])),
]
"""Lies about any load: one too small and one of the wrong sign in the first part, all in the second."""

# Young's modulus, yield stress, ultimate stress in MPa, strain at the ultimate stress
MATERIALS = {
    "polycarbonate": (2_400.0, 65.0, 75.0, 0.10),
    "polyamide with glass": (9_000.0, 120.0, 140.0, 0.06),
    "magnesium": (45_000.0, 160.0, 240.0, 0.12),
    "2024-T3": (73_100.0, 345.0, 483.0, 0.15),
    "titanium": (114_000.0, 880.0, 950.0, 0.12),
    "mild steel": (205_000.0, 300.0, 450.0, 0.20),
    "spring steel": (210_000.0, 900.0, 1_000.0, 0.10),
}

FRACTURE_BEYOND = 0.05
"""Strain between the ultimate stress and the break of a specimen."""


@dataclass
class Case:
    """A random specimen in a random machine, with a suitable protocol and rig file."""

    material: str
    width_mm: float
    thickness_mm: float
    length_mm: float
    machine_n_mm: float
    slip_mm: float
    increments: int
    seed: int
    declares: bool = True
    increment_n: float = 0.0
    yield_n: float = 0.0
    slip_load_n: float = field(init=False)

    def __post_init__(self) -> None:
        self.yield_n = MATERIALS[self.material][1] * self.width_mm * self.thickness_mm
        self.increment_n = round(1.15 * self.yield_n / self.increments, -1)
        # grips draw in over the first increment, and a little longer
        self.slip_load_n = 0.7 * self.increment_n

    @property
    def compliance_mm_n(self) -> float:
        """Elastic compliance of specimen and machine in series."""
        area_mm2 = self.width_mm * self.thickness_mm
        return self.length_mm / (MATERIALS[self.material][0] * area_mm2) + 1.0 / self.machine_n_mm

    def needed_mm(self, load_n: float) -> float:
        """Return the displacement at a load of the first loading, by the virtual specimen's formulas."""
        slip_mm = self.slip_mm * (1.0 - exp(-load_n / self.slip_load_n))
        return load_n * self.compliance_mm_n + slip_mm + self._plastic(load_n) * self.length_mm

    def strain(self, load_n: float) -> float:
        """Return the strain at a load of the first loading, from the formulas of the virtual specimen."""
        modulus = MATERIALS[self.material][0]
        return load_n / (modulus * self.width_mm * self.thickness_mm) + self._plastic(load_n)

    def _plastic(self, load_n: float) -> float:
        modulus, yielding, ultimate, strain = MATERIALS[self.material]
        exponent = log((strain - ultimate / modulus) / 0.002) / log(ultimate / yielding)
        return float(0.002 * (max(load_n, 0.0) / self.yield_n) ** exponent)

    @property
    def survives(self) -> bool:
        """True if an increment of load is clearly plastic before the specimen breaks."""
        stiffest_n_mm = 0.0
        for number in range(1, self.increments + 4):
            load_n = number * self.increment_n
            stiffness_n_mm = self.increment_n / (
                self.needed_mm(load_n) - self.needed_mm(load_n - self.increment_n)
            )
            stiffest_n_mm = max(stiffest_n_mm, stiffness_n_mm)
            if number > 1 and load_n > 0.6 * self.yield_n and stiffness_n_mm < 0.8 * stiffest_n_mm:
                return self.strain(load_n) < MATERIALS[self.material][3] + FRACTURE_BEYOND
        return False

    def protocol(self) -> str:
        table = tomllib.loads(example("tension"))
        # Polycarbonate is strained by 0.1 before the criterion calls it plastic, and breaks at 0.15.
        soft = self.material == "polycarbonate"
        total_mm = 0.5 + 0.12 * self.length_mm if soft else 2.0 + 0.05 * self.length_mm
        increment_n = self.increment_n
        table["sample"] |= {
            "width_mm": self.width_mm,
            "thickness_mm": self.thickness_mm,
            "gauge_length_mm": self.length_mm,
        }
        plastic = {"stiffness_fraction": 0.8, "judged_above_n": 0.6 * self.yield_n}
        table["loading"] |= {
            "increment_n": increment_n,
            "increments_max": self.increments + 3,
            "rate_n_s": increment_n / 10.0,
            "plastic": plastic,
        }
        table["stretching"] |= {
            "increment_mm": total_mm / 2.0,
            "total_mm": total_mm,
            "speed_mm_s": total_mm / 60.0,
        }
        table["settle"] |= {"load_tolerance_n": max(10.0, 0.01 * increment_n)}
        table["limits"] |= {
            "load_max_n": increment_n * (self.increments + 4),
            "displacement_max_mm": total_mm + 0.2,
            "break_load_drop": 0.3,
        }
        table["loading"] |= {
            "tare_max_n": 0.08 * increment_n,
        }
        if self.declares:
            modulus = MATERIALS[self.material][0]
            table["plausible"] = {"modulus_min_mpa": modulus / 1.25, "modulus_max_mpa": modulus * 1.25}
        return _toml(table)

    def rig(self) -> str:
        modulus, yielding, ultimate, strain = MATERIALS[self.material]
        specimen = {
            "width_mm": self.width_mm,
            "thickness_mm": self.thickness_mm,
            "parallel_length_mm": self.length_mm,
            "youngs_modulus_mpa": modulus,
            "yield_stress_mpa": yielding,
            "ultimate_stress_mpa": ultimate,
            "ultimate_strain": strain,
            "fracture_strain": strain + FRACTURE_BEYOND,
            "grip_slip_mm": self.slip_mm,
            "grip_slip_load_n": self.slip_load_n,
            "machine_stiffness_n_mm": self.machine_n_mm,
        }
        tables = {
            "rig": {"name": "a rig of the campaign", "call_timeout_s": 45.0},
            "simulation": {"driver": "virtual-rig", "seed": self.seed, "specimen": specimen},
            "cameras": {"only": {"driver": "simulated-camera", "width_px": 64, "height_px": 64}},
            "load_frame": {
                "driver": "modbus-frame",
                "address": "@load_frame",
                "load_max_n": 49_000.0,
                "displacement_max_mm": 20.0,
                "load_rate_max_n_s": 5_000.0,
                # The reply needs real time, which a busy computer may not have.
                "reply_timeout_s": 20.0,
            },
            "operator": {"driver": "simulated-operator"},
        }
        if self.declares:
            tables["limits"] = {
                "machine_stiffness_min_n_mm": self.machine_n_mm / 1.25,
                "machine_stiffness_max_n_mm": self.machine_n_mm * 1.25,
                "seating_mm": 1.25 * self.slip_mm,
            }
            if self.slip_mm:
                tables["limits"]["seating_stiffness_n_mm"] = self.slip_load_n / self.slip_mm / 1.25
        return _toml(tables)


def draw(rng: random.Random) -> Case:
    """Draw a specimen, a machine and an increment. A load frame of 50 kN must be able to make the specimen
    yield."""
    while True:
        case = Case(
            material=rng.choice(sorted(MATERIALS)),
            width_mm=round(rng.uniform(8.0, 30.0), 1),
            thickness_mm=round(rng.uniform(0.8, 3.0), 2),
            length_mm=round(rng.uniform(40.0, 100.0), 1),
            machine_n_mm=round(rng.uniform(8_000.0, 60_000.0)),
            slip_mm=rng.choice([0.0, round(rng.uniform(0.05, 0.6), 2)]),
            increments=rng.randint(4, 8),
            seed=rng.randrange(1000),
        )
        # With a noise of 2 N, less than 100 standard deviations cannot be told from a tenth.
        fits = case.increment_n >= 250.0 and case.increment_n * (case.increments + 4) < 45_000.0
        # An increment may lead from an elastic specimen beyond its ultimate stress: no honest test can end.
        if fits and case.survives:
            return case


@dataclass
class Result:
    """The result of a test: its outcome, the largest true load and displacement, and the last target."""

    outcome: Outcome
    increment_n: float
    highest_n: float
    farthest_mm: float
    target_n: float
    stretched: bool

    @property
    def over(self) -> float:
        """Overload: largest true load above the last target, as a fraction of an increment.

        NaN if the test went on to displacement increments.
        """
        return nan if self.stretched else (self.highest_n - self.target_n) / self.increment_n


def drive(
    case: Case, folder: Path, monkeypatch, lie: str = "", when: Callable[[float], bool] = bool
) -> Result:
    """Execute a test. After the tare, the load cell becomes wrong when `when(true load)` is first true."""
    folder.mkdir(exist_ok=True, parents=True)
    (folder / "protocol.toml").write_text(case.protocol())
    (folder / "rig.toml").write_text(case.rig())
    rigs: list[VirtualRig] = []
    build = VirtualRig.__init__

    def built(rig: VirtualRig, *args, **kwargs) -> None:
        build(rig, *args, **kwargs)
        rigs.append(rig)

    truth: list[tuple[float, float]] = []
    pending = [lie] if lie else []

    def on_progress(_may_move: bool) -> None:
        frame = rigs[0].load_frame
        truth.append((frame.load_n(), frame.displacement_mm()))
        if pending and any(name == "tare" for _, name in frame.executed) and when(frame.load_n()):
            rigs[0].faults.switch_on(f"load_frame.{pending.pop()}")

    with monkeypatch.context() as patch:
        patch.setattr(VirtualRig, "__init__", built)
        outcome = run_protocol(
            folder / "protocol.toml", folder / "rig.toml", folder / "run.h5", on_progress=on_progress
        )
    frame = rigs[0].load_frame
    truth.append((frame.load_n(), frame.displacement_mm()))
    loads = [name for _, name in frame.executed if name.startswith("load ")]
    target_n = float(loads[-1].split()[1]) if loads else 0.0
    return Result(
        outcome,
        case.increment_n,
        max(n for n, _ in truth),
        max(mm for _, mm in truth),
        target_n,
        any(name.startswith("displacement ") for _, name in frame.executed),
    )


def _toml(tables: dict) -> str:
    lone = {key: value for key, value in tables.items() if not isinstance(value, dict)}
    head = [toml_table(["x"], lone).partition("\n")[2]] if lone else []
    parts = []
    for name, table in tables.items():
        if name == "cameras":
            parts += [toml_table([name, each], settings) for each, settings in table.items()]
        elif isinstance(table, dict):
            parts.append(toml_table([name], table))
    return "\n\n".join([*head, *parts]) + "\n"
