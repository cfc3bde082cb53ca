"""A strain rate is kept through yielding, on the simulated machine, with the noise of real live gauges."""

import numpy as np
import pytest

from tests.continuous.pulls import (
    AREA_MM2,
    AT_RATE,
    LENGTH_MM,
    LIVE,
    RATE_S,
    SEES,
    TINY,
    drive,
    protocol_text,
    rig_text,
)

MEAN_OFF, SECOND_OFF = 0.05, 0.20
REACHED, REACHED_WITHIN_S = 0.9, 12.0
"""The rate counts as reached after the first second with this part of it, which must come in this time."""
FRAMES = 10
PHASES = f"{AT_RATE}until.strain = 0.012\n"
NOISE = 8e-6
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


@pytest.mark.long
@pytest.mark.parametrize("machine_n_mm", [20_000.0, 30_000.0, 100_000.0])
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("law", ["kink", "round"])
def test_live_gauges_keep_a_strain_rate_through_yielding(machine_n_mm, seed, law, tmp_path):
    hardening = {} if law == "kink" else {"hardening": None} | RAMBERG_OSGOOD
    _, mean, rates = kept(tmp_path, {"machine_stiffness_n_mm": machine_n_mm} | hardening, seed, real=True)
    check(mean, rates)


BANDED = {"upper_mpa": 400.0, "lower_mpa": 375.0, "plateau_strain": 0.015}


@pytest.mark.parametrize(
    "band",
    [
        pytest.param({"band": {"start": "lower", "front_width_mm": 4.0}}, marks=pytest.mark.extended),
        pytest.param({}, marks=pytest.mark.long),
        pytest.param({"band": {"start": "upper", "front_width_mm": 10.0}}, marks=pytest.mark.long),
    ],
)
def test_discontinuous_yielding_goes_over_to_the_crosshead(band, tmp_path):
    ends = f"until.displacement_mm = 1.6\nuntil.strain = 0.05\nspeed_max_mm_s = {8 * RATE_S * LENGTH_MM}\n"
    phases = PHASES.replace("until.strain = 0.012\n", ends)
    text = rig_text({"front": TINY}, {"yield_point": BANDED | band}, seed=1)
    pulled = drive(tmp_path, protocol_text(phases, LIVE), text, noise=NOISE)
    assert pulled.outcome.status == "completed", pulled.outcome.reason
    speeds = speeds_of(pulled.commands)
    crosshead_mm_s = RATE_S * LENGTH_MM
    assert speeds[-1][1] == pytest.approx(crosshead_mm_s, rel=0.01)
    time_s, load_n, _ = np.array(pulled.states).T
    yields_s = time_s[np.argmax(load_n >= 0.999 * BANDED["upper_mpa"] * AREA_MM2)]
    over_s = next(at_s for at_s, speed in reversed(speeds) if abs(speed / crosshead_mm_s - 1.0) > 0.01)
    after = [speed for at_s, speed in speeds if at_s >= yields_s]
    print(
        f"{band}: from the upper yield strength to the crosshead's rate {over_s - yields_s:.2f} s, "
        f"greatest speed since {max(after) / crosshead_mm_s:.2f} times that rate, "
        f"highest load {load_n.max() / (BANDED['upper_mpa'] * AREA_MM2):.3f} of the upper yield load"
    )
    assert over_s - yields_s < 5.0
    assert max(speed for _, speed in speeds) <= 8.0 * crosshead_mm_s
    assert load_n.max() <= 1.001 * BANDED["upper_mpa"] * AREA_MM2


def speeds_of(commands):
    """Return the times and the speeds that were commanded while the machine moved."""
    return [(time_s, float(name.split()[1])) for time_s, name in commands if name.startswith("speed ")]
