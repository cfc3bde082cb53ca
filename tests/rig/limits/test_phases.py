"""A load cell that reads wrong values must not break a specimen in a test with phases."""

import random
import tomllib

import pytest

from rig.limits.run_limits import limits_of
from rig.protocol.protocol import parse_protocol
from tests.places import example
from tests.rig.limits.lies import ALL_LOADS, LIES, drive
from tests.rig.limits.phased import draw_phased
from tests.rig.limits.test_lies import OVER_MAX

CASES = [
    *((lie, 0.0) for lie in LIES[1:3]),
    *(pytest.param(lie, 0.0, marks=pytest.mark.extended) for lie in (LIES[0], LIES[3])),
    # the long campaign has every lie from a load on
    *(
        pytest.param(
            lie,
            0.5,
            marks=pytest.mark.long if lie in ("tenth-load", "reversed-load") else pytest.mark.extended,
        )
        for lie in LIES[:4]
    ),
]


@pytest.mark.parametrize(("lie", "part"), CASES)
def test_a_load_cell_that_lies_overloads_no_specimen(lie, part, tmp_path, monkeypatch):
    case = draw_phased(random.Random(300 + LIES.index(lie)))
    begin_n = part * case.yield_n
    result = drive(case, tmp_path, monkeypatch, lie, lambda load_n: load_n >= begin_n)
    assert (result.outcome.status, result.outcome.unsafe) == ("failed", ())
    assert result.over <= OVER_MAX, result


@pytest.mark.extended
def test_no_honest_test_of_phases_is_stopped(tmp_path, monkeypatch):
    # one of them takes as long as three tests with lies; many more stand in the long campaign
    case = draw_phased(random.Random(2001))
    result = drive(case, tmp_path, monkeypatch)
    assert (result.outcome.status, result.outcome.reason) == ("completed", ""), case
    assert result.stretched


@pytest.mark.parametrize("lie", ALL_LOADS)
def test_a_pull_to_a_displacement_is_stopped_if_the_load_does_not_follow(lie, tmp_path, monkeypatch):
    case = draw_phased(random.Random(5))
    table = tomllib.loads(case.protocol())
    only = [phase for phase in table["phases"] if phase["do"] == "to-displacement"]
    assert limits_of(parse_protocol(table | {"phases": only})).string is not None
    case.only = ("to-displacement",)
    result = drive(case, tmp_path, monkeypatch, lie, lambda load_n: True)
    assert result.outcome.status == "failed"
    assert result.farthest_mm < 0.5 * only[0]["displacement_mm"]


@pytest.mark.parametrize("name", ["creep", "cycles"])
def test_the_examples_of_phases_have_bounds_of_load_and_displacement(name):
    limits = limits_of(parse_protocol(tomllib.loads(example(name))))
    assert limits.string is not None
    assert limits.table.get("stiffness") is not None


@pytest.mark.long
@pytest.mark.parametrize("seed", range(30))
def test_many_lies_in_tests_of_phases(seed, tmp_path, monkeypatch):
    rng = random.Random(7000 + seed)
    case, lie = draw_phased(rng), rng.choice(LIES[:4])
    begin_n = rng.choice([0.0, rng.uniform(0.0, 0.9) * case.yield_n])
    result = drive(case, tmp_path, monkeypatch, lie, lambda load_n: load_n >= begin_n)
    assert result.outcome.status == "failed"
    assert result.stretched or result.over <= OVER_MAX, (lie, result, case)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(30))
@pytest.mark.parametrize("declares", [True, False])
def test_many_honest_tests_of_phases(seed, declares, tmp_path, monkeypatch):
    case = draw_phased(random.Random(8000 + seed))
    case.declares = declares
    result = drive(case, tmp_path, monkeypatch)
    assert (result.outcome.status, result.outcome.reason) == ("completed", ""), case
