"""Phases whose target has been passed already: nothing unloads the specimen unless the protocol says so."""

import pytest

from rig.errors import ProtocolError
from tests.rig.protocol.test_phases import Specimen, protocol

# The specimen of `test_phases` stands at 0.85 mm under 8 kN.
LOADED = '[[phases]]\ndo = "to-load"\nload_n = 8000.0\nrate_n_s = 200.0\n'
PASSED = '[[phases]]\ndo = "to-displacement"\ndisplacement_mm = 0.5\nspeed_mm_s = 0.01\n'
KEPT = '[[phases]]\ndo = "hold"\nkeep = "displacement"\nduration_s = 10.0\n'
FARTHER = (
    '[[phases]]\ndo = "to-displacement"\ndisplacement_mm = 1.5\nspeed_mm_s = 0.01\nimages.every_mm = 0.5\n'
)


def executed(phases: str) -> list[tuple[str, float, bool]]:
    specimen = Specimen()

    def execute(step):
        return specimen.executed.append(step) if step.passed else specimen.execute(step)

    protocol(phases).follow(execute)
    return [(step.kind, step.target, step.passed) for step in specimen.executed[2:]]


def test_a_motion_to_a_displacement_that_is_passed_is_left_out_and_the_hold_keeps_the_actual_one():
    assert executed(LOADED + PASSED + KEPT) == [
        ("load", 8000.0, False),
        ("displacement", 0.5, True),
        ("relaxation", pytest.approx(0.85), False),
    ]


def test_the_next_motion_begins_where_the_specimen_is_and_not_at_the_target_that_was_left_out():
    assert executed(LOADED + PASSED + FARTHER)[2:] == [
        ("displacement", pytest.approx(1.35), False),
        ("displacement", 1.5, False),
    ]


def test_a_load_that_is_passed_is_not_held_by_unloading():
    to_load = '[[phases]]\ndo = "to-load"\nload_n = 3000.0\nrate_n_s = 200.0\n'
    creep = '[[phases]]\ndo = "hold"\nkeep = "load"\nrate_n_s = 50.0\nduration_s = 10.0\n'
    # 0.25 mm are 5 kN
    assert executed(PASSED.replace("0.5", "0.25") + to_load + creep)[1:] == [
        ("load", 3000.0, True),
        ("creep", pytest.approx(5000.0), False),
    ]


def test_a_protocol_can_order_the_way_back():
    specimen = Specimen()
    made = protocol(LOADED + PASSED + 'if_passed = "go-back"\n' + KEPT)
    made.follow(specimen.execute)
    back, kept = specimen.executed[3:]
    assert (back.kind, back.target, back.load_drop, back.passed) == ("displacement", 0.5, "commanded", False)
    assert (kept.kind, kept.target) == ("relaxation", 0.5)
    assert [step.index for step in specimen.executed] == [step.index for step in made.steps()]


def test_a_protocol_can_refuse_a_target_that_is_passed():
    said = r"phase 2 \(to-displacement\): expected a displacement below 0.5 mm, .* got 0.85 mm; go farther"
    with pytest.raises(ProtocolError, match=said):
        executed(LOADED + PASSED + 'if_passed = "fail"\n')


@pytest.mark.parametrize("images", ["", "images.every_mm = 0.4\n", "images.every_s = 20.0\n"])
def test_a_target_below_half_of_the_displacement_limit_is_planned_and_reached(images):
    phases = LOADED.replace("8000", "4000") + PASSED.replace("0.5", "2.0") + images
    made, specimen = protocol(phases), Specimen()
    made.follow(specimen.execute)
    assert specimen.executed[-1].target == 2.0
    planned = {step.index: step for step in made.steps()}
    assert all(planned[step.index].kind == step.kind for step in specimen.executed)


def test_cycles_from_beyond_their_higher_end_begin_with_unloading():
    cycles = '[[phases]]\ndo = "cycles"\nlow_mm = 0.3\nhigh_mm = 0.5\nspeed_mm_s = 0.1\ncount = 2\n'
    specimen = Specimen()
    protocol(LOADED + cycles).follow(specimen.execute)
    assert [step.load_drop for step in specimen.executed[3:]] == [
        "commanded",
        "commanded",
        "break",
        "commanded",
    ]
