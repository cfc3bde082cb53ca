"""A load cell that reads wrong values must break no specimen, for random materials, machines, increments."""

import random

import pytest

from tests.rig.limits.lies import ALL_LOADS, LIES, Case, Result, draw, drive

OVER_MAX = 0.10
"""Largest allowed true load above the target, as a fraction of an increment."""


BEYOND_MAX = 0.03
"""Largest allowed displacement beyond the needed one, as a fraction of an increment's displacement."""


def faults_of(result: Result, case: Case) -> list[str]:
    """Return one sentence for each violated limit at the end of a test whose load cell reads wrong values."""
    found = []
    if result.outcome.status != "failed" or result.outcome.unsafe:
        found.append(f"{result.outcome}")
    if not result.over <= OVER_MAX:
        found.append(f"{result.over:.1%} of the increment above the target: {case}")
    if result.target_n:
        needed_mm = case.needed_mm(result.target_n)
        of_increment_mm = needed_mm - case.needed_mm(result.target_n - case.increment_n)
        if not result.farthest_mm <= needed_mm + BEYOND_MAX * of_increment_mm:
            found.append(f"{result.farthest_mm} mm instead of {needed_mm} mm: {case}")
    return found


SEEDS = pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.extended)])


@pytest.mark.parametrize("lie", ALL_LOADS)
@SEEDS
def test_a_load_cell_that_lies_from_the_start_overloads_no_specimen(lie, seed, tmp_path, monkeypatch):
    case = draw(random.Random(100 * LIES.index(lie) + seed))
    result = drive(case, tmp_path, monkeypatch, lie, lambda load_n: True)
    assert faults_of(result, case) == []
    assert result.target_n == case.increment_n, "stopped in the first increment"


@pytest.mark.parametrize(
    "lie", [LIES[1], *(pytest.param(lie, marks=pytest.mark.extended) for lie in (LIES[0], *LIES[2:4]))]
)
def test_a_load_cell_that_begins_to_lie_at_any_load_overloads_no_specimen(lie, tmp_path, monkeypatch):
    rng = random.Random(LIES.index(lie))
    case = draw(rng)
    begin_n = rng.uniform(0.05, 0.8) * case.yield_n
    assert faults_of(drive(case, tmp_path, monkeypatch, lie, lambda load_n: load_n >= begin_n), case) == []


def test_a_load_cell_that_drifts_before_the_first_increment_moves_nothing(tmp_path, monkeypatch):
    case = draw(random.Random(7))
    drift_n_s = max(4, round(0.01 * case.increment_n))
    result = drive(case, tmp_path, monkeypatch, f"drifting-load:{drift_n_s}", lambda load_n: True)
    assert faults_of(result, case) == []
    assert "the load cell drifts" in result.outcome.reason
    assert result.target_n == 0.0


def drive_drifting(seed, begin_increments, tmp_path, monkeypatch):
    """Execute a test whose load cell drifts by 0.1 increments per second from a given load on."""
    case = draw(random.Random(seed))
    drift_n_s, begin_n = round(0.1 * case.increment_n), begin_increments * case.increment_n
    result = drive(case, tmp_path, monkeypatch, f"drifting-load:{drift_n_s}", lambda n: n >= begin_n)
    assert result.outcome.status == "failed"
    assert result.target_n == 2 * case.increment_n
    return result


def test_a_fast_drift_in_an_increment_ends_the_run_before_the_next_increment(tmp_path, monkeypatch):
    result = drive_drifting(8, 1.3, tmp_path, monkeypatch)
    assert "the load cell drifts" in result.outcome.reason


def test_a_drift_in_an_elastic_increment_overloads_no_specimen(tmp_path, monkeypatch):
    result = drive_drifting(11_013, 1.1, tmp_path, monkeypatch)
    assert "the load cell drifts, or the specimen yields" in result.outcome.reason
    assert result.over <= OVER_MAX


@pytest.mark.parametrize("lie", ALL_LOADS)
def test_the_paper_s_protocol_needs_no_declaration_to_notice_a_lie(lie, tmp_path, monkeypatch):
    paper = Case("2024-T3", 25.0, 1.0, 60.0, 15_000.0, 0.6, 5, seed=1, declares=False)
    paper.slip_load_n = 1500.0
    assert faults_of(drive(paper, tmp_path, monkeypatch, lie, lambda load_n: True), paper) == []


@SEEDS
def test_no_honest_test_is_stopped(seed, tmp_path, monkeypatch):
    case = draw(random.Random(1000 + seed))
    result = drive(case, tmp_path, monkeypatch)
    assert (result.outcome.status, result.outcome.reason) == ("completed", ""), case


@pytest.mark.long
@pytest.mark.parametrize("seed", range(100))
def test_many_load_cells_that_lie(seed, tmp_path, monkeypatch):
    rng = random.Random(5000 + seed)
    case, lie = draw(rng), rng.choice(LIES[:4])
    begin_n = rng.choice([0.0, rng.uniform(0.0, 0.9) * case.yield_n])
    assert faults_of(drive(case, tmp_path, monkeypatch, lie, lambda load_n: load_n >= begin_n), case) == []


@pytest.mark.long
@pytest.mark.parametrize("seed", range(40))
@pytest.mark.parametrize("declares", [True, False])
def test_many_honest_tests(seed, declares, tmp_path, monkeypatch):
    case = draw(random.Random(9000 + seed))
    case.declares = declares
    result = drive(case, tmp_path, monkeypatch)
    assert (result.outcome.status, result.outcome.reason) == ("completed", ""), case
