"""A strain rate is kept through yielding, on the simulated machine, with the noise of real live gauges."""

import numpy as np

from tests.rig.continuous.pulls import GAUGE, LENGTH_MM, RATE_S, SEES, TINY, drive, protocol_text, rig_text

MEAN_OFF, SECOND_OFF = 0.05, 0.20
REACHED, REACHED_WITHIN_S = 0.9, 12.0
"""The rate counts as reached after the first second with this part of it, which must come in this time."""
FRAMES = 10
PHASES = f"""
[[phases]]
do = "preload"
load_n = 200.0
rate_n_s = 100.0
[[phases]]
do = "pull"
displacement_mm = 18.0
elastic_n = 3000.0
images.every_s = 0.5
[[phases.stages]]
strain_rate_s = {RATE_S}
gauge = "axial"
parallel_length_mm = {LENGTH_MM}
until.strain = 0.012
"""
LIVE = f"""
[live]
gauges = ["{GAUGE}"]
subset_px = 31
motion = "free"
"""
NOISE = 8e-6
STIFFNESSES_N_MM = (12_000.0, 30_000.0, 100_000.0)
ROUND = {"law": "voce", "saturation_mpa": 520.0, "initial_mpa": 330.0, "strain_scale": 0.03}
RAMBERG_OSGOOD = {"yield_stress_mpa": 380.0, "ultimate_stress_mpa": 620.0, "ultimate_strain": 0.12}


def kept(folder, specimen, seed, *, real, phases=PHASES):
    """Execute a test; return it, and the true strain rates over whole seconds as parts of the wanted one."""
    text = rig_text({"front": SEES if real else TINY}, specimen, seed=seed)
    pulled = drive(folder, protocol_text(phases, LIVE), text, noise=None if real else NOISE, seed=seed)
    assert pulled.outcome.status == "completed", pulled.outcome.reason
    moves = [time_s for time_s, name in pulled.commands if name.startswith("displacement ")]
    ends = [time_s for time_s, name in pulled.commands if name == "hold" and time_s > moves[0]]
    time_s, strain = pulled.strains.T
    inside = (time_s >= moves[0]) & (time_s <= ends[0])
    time_s, strain = time_s[inside], strain[inside]
    # every second that begins with a frame
    rates = (strain[FRAMES:] - strain[:-FRAMES]) / (time_s[FRAMES:] - time_s[:-FRAMES]) / RATE_S
    reached = int(np.argmax(rates >= REACHED))
    assert rates[reached] >= REACHED
    assert time_s[reached] - moves[0] <= REACHED_WITHIN_S
    time_s, strain, rates = time_s[reached:], strain[reached:], rates[reached:]
    mean = (strain[-1] - strain[0]) / (time_s[-1] - time_s[0]) / RATE_S
    return pulled, mean, rates


def check(mean, rates):
    print(f"strain rate: mean {mean:.3f}, seconds {rates.min():.3f} to {rates.max():.3f} ({len(rates)})")
    assert len(rates) > 200
    assert abs(mean - 1.0) <= MEAN_OFF
    assert np.abs(rates - 1.0).max() <= SECOND_OFF


def test_a_strain_rate_is_kept_through_yielding(tmp_path):
    _, mean, rates = kept(tmp_path, {}, 1, real=False)
    check(mean, rates)
