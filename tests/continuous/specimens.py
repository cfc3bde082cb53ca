"""Random specimens that are pulled without a stop, or in a ladder of steps, and the properties they show."""

import random
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dic import material_properties
from dic.derived import gauge_curve
from dic.gauges import GaugeImage, GaugeSeries, PointGauge, Reading
from dic.properties import Properties, PropertySettings
from dic.runfile.at_exposure import steps_at_exposure
from dic.runfile.reader import RunFile
from tests.continuous.pulls import AREA_MM2, LENGTH_MM, TINY, Pulled, drive, protocol_text, rig_text

NOISE, LOAD_STD_PERCENT = 1.5e-5, 0.3
POINT = PointGauge(name="point", at=(1, 1))
PULL = """
[[phases]]
do = "preload"
load_n = 100.0
rate_n_s = 100.0
[[phases]]
do = "pull"
displacement_mm = {end_mm:.3f}
elastic_n = {elastic_n:.0f}
images.every_s = 0.1
[[phases.stages]]
speed_mm_s = {slow_mm_s:.4f}
until.load_n = {over_n:.0f}
[[phases.stages]]
speed_mm_s = {fast_mm_s:.3f}
"""
LADDER = """
[[phases]]
do = "preload"
load_n = 100.0
rate_n_s = 100.0
[[phases]]
do = "to-load"
load_n = {below_n:.0f}
images.every_n = {increment_n:.0f}
rate_n_s = {rate_n_s:.0f}
[[phases]]
do = "to-displacement"
displacement_mm = {end_mm:.2f}
images.every_mm = {increment_mm:.3f}
speed_mm_s = {fast_mm_s:.3f}
"""


@dataclass
class Specimen:
    """A specimen, its rig, and the speeds of its test."""

    specimen: dict[str, object]
    rig_file: str
    values: dict[str, float]
    seed: int


def draw(seed: int) -> Specimen:
    """Draw a specimen with a random modulus, hardening, machine, speeds and delays of the exposures."""
    rng = random.Random(seed)
    strength, offset, exponent = rng.uniform(400, 850), rng.uniform(0.002, 0.008), rng.uniform(0.1, 0.2)
    specimen = {
        "youngs_modulus_mpa": rng.uniform(60_000.0, 215_000.0),
        "machine_stiffness_n_mm": rng.uniform(20_000.0, 80_000.0),
        "grip_slip_mm": rng.uniform(0.0, 0.1),
        "hardening": {
            "law": "swift",
            "strength_mpa": strength,
            "offset_strain": offset,
            "exponent": exponent,
        },
        "fracture_strain": float(np.exp(exponent)) - 1.0 + 0.03,
    }
    yield_n = strength * offset**exponent * AREA_MM2
    jitter_us = rng.uniform(0.0, 10_000.0)
    # The delay is drawn from the distribution that the stamps state; only the part that varies is jitter.
    camera = TINY | {
        "delay_us": rng.uniform(0.0, 5_000.0),
        "jitter_us": jitter_us,
        "stamp": "meant",
        "stamp_std_us": float(np.hypot(5_000.0, jitter_us) / np.sqrt(3.0)),
    }
    text = rig_text(
        {"front": camera}, specimen, seed=seed, load_cell={"error_percent": rng.gauss(0.0, LOAD_STD_PERCENT)}
    )
    values = {
        "elastic_n": 0.5 * yield_n,
        "over_n": 1.15 * yield_n,
        "slow_mm_s": rng.uniform(0.04, 0.1),
        "fast_mm_s": rng.uniform(0.4, 1.0),
        # beyond the yield load a ladder goes on by displacement
        "below_n": 0.9 * yield_n,
        "increment_n": 0.9 * yield_n / 18.0,
        "rate_n_s": yield_n / 20.0,
        # just beyond the strain of the largest load
        "end_mm": float(np.exp(exponent) - 1.0) * LENGTH_MM + 0.4,
        "increment_mm": float(np.exp(exponent) - 1.0) * LENGTH_MM / 50.0,
    }
    return Specimen(specimen, text, values, seed)


def measured(folder: Path, specimen: Specimen, phases: str) -> tuple[Pulled, Properties]:
    """Execute a test, and return it with the properties by loads of the record and strains of the images."""
    pulled = drive(folder, protocol_text(phases.format(**specimen.values)), specimen.rig_file)
    true = {each["sequence"]: each["strain"] for each in pulled.exposures}
    with RunFile(pulled.path) as run:
        steps = [
            step for step in steps_at_exposure(run)["front"].steps if step.kind not in ("reference", "static")
        ]
        own = {step.index: step for step in run.steps}
        numbers = run.columns("instrument/front", "sequence")["sequence"]
        strains = [
            float(np.mean([true[int(numbers[row])] for row in run.rows("front", own[step.index])]))
            for step in steps
        ]
    rng = np.random.default_rng([specimen.seed, 7])
    images = tuple(
        GaugeImage(
            f"step {step.index}",
            {"point": {"raw": Reading("px", strain=strain + NOISE * rng.normal())}},
            step.known(),
        )
        for step, strain in zip(steps, strains, strict=True)
    )
    read = gauge_curve(GaugeSeries("run.results.h5", (POINT,), images), "point")
    settings = PropertySettings(AREA_MM2, load_std_percent=LOAD_STD_PERCENT)
    return pulled, read.judged(material_properties(read.curve, settings))
