import pytest

from rig.engine.watch import Watch
from rig.errors import LimitViolation, SpecimenBroken
from rig.protocol.protocol import Limits
from rig.protocol.step import Reading

LIMITS = Limits(load_max_n=12_000.0, displacement_max_mm=5.0, break_load_drop=0.3)


def watch(*loads_n: float) -> int:
    """Return how many loads were let pass."""
    watching = Watch(LIMITS, carried_n=2000.0)
    for load_n in loads_n:
        watching.check(Reading(0.0, load_n, 1.0), "step 3")
    return len(loads_n)


def test_a_load_that_falls_by_the_declared_fraction_is_no_break_yet():
    assert watch(2000.0, 10_000.0, 7000.0) == 3


def test_a_load_that_falls_by_more_than_the_declared_fraction_is_a_break():
    with pytest.raises(SpecimenBroken, match="a load above 7000 N after 10000 N"):
        watch(2000.0, 10_000.0, 9000.0, 6999.0)


def test_a_break_is_judged_once_the_declared_load_was_carried():
    watch(1999.0, 0.0)
    with pytest.raises(SpecimenBroken):
        watch(2000.0, 0.0)


@pytest.mark.parametrize(
    ("reading", "setting"),
    [
        (Reading(0.0, 12_000.1, 1.0), "limits.load_max_n above 12000"),
        (Reading(0.0, 0.0, -5.1), "limits.displacement_max_mm above 5"),
    ],
)
def test_limits_hold_in_both_directions_and_are_named(reading, setting):
    with pytest.raises(LimitViolation, match=f"only if it is sound, raise {setting}$"):
        Watch(LIMITS, carried_n=2000.0).check(reading, "step 3")


@pytest.mark.parametrize("reading", [Reading(0.0, float("nan"), 1.0), Reading(0.0, 0.0, float("nan"))])
def test_what_is_no_number_is_within_no_limit(reading):
    with pytest.raises(LimitViolation, match="got nan"):
        Watch(LIMITS, carried_n=2000.0).check(reading, "step 3")
