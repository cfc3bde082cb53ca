import pytest

from rig.facts import RigFacts
from rig.limit_settings import RigLimits
from rig.limits.run_limits import limits_of
from rig.limits.stiffness import load_string
from rig.limits.table import Bound, Limit, LimitTable
from rig.protocol.tension import TensionProtocol


@pytest.fixture
def tension_protocol(tension_table) -> TensionProtocol:
    return TensionProtocol.model_validate(tension_table)


def test_the_narrower_bound_of_protocol_rig_file_and_device_is_in_force(tension_protocol):
    facts = RigFacts(load_max_n=14_000.0, speed_max_mm_s=1.0)
    table = limits_of(tension_protocol, facts, RigLimits(load_max_n=12_500.0, speed_max_mm_s=0.5)).table
    assert table.greatest("load") == 12_500.0
    assert table.greatest("displacement") == 5.2
    assert table.greatest("speed") == 0.5
    assert str(table.get("load")).endswith("at most 12500 N (the rig's limits.load_max_n)")


def test_the_least_load_and_displacement_of_the_machine_are_in_force(tension_protocol):
    facts = RigFacts(load_min_n=-20.0, displacement_min_mm=0.1)
    limits = limits_of(tension_protocol, facts)
    assert "-20 N (the rig's load_frame.load_min_n)" in str(limits.table.get("load"))
    with pytest.raises(Exception, match="expected a load"):
        limits.table.check("load", -21.0, "step 1")
    # the protocol's own bound is wider; a plan that asks for less than the machine allows is refused
    (objection,) = limits_of(tension_protocol, RigFacts(load_min_n=2500.0)).objections
    assert "asks for a load of 2000 N, but the rig's load_frame.load_min_n is 2500" in objection


def test_a_plan_beyond_the_rig_s_own_table_is_refused(tension_protocol):
    assert limits_of(tension_protocol).objections == []
    rig = RigLimits(load_max_n=9_000.0, load_rate_max_n_s=100.0)
    found = limits_of(tension_protocol, rig=rig).objections
    assert len(found) == 2
    assert "asks for a load rate of 200 N/s, but the rig's limits.load_rate_max_n_s is 100" in found[0]
    assert "(load 10000 N) asks for a load of 10000 N, but the rig's limits.load_max_n is 9000" in found[1]


def test_what_is_no_number_is_beyond_every_bound():
    table = LimitTable([Limit("load", "N", None, Bound(1.0, "here"))])
    with pytest.raises(Exception, match="expected a load within 1 N, got nan N"):
        table.check("load", float("nan"), "step 1")


def test_the_softest_specimen_is_no_polymer_if_it_must_carry_more_than_any_polymer(tension_table):
    # 25 mm² over 60 mm: three increments of 2 kN are 240 MPa, two of 500 N are 40 MPa.
    strong = load_string(TensionProtocol.model_validate(tension_table), RigLimits())
    in_series = 1.0 / (60.0 / (20_000.0 * 25.0) + 1.0 / 5_000.0)
    assert strong.stiffness_min_n_mm == pytest.approx(in_series)
    loading = tension_table["loading"] | {"increment_n": 500.0, "tare_max_n": 50.0}
    loading["plastic"] = loading["plastic"] | {"judged_above_n": 600.0}
    weak = load_string(TensionProtocol.model_validate(tension_table | {"loading": loading}), RigLimits())
    assert weak.stiffness_min_n_mm == pytest.approx(1.0 / (60.0 / (1_000.0 * 25.0) + 1.0 / 5_000.0))


def test_what_is_declared_is_used(tension_table):
    plausible = {"modulus_min_mpa": 70_000.0, "modulus_max_mpa": 76_000.0, "grip_length_mm": 80.0}
    protocol = TensionProtocol.model_validate(tension_table | {"plausible": plausible})
    rig = RigLimits(machine_stiffness_min_n_mm=12_000.0, machine_stiffness_max_n_mm=18_000.0, seating_mm=0.0)
    string = load_string(protocol, rig)
    assert string.stiffness_min_n_mm == pytest.approx(1.0 / (80.0 / (70_000.0 * 25.0) + 1.0 / 12_000.0))
    assert string.stiffness_max_n_mm == pytest.approx(1.0 / (80.0 / (76_000.0 * 25.0) + 1.0 / 18_000.0))
    assert string.displacement_max_mm(1000.0) == pytest.approx(
        string.slack_mm + 1000.0 / string.stiffness_min_n_mm
    )
