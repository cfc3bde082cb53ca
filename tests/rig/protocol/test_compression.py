"""Phases in compression: their steps, signs, limits and refusals. Protocols of tension are as before."""

import pytest

from rig.facts import RigFacts, narrowed
from rig.limits.run_limits import limits_of
from rig.plan import make_plan
from rig.protocol.criteria import LoadDropCriterion
from rig.protocol.plasticity import PlasticCriterion
from rig.protocol.step import ProtocolStep, RigReading
from rig.rigfile import read_rig
from tests.places import example
from tests.rig.protocol.test_phases import PULLING, Specimen, mistakes, protocol

PUSHING = PULLING.replace(
    "load_max_n = 13000.0",
    "load_max_n = 500.0\nload_min_n = -9000.0\ndisplacement_min_mm = -2.0\nbuckling_load_drop = 0.05",
).replace("tare_max_n = 100.0", "tare_max_n = 50.0")
BOTH = PUSHING.replace("load_max_n = 500.0", "load_max_n = 9000.0")
PUSH = """
[[phases]]
do = "preload"
load_n = -100.0
rate_n_s = 50.0
[[phases]]
do = "to-load"
load_n = -4000.0
rate_n_s = 200.0
images.every_n = 1000.0
[[phases]]
do = "to-displacement"
displacement_mm = -1.0
speed_mm_s = 0.02
images.every_mm = 0.5
until = { load_drop = 0.03, if_never = "go-on" }
[[phases]]
do = "unload"
rate_n_s = 500.0
"""
CYCLE = """
[[phases]]
do = "cycles"
low_n = {low}
high_n = {high}
rate_n_s = 1000.0
count = 3
"""


def shown(phases: str, tables: str = PUSHING) -> list[tuple[str, float]]:
    return [(step.kind, step.target) for step in protocol(phases, tables).steps()[1:]]


def test_a_push_is_planned_in_increments_away_from_zero_and_the_unloading_back_to_it():
    steps = shown(PUSH)
    assert steps[:5] == [
        ("reference", -100.0),
        *(("load", -100.0 - 1000.0 * k) for k in range(1, 4)),
        ("load", -4000.0),
    ]
    assert [target for kind, target in steps if kind == "displacement"][-1] == -1.0
    assert steps[-1] == ("load", 0.0)
    planned = protocol(PUSH, PUSHING).steps()
    assert [step.load_drop for step in planned[1:6]] == ["commanded"] * 5
    pull = protocol(PUSH, PUSHING).conditions.pull
    assert (pull.sense, pull.increment_n, pull.assured_n) == (-1.0, 900.0, 4000.0)


def test_a_push_is_followed_from_the_readings_and_the_unloading_goes_up():
    specimen = Specimen()
    execute = specimen.execute
    specimen.execute = lambda step: pressed(execute, step)
    protocol(PUSH, PUSHING).follow(specimen.execute)
    targets = [step.target for step in specimen.executed[1:]]
    assert targets[:5] == [-100.0, -1100.0, -2100.0, -3100.0, -4000.0]
    assert targets[-2:] == [-1.0, 0.0]
    assert specimen.executed[-1].load_drop == "break"


def pressed(execute, step: ProtocolStep) -> RigReading:
    """Return the reading of an elastic specimen of 20 kN/mm that is pressed."""
    execute(step)
    load_n = step.target if step.quantity == "load" else 2e4 * step.target
    return RigReading(0.0, load_n, load_n / 2e4, 0.0)


def test_a_specimen_that_may_be_pulled_or_pressed_is_unloaded_in_either_direction():
    phases = PUSH.replace(
        '[[phases]]\ndo = "unload"',
        '[[phases]]\ndo = "hold"\nkeep = "displacement"\nduration_s = 5.0\n[[phases]]\ndo = "unload"',
    )
    assert shown(phases, BOTH)[-1] == ("load", 0.0)
    for load_n, drop in ((-3000.0, "break"), (2000.0, "commanded")):
        executed = []

        def execute(step, load_n=load_n, executed=executed):
            executed.append(step)
            return RigReading(0.0, step.target if step.quantity == "load" else load_n, 0.0, 0.0)

        protocol(phases, BOTH).follow(execute)
        assert (executed[-1].target, executed[-1].load_drop) == (0.0, drop)


@pytest.mark.parametrize(
    ("low", "high", "sense"), [(-5000.0, -500.0, -1.0), (-5000.0, 5000.0, 1.0), (-5000.0, 0.0, -1.0)]
)
def test_cycles_may_push(low, high, sense):
    made = protocol(CYCLE.format(low=low, high=high), BOTH)
    assert [step.target for step in made.steps()[2:]] == [high, low] * 3
    assert made.conditions.pull.sense == sense


