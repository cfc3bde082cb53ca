"""The machine's program, its trigger output, and the state of the specimen at any time."""

import itertools

import pytest
from pydantic import ValidationError

from drivers.clock import VirtualClock
from simulators.closed_machine.machine import ClosedMachine
from simulators.closed_machine.program import Program
from simulators.closed_machine.settings import ClosedMachineSettings, ProgramStep
from simulators.scene.specimen import SimulatedSpecimen, SpecimenSettings

STEPS = [
    {"to_mm": 1.0, "speed_mm_s": 0.1},
    {"wait_s": 5.0},
    {"to_mm": 0.5, "speed_mm_s": 0.1},
    {"to_mm": 2.0, "speed_mm_s": 0.5},
]


def machine_of(clock, **settings):
    given = {"start_s": 2.0, "program": STEPS, "trigger_every_s": 4.0, "trigger_width_s": 0.5} | settings
    return ClosedMachine(
        clock,
        ClosedMachineSettings.model_validate(given),
        lambda: SimulatedSpecimen(SpecimenSettings()),
    )


@pytest.mark.parametrize(
    ("time_s", "displacement_mm", "furthest_mm", "running"),
    [
        (0.0, 0.0, 0.0, False),
        (2.0, 0.0, 0.0, True),
        (7.0, 0.5, 0.5, True),
        (12.0, 1.0, 1.0, True),
        (16.0, 1.0, 1.0, True),
        (20.0, 0.7, 1.0, True),
        (22.0, 0.5, 1.0, True),
        (22.5, 0.75, 1.0, True),
        (24.0, 1.5, 1.5, True),
        (25.0, 2.0, 2.0, False),
        (1000.0, 2.0, 2.0, False),
    ],
)
def test_the_crosshead_follows_the_program(time_s, displacement_mm, furthest_mm, running):
    program = Program([ProgramStep(**step) for step in STEPS], 2.0)
    assert program.displacement_mm(time_s) == pytest.approx(displacement_mm)
    assert program.furthest_mm(time_s) == pytest.approx(furthest_mm)
    assert program.running(time_s) == running


def test_the_state_at_any_time_is_that_of_a_specimen_pulled_step_by_step(clock):
    clock.sleep(123.0)
    machine = machine_of(clock)
    pulled = SimulatedSpecimen(SpecimenSettings())
    for step in range(1, 301):
        time_s = step / 10.0
        load_n = pulled.stretch_to(machine.program.displacement_mm(time_s))
        state = machine.state_at(123.0 + time_s)
        assert state.load_n == pytest.approx(load_n, rel=1e-9, abs=1e-6)
        assert state.axial_strain == pytest.approx(pulled.state.axial_strain, rel=1e-9, abs=1e-12)
    # in the past too
    assert machine.state_at(123.0 + 1.0).load_n == 0.0


def test_a_specimen_that_broke_stays_broken(clock):
    machine = machine_of(
        clock, program=[{"to_mm": 20.0, "speed_mm_s": 1.0}, {"to_mm": 0.0, "speed_mm_s": 1.0}]
    )
    assert machine.state_at(40.0).broken
    assert machine.state_at(40.0).load_n == 0.0
    assert not machine.state_at(4.0).broken


def test_trigger_pulses_come_while_the_program_runs(clock):
    machine = machine_of(clock)
    seen = []
    for _ in range(300):
        seen.append(machine.trigger())
        clock.sleep(0.1)
    counts = [count for count, _ in seen]
    # at 2, 6, 10, 14, 18 and 22 s; the program ends at 25 s
    assert [counts.count(number) for number in range(7)] == pytest.approx([20, 40, 40, 40, 40, 40, 80], abs=1)
    assert sum(high for _, high in seen) == pytest.approx(6 * 5, abs=6)
    edges = sum(after and not before for (_, before), (_, after) in itertools.pairwise(seen))
    assert edges == 6


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ({"program": []}, "at least 1 item"),
        ({"program": [{"to_mm": 1.0}]}, "either to_mm and speed_mm_s, or wait_s"),
        ({"program": [{"to_mm": 1.0, "speed_mm_s": 1.0, "wait_s": 1.0}]}, "either to_mm"),
        ({"force": {"full_scale": 1.0, "jitter_s": 0.02}}, "at most twice delay_s"),
        ({"trigger_every_s": 1.0, "trigger_width_s": 1.0}, "the pulses merge"),
    ],
)
def test_impossible_settings_are_refused(table, said):
    with pytest.raises(ValidationError, match=said):
        machine_of(VirtualClock(), **table)
