"""Tests of the objective elastic slope: the rule, the agreement with simple code, and the accuracy."""

import numpy as np
import pytest

from dic.properties.curve import Curve
from dic.properties.elastic import elastic_line
from dic.properties.objective_slope import objective_slope
from dic.properties.properties import material_properties
from dic.properties.record import record_of
from dic.properties.settings import PropertySettings
from tests.dic.properties.brute_force import slope_by_brute_force
from tests.dic.properties.synthetic import draw

# a square millimetre: stresses in MPa are loads in N
AREA = PropertySettings(area_mm2=1.0)


@pytest.mark.parametrize(
    "seeds",
    [
        range(1),
        pytest.param(range(1, 3), marks=pytest.mark.extended),
        *(pytest.param(range(k, k + 10), marks=pytest.mark.long) for k in (3, 13, 23, 33, 43)),
    ],
)
def test_it_is_the_slope_that_brute_force_chooses(seeds):
    for seed in seeds:
        drawn = draw(seed, points=70)
        found = objective_slope(drawn.strain, drawn.stress)
        first, stop, slope, intercept = slope_by_brute_force(drawn.strain, drawn.stress)
        assert (found.line.first, found.line.stop) == (first, stop), seed
        assert found.line.slope == pytest.approx(slope, rel=1e-9)
        assert found.line.intercept == pytest.approx(intercept, rel=1e-9, abs=1e-9 * drawn.yield_mpa)


def _pulls(seeds):
    pulls = []
    for seed in seeds:
        drawn = draw(seed)
        record = record_of(Curve(str(seed), drawn.stress, drawn.strain), 1.0)
        value = elastic_line(record, AREA).value(AREA)
        assert value.value == pytest.approx(drawn.e_mpa / 1e3, rel=0.02)
        pulls.append((value.value - drawn.e_mpa / 1e3) / value.std)
    return np.array(pulls)


@pytest.mark.extended
def test_toe_slack_noise_and_plateau_leave_the_slope_within_three_standard_deviations():
    pulls = _pulls(range(25))
    assert np.mean(np.abs(pulls) <= 3) >= 0.96
    # a standard deviation that is far too large would be no statement
    assert np.sqrt(np.mean(pulls**2)) > 0.4


@pytest.mark.long
def test_of_200_records_99_percent_are_within_three_standard_deviations():
    pulls = _pulls(range(1000, 1200))
    assert np.mean(np.abs(pulls) <= 3) >= 0.99
    assert 0.4 < np.sqrt(np.mean(pulls**2)) < 1.2


def test_a_record_that_only_falls_has_no_slope():
    assert objective_slope(np.arange(50.0), -np.arange(50.0)) == "the record does not rise"


def test_a_long_record_is_averaged_before_windows_are_compared():
    drawn = draw(3, points=4000)
    found = objective_slope(drawn.strain, drawn.stress)
    assert found.cut > 1500
    assert found.line.slope == pytest.approx(drawn.e_mpa, rel=0.01)


@pytest.mark.parametrize(
    ("extra", "low", "high"),
    [
        (-0.06, 0.1, 0.35),
        (0.05, 0.05, 0.5),
        (0.4, 0.2, 0.45),
        *(
            pytest.param(extra, *part, marks=pytest.mark.extended)
            for extra, *others in (
                (-0.06, (0.05, 0.5), (0.2, 0.45)),
                (0.05, (0.1, 0.35), (0.2, 0.45)),
                (0.4, (0.1, 0.35), (0.05, 0.5)),
            )
            for part in others
        ),
    ],
)
def test_slack_within_the_usual_window_gives_the_right_slope_or_a_flag(low, high, extra):
    """Between two shares of the yield strength the extensometer slips by a share of the elastic strain."""
    for seed in (3, 4):
        drawn = draw(seed)
        share = (drawn.stress - drawn.stress[0]) / drawn.yield_mpa
        slipped = extra * drawn.yield_mpa / drawn.e_mpa
        # slip goes on with the largest load so far
        share = np.maximum.accumulate(share)
        strain = drawn.strain + slipped * np.clip((share - low) / (high - low), 0, 1)
        value = material_properties(Curve("slack", drawn.stress, strain), AREA).values["E_gpa"]
        if value.value is None:
            assert value.flags[0].startswith("missing: ")
            continue
        right = abs(value.value - drawn.e_mpa / 1e3) < 0.02 * value.value
        assert right or any(flag.startswith("slack:") for flag in value.flags), (seed, value)