def test_cycles_in_compression_end_when_the_load_at_their_outer_end_drops():
    made = protocol(CYCLE.format(low=-5000.0, high=-500.0) + "until.load_drop = 0.04\n", PUSHING)
    executed = []

    def execute(step):
        executed.append(step)
        fall = 1.0 if len(executed) < 6 else 0.9
        return RigReading(0.0, step.target * fall if step.quantity == "load" else 0.0, 0.0, 0.0)

    made.follow(execute)
    assert [step.target for step in executed[2:]] == [-500.0, -5000.0, -500.0, -5000.0]
    assert [step.event is not None for step in executed[2:]] == [False, True, False, True]


def test_a_drop_of_the_load_in_compression_is_a_loss_of_compressive_load():
    criterion = LoadDropCriterion(0.1, 500.0, -1.0)
    drops = criterion.at_readings()
    loads_n = [0.0, -400.0, -100.0, -2000.0, -1900.0, -1790.0]
    assert [drops(RigReading(0.0, load_n)) for load_n in loads_n] == [False] * 5 + [True]
    drops.renew()
    assert not drops(RigReading(0.0, -1500.0))
    assert criterion.is_met([RigReading(0.0, load_n) for load_n in (0.0, -2000.0, -1790.0)])
    assert not criterion.is_met([RigReading(0.0, load_n) for load_n in (0.0, -2000.0, -1810.0)])


def test_plastic_deformation_is_seen_in_compression_too():
    plastic = PlasticCriterion(stiffness_fraction=0.8, judged_above_n=1500.0)
    assert plastic.can_end(2, ProtocolStep(3, "load", -2000.0))
    assert not plastic.can_end(2, ProtocolStep(3, "load", -1500.0))
    loads_n = [0.0, -1000.0, -2000.0, -3000.0]
    assert not plastic.is_evident(loads_n, [0.0, -0.05, -0.1, -0.15])
    assert plastic.is_evident(loads_n, [0.0, -0.05, -0.1, -0.2])


def test_limits_of_compression_replace_the_upper_limit_in_both_directions(tmp_path):
    table = limits_of(protocol(PUSH, PUSHING)).table
    assert (
        str(table.get("load"))
        == "load: at least -9000 N (limits.load_min_n), at most 500 N (limits.load_max_n)"
    )
    plan = make_plan(protocol(PUSH, PUSHING), RigFacts(load_min_n=-5000.0, load_max_n=15000.0))
    assert plan.objections == [
        "limits.load_min_n is -9000, but the rig allows -5000 N at least; set it to -5000 or more"
    ]
    path = tmp_path / "rig.toml"
    path.write_text(example("rig-virtual-tension"))
    rig_file = read_rig(path)
    before = rig_file.load_frame.setting("load_min_n")
    narrow = narrowed(rig_file, protocol(PUSH, PUSHING.replace("-9000.0", "-4500.0"))).load_frame
    assert narrow.setting("load_min_n") == max(before, -4500.0)
    assert narrow.setting("load_max_n") == 500.0


@pytest.mark.parametrize(
    ("phases", "tables", "said"),
    [
        (PUSH, PULLING, "phase 2 (to-load): limits.load_min_n is missing; add it, because a load of -4000"),
        (PUSH, PULLING, "phase 3 (to-displacement): limits.displacement_min_mm is missing"),
        (CYCLE.format(low=-5000.0, high=100.0), PULLING, "limits.load_min_n is missing"),
        (PUSH.replace("-4000.0", "-9500.0"), PUSHING, "limits.load_min_n must be at most -9520"),
        (PUSH.replace("= -1.0", "= -3.0"), PUSHING, "limits.displacement_min_mm must be at most -3.002"),
        (PUSH.replace("0.03", "0.05"), PUSHING, "must be below limits.buckling_load_drop, 0.05"),
        (
            PUSH.replace("load_n = -4000.0", "load_n = -50.0"),
            PUSHING,
            "a target below -100 N, where the phase starts, is expected, got -50; use unload",
        ),
        (PUSH, PULLING + "buckling_load_drop = 0.05\n", "buckling_load_drop needs load_min_n"),
        (PUSH, PUSHING.replace("-9000.0", "9000.0"), "limits.load_min_n: input should be less than 0"),
    ],
)
def test_a_wrong_sign_or_a_missing_limit_is_a_mistake(tmp_path, phases, tables, said):
    assert said in mistakes(tmp_path, phases, tables)
