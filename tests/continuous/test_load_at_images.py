"""The load at the middle of each exposure while the machine pulls, beside the true load."""

import random

import numpy as np
import pytest

from dic.runfile.at_exposure import steps_at_exposure
from dic.runfile.reader import RunFile
from tests.continuous.pulls import TINY, drive, protocol_text, rig_text

PHASES = """
[[phases]]
do = "preload"
load_n = 500.0
rate_n_s = 100.0
[[phases]]
do = "pull"
displacement_mm = 18.0
elastic_n = 5000.0
images.every_s = 0.2
[[phases.stages]]
speed_mm_s = 0.02
until.load_n = 3000
[[phases.stages]]
speed_mm_s = SPEED
until.displacement_mm = 2.0
"""
JITTER_US, DELAY_S = 20_000.0, (0.0, 0.04)
STAMP = {"jitter_us": JITTER_US, "stamp": "meant", "stamp_std_us": JITTER_US / np.sqrt(3.0)}
"""Exposures begin late by up to the jitter; their stamps do not know it, and state its root mean square."""


def errors_of(folder, speed_mm_s, seed, *, jitter):
    """Pull; return error and standard deviation of the load of each image, and changes between readings."""
    rng = random.Random(seed)

    def look(rig):
        if jitter:
            rig.faults.switch_on(f"load_frame.delay:{rng.uniform(*DELAY_S):.4f}")

    noise = {"load_cell": {"noise_n": 2.0 if jitter else 0.0}}
    text = rig_text({"front": TINY | (STAMP if jitter else {})}, {"grip_slip_mm": 0.02}, seed=seed, **noise)
    phases = PHASES.replace("SPEED", f"{speed_mm_s:g}")
    pulled = drive(folder, protocol_text(phases), text, look=look)
    assert pulled.outcome.status == "completed", pulled.outcome.reason
    true_n = {each["sequence"]: each["load_n"] for each in pulled.exposures}
    with RunFile(pulled.path) as run:
        steps = [step for step in steps_at_exposure(run)["front"].steps if step.kind == "acquired"]
        numbers = run.columns("instrument/front", "sequence")["sequence"]
        own = {step.index: step for step in run.steps}
        rows = [next(iter(run.rows("front", own[step.index]))) for step in steps]
        readings = run.columns("instrument/load_frame", "time_s", "load_n")
    error_n = np.array(
        [step.load_n - true_n[int(numbers[row])] for step, row in zip(steps, rows, strict=True)]
    )
    std_n = np.array([step.load_std_n for step in steps])
    at = np.searchsorted(readings["time_s"], [step.time_s for step in steps]).clip(
        1, len(readings["time_s"]) - 1
    )
    change_n = np.abs(readings["load_n"][at] - readings["load_n"][at - 1])
    return error_n, std_n, change_n


def test_without_jitter_the_load_is_exact_to_a_hundredth_of_a_reading(tmp_path):
    error_n, _, change_n = errors_of(tmp_path, 0.05, 1, jitter=False)
    share = np.abs(error_n[1:]) / change_n[1:]
    print(
        f"{len(share)} images: median {np.median(share):.2%} of the change between two readings, "
        f"most {share.max():.2%}"
    )
    # The simulated machine moves in steps of 20 ms, which alone are worth 1.0 %.
    assert len(share) > 150
    assert np.median(share) <= 0.001
    assert share.max() <= 0.011


@pytest.mark.long
@pytest.mark.parametrize(("speed_mm_s", "seed"), [(0.05, 1), (0.2, 2)])
def test_with_jitter_and_delay_the_error_of_the_load_is_as_stated(speed_mm_s, seed, tmp_path):
    error_n, std_n, _ = errors_of(tmp_path, speed_mm_s, seed, jitter=True)
    within = np.mean(np.abs(error_n) <= 1.96 * std_n)
    print(
        f"{len(error_n)} images: {within:.1%} within 1.96 standard deviations, "
        f"rms z {np.sqrt(np.mean((error_n / std_n) ** 2)):.2f}"
    )
    assert within >= 0.95
