import pytest

from rig.engine.watch import POLL_MIN_S, Watch
from rig.errors import LimitViolation, SpecimenBroken
from rig.facts import RigFacts
from rig.limits.run_limits import limits_of
from rig.protocol.rotation import RotationProtocol
from rig.protocol.step import ProtocolStep, RigReading
from rig.protocol.tension import TensionProtocol


@pytest.fixture
def watch(tension_table) -> Watch:
    limits = tension_table["limits"] | {"load_max_n": 12_000.0, "displacement_max_mm": 5.1}
    protocol = TensionProtocol.model_validate(tension_table | {"limits": limits})
    return Watch(protocol, limits_of(protocol))


def see(watch: Watch, *loads_n: float) -> int:
    """Check readings with the given loads, and return their number."""
    for load_n in loads_n:
        watch.check(RigReading(0.0, load_n, 1.0), "step 3")
    return len(loads_n)


def test_a_load_that_falls_by_the_declared_fraction_is_no_break_yet(watch):
    assert see(watch, 2000.0, 10_000.0, 7000.0) == 3


def test_a_load_that_falls_by_more_than_the_declared_fraction_is_a_break(watch):
    with pytest.raises(SpecimenBroken, match="a load above 7000 N after 10000 N"):
        see(watch, 2000.0, 10_000.0, 9000.0, 6999.0)


def test_a_break_is_judged_once_the_first_increment_was_carried(watch):
    see(watch, 1999.0, 0.0)
    with pytest.raises(SpecimenBroken):
        see(watch, 2000.0, 0.0)


@pytest.mark.parametrize(
    ("reading", "setting"),
    [
        (RigReading(0.0, 12_000.1, 1.0), "limits.load_max_n above 12000"),
        (RigReading(0.0, -12_000.1, 1.0), "limits.load_max_n above 12000"),
        (RigReading(0.0, 0.0, -5.15), "limits.displacement_max_mm above 5.1"),
    ],
)
def test_limits_hold_in_both_directions_and_are_named(watch, reading, setting):
    with pytest.raises(LimitViolation, match=f"only if it is sound, raise {setting}$"):
        watch.check(reading, "step 3")


@pytest.mark.parametrize("reading", [RigReading(0.0, float("nan"), 1.0), RigReading(0.0, 0.0, float("nan"))])
def test_what_is_no_number_is_within_no_limit(watch, reading):
    with pytest.raises(LimitViolation, match="got nan"):
        watch.check(reading, "step 3")


@pytest.mark.parametrize(
    ("step", "said"),
    [
        (ProtocolStep(2, "load", 12_001.0, 20.0, 200.0), "expected a load within 12000 N, got 12001 N"),
        (ProtocolStep(2, "load", 100.0, 20.0, 301.0), "expected a load rate within 300 N/s"),
        (ProtocolStep(2, "displacement", 5.2, 0.01, 0.02), "expected a displacement within 5.1 mm"),
        (ProtocolStep(2, "displacement", 1.0, 0.01, 0.6), "expected a speed within 0.5 mm/s"),
    ],
)
def test_a_motion_beyond_a_limit_is_refused_before_it_is_commanded(tension_table, step, said):
    limits = tension_table["limits"] | {"load_max_n": 12_000.0, "displacement_max_mm": 5.1}
    protocol = TensionProtocol.model_validate(tension_table | {"limits": limits})
    watch = Watch(protocol, limits_of(protocol, RigFacts(speed_max_mm_s=0.5, load_rate_max_n_s=300.0)))
    with pytest.raises(LimitViolation, match=said):
        watch.begin(step)


def test_an_angle_beyond_the_stage_ends_the_run_once_the_stage_was_commanded(rotation_table):
    protocol = RotationProtocol.model_validate(rotation_table)
    watch = Watch(protocol, limits_of(protocol, RigFacts(angle_min_deg=-5.0, angle_max_deg=365.0)))
    # The angle of a stage without a reference means nothing.
    watch.check(RigReading(0.0, angle_deg=400.0), "step 0")
    watch.begin(ProtocolStep(2, "rotation", 20.0, 0.1))
    with pytest.raises(LimitViolation, match="expected an angle within 365 deg, got 366 deg"):
        watch.check(RigReading(0.0, angle_deg=366.0), "step 2")


def test_an_increment_of_load_is_read_every_few_thousandths_of_its_time(watch):
    watch.check(RigReading(0.0, 0.0, 0.0), "step 1")
    watch.begin(ProtocolStep(2, "load", 2000.0, 20.0, 200.0))
    assert watch.poll_s(0.5) == pytest.approx(0.003 * 10.0)
    watch.begin(ProtocolStep(2, "load", 200.0, 20.0, 200.0))
    assert watch.poll_s(0.5) == POLL_MIN_S
    assert watch.poll_s(0.01) == 0.01
