"""Tests of protocols with phases: their plans, their decisions from readings, and their refusals."""

import math
import re
import tomllib
from dataclasses import replace
from typing import get_args

import pytest

from drivers.errors import ConfigurationError
from rig.errors import ProtocolError
from rig.protocol.phased import PhasesProtocol
from rig.protocol.phases import PHASES
from rig.protocol.protocol import parse_protocol, read_protocol
from rig.protocol.step import ProtocolStep, RigReading
from tests.places import NO_STILL, ROOT, example

SAMPLE = """
[sample]
name = "sheet"
thickness_mm = 1.0
width_mm = 25.0
gauge_length_mm = 60.0
"""
PULLING = """
[start]
tare_max_n = 100.0
[settle]
load_tolerance_n = 20.0
displacement_tolerance_mm = 0.002
dwell_s = 1.0
timeout_s = 60.0
[limits]
load_max_n = 13000.0
displacement_max_mm = 5.2
break_load_drop = 0.3
"""
TURNING = """
[settle]
angle_tolerance_deg = 0.01
dwell_s = 0.5
timeout_s = 60.0
"""


def text(phases: str, tables: str = PULLING) -> str:
    still = "" if "[images]" in phases + tables else NO_STILL
    return 'kind = "phases"\ntitle = "t"\n' + SAMPLE + phases + tables + still


def protocol(phases: str, tables: str = PULLING) -> PhasesProtocol:
    made = parse_protocol(tomllib.loads(text(phases, tables)))
    assert isinstance(made, PhasesProtocol)
    return made


def mistakes(tmp_path, phases: str, tables: str = PULLING) -> str:
    path = tmp_path / "protocol.toml"
    path.write_text(text(phases, tables))
    with pytest.raises(ConfigurationError) as caught:
        read_protocol(path)
    return "\n".join(caught.value.mistakes)


class Specimen:
    """A specimen with a stiffness of 20 kN/mm up to 7 kN and then 2 kN/mm; a test can change its load."""

    def __init__(self) -> None:
        self.executed: list[ProtocolStep] = []
        self.moving_until = 0
        self.load_factor = 1.0
        self._reading = RigReading(0.0, 0.0, 0.0, 0.0)

    def execute(self, step: ProtocolStep) -> RigReading:
        self.executed.append(step)
        now = self._reading
        if step.quantity == "load":
            plastic_mm = max(step.target - 7000.0, 0.0) / 2000.0
            now = replace(now, load_n=step.target, displacement_mm=min(step.target, 7e3) / 2e4 + plastic_mm)
        elif step.quantity == "displacement":
            part = 1.0
            if step.timed:
                part = step.at_s * step.rate / step.target
            way = part * step.target
            load_n = min(2e4 * way, 7000.0 + 2000.0 * (way - 0.35))
            now = replace(now, load_n=load_n * self.load_factor, displacement_mm=way, moving=part < 1.0)
        elif step.quantity == "rotation":
            now = replace(now, angle_deg=step.target)
        self._reading = now
        return now

    @property
    def shown(self) -> list[tuple[int, str, float, float]]:
        return [(step.index, step.kind, step.target, step.at_s) for step in self.executed]


TENSION_AS_PHASES = """
[[phases]]
do = "to-load"
load_n = 10000.0
rate_n_s = 200.0
images.every_n = 2000.0
until.plastic = {stiffness_fraction = 0.8, judged_above_n = 4000.0}
[[phases]]
do = "to-displacement"
displacement_mm = 5.0
speed_mm_s = 0.02
images.every_mm = 0.3
"""
ROTATION_AS_PHASES = """
[[phases]]
do = "rotate"
angle_deg = 360.0
images.every_deg = 22.5
"""


def essence(step: ProtocolStep) -> tuple:
    """Return the values of a step without its motion time, in order to compare two protocols.

    Only phases allow the motion time in addition to the time limit.
    """
    return tuple(replace(step, motion_s=0.0).__dict__.values())


@pytest.mark.parametrize(
    ("name", "phases", "tables"),
    [("tension", TENSION_AS_PHASES, PULLING), ("rotation", ROTATION_AS_PHASES, TURNING)],
)
def test_the_papers_protocols_are_cases_of_phases(name, phases, tables):
    papers = parse_protocol(tomllib.loads(example(name)))
    same = protocol(phases, tables)
    planned, expected = same.steps(), papers.steps()
    assert [str(essence(step)) for step in planned] == [str(essence(step)) for step in expected]
    by_papers, by_phases = Specimen(), Specimen()
    papers.follow(by_papers.execute)
    same.follow(by_phases.execute)
    assert [str(essence(s)) for s in by_phases.executed] == [str(essence(s)) for s in by_papers.executed]
    assert papers.conditions.devices == same.conditions.devices


def test_the_papers_steps_are_those_of_earlier_versions():
    planned = [
        (s.index, s.kind, s.target, s.tolerance, s.rate, s.conditional)
        for s in parse_protocol(tomllib.loads(example("tension"))).steps()[2:]
    ]
    loads = [(2 + i, "load", 2000.0 * (1 + i), 20.0, 200.0, i >= 3) for i in range(5)]
    ways = [
        (7 + i, "displacement", pytest.approx(min(0.3 * (1 + i), 5.0)), 0.002, 0.02, True) for i in range(17)
    ]
    assert planned == loads + ways
    specimen = Specimen()
    parse_protocol(tomllib.loads(example("tension"))).follow(specimen.execute)
    # yields between 6 and 8 kN at 0.35 + 0.5 mm; increments are counted from there
    assert [s.index for s in specimen.executed][:6] == [0, 1, 2, 3, 4, 5]
    assert [s.target for s in specimen.executed[6:8]] == pytest.approx([1.15, 1.45])
    assert [s.index for s in specimen.executed[6:8]] == [7, 8]
    assert specimen.executed[-1].target == 5.0


def test_a_preload_is_the_load_of_the_reference():
    steps = protocol('[[phases]]\ndo = "preload"\nload_n = 200.0\nrate_n_s = 50.0\n').steps()
    assert [(s.kind, s.quantity, s.target) for s in steps][1] == ("reference", "load", 200.0)
    assert steps[1].motion_s == 4.0


HOLD = """
[[phases]]
do = "to-load"
load_n = 4000.0
rate_n_s = 200.0
[[phases]]
do = "hold"
keep = "load"
rate_n_s = 50.0
duration_s = 100.0
images.every_s = 40.0
"""


def test_creep_is_imaged_at_its_times_and_at_its_end():
    specimen = Specimen()
    protocol(HOLD).follow(specimen.execute)
    assert specimen.shown[3:] == [
        (3, "creep", 4000.0, 40.0),
        (4, "creep", 4000.0, 80.0),
        (5, "creep", 4000.0, 100.0),
    ]
    assert [s.begins for s in specimen.executed[3:]] == [True, False, False]
    assert {s.load_drop for s in specimen.executed[3:]} == {"slow"}


def test_relaxation_holds_the_displacement_that_was_measured():
    phases = HOLD.replace('keep = "load"\nrate_n_s = 50.0', 'keep = "displacement"')
    specimen = Specimen()
    made = protocol(phases)
    made.follow(specimen.execute)
    assert math.isnan(made.steps()[3].target)
    assert specimen.shown[3][:3] == (3, "relaxation", pytest.approx(0.2))


CYCLES = """
[[phases]]
do = "cycles"
low_n = 500.0
high_n = 4000.0
rate_n_s = 1000.0
count = 5
images.every_cycles = 2
"""


def test_cycles_take_images_at_both_ends_of_some_cycles():
    specimen = Specimen()
    protocol(CYCLES).follow(specimen.execute)
    cycles = specimen.executed[2:]
    assert [s.target for s in cycles] == [4000.0, 500.0] * 5
    assert [s.images for s in cycles] == [True, True, True, True, False, False, True, True, True, True]
    assert [s.load_drop for s in cycles[:2]] == ["break", "commanded"]


def test_cycles_end_when_the_load_at_their_higher_end_drops():
    phases = """
[[phases]]
do = "cycles"
low_mm = 0.1
high_mm = 0.3
speed_mm_s = 0.1
count = 10
until.load_drop = 0.1
"""
    specimen = Specimen()

    def execute(step: ProtocolStep) -> RigReading:
        if len(specimen.executed) == 6:
            specimen.load_factor = 0.8
        return specimen.execute(step)

    protocol(phases).follow(execute)
    assert len(specimen.executed) == 7


MOVING = """
[[phases]]
do = "to-displacement"
displacement_mm = 1.0
speed_mm_s = 0.01
images.every_s = 30.0
"""


def test_images_during_a_motion_are_steps_with_a_time_and_the_motion_is_commanded_once():
    specimen = Specimen()
    protocol(MOVING).follow(specimen.execute)
    assert [(s.at_s, s.begins) for s in specimen.executed[2:5]] == [
        (30.0, True),
        (60.0, False),
        (90.0, False),
    ]
    last = specimen.executed[5]
    assert (last.timed, last.begins, last.target) == (False, False, 1.0)


def test_a_motion_that_arrives_early_leaves_out_its_remaining_times():
    specimen = Specimen()

    def execute(step: ProtocolStep) -> RigReading:
        reading = specimen.execute(step)
        return replace(reading, moving=False, displacement_mm=1.0) if step.at_s == 60.0 else reading

    protocol(MOVING).follow(execute)
    assert [s.index for s in specimen.executed] == [0, 1, 2, 3, 5]


@pytest.mark.parametrize("never", ["fail", "go-on"])
def test_an_event_that_never_happens_fails_the_test_or_not(never):
    phases = MOVING + f'until.load_drop = 0.1\nuntil.if_never = "{never}"\n'
    specimen = Specimen()
    if never == "go-on":
        protocol(phases).follow(specimen.execute)
        assert specimen.executed[-1].target == 1.0
    else:
        with pytest.raises(ProtocolError, match=r"phase 1 \(to-displacement\).*a drop of the load by 0.1"):
            protocol(phases).follow(specimen.execute)


def test_an_event_ends_the_phase_and_the_next_phase_goes_on_from_there():
    phases = (
        MOVING.replace("every_s = 30.0", "every_mm = 0.1")
        + "until.load_drop = 0.2\n"
        + '[[phases]]\ndo = "unload"\nrate_n_s = 500.0\n'
    )
    specimen = Specimen()

    def execute(step: ProtocolStep) -> RigReading:
        if step.index == 6:
            specimen.load_factor = 0.5
        return specimen.execute(step)

    made = protocol(phases)
    made.follow(execute)
    assert [s.index for s in specimen.executed[-2:]] == [6, 12]
    assert (specimen.executed[-1].target, specimen.executed[-1].load_drop) == (0.0, "commanded")


def test_a_stage_may_turn_back():
    phases = ROTATION_AS_PHASES + '[[phases]]\ndo = "rotate"\nangle_deg = -5.0\n'
    assert [s.target for s in protocol(phases, TURNING).steps()[-2:]] == [360.0, -5.0]


def test_all_mistakes_are_reported_together_with_the_number_of_the_phase(tmp_path):
    phases = """
[[phases]]
do = "to-load"
load_n = 0.0
[[phases]]
do = "hold"
keep = "load"
duration_s = 1e9
[[phases]]
do = "cycles"
count = 0
[[phases]]
do = "jump"
"""
    found = mistakes(tmp_path, phases)
    assert "load_n: a value above 0 (tension) or below 0 (compression) is expected, got 0.0" in found
    assert "phase 1 (to-load): rate_n_s: is missing; add it" in found
    assert "phase 2 (hold): duration_s: input should be less than or equal to 2592000" in found
    assert "phase 3 (cycles): count: input should be greater than or equal to 1, got 0" in found
    assert "phase 4: input tag 'jump' found using 'do' does not match any of the expected tags" in found


def test_contradictions_between_phases_and_tables_are_reported_together(tmp_path):
    phases = """
[[phases]]
do = "to-load"
load_n = 14000.0
rate_n_s = 200.0
images.every_n = 30.0
[[phases]]
do = "to-load"
load_n = 9000.0
rate_n_s = 200.0
[[phases]]
do = "preload"
load_n = 100.0
rate_n_s = 10.0
[[phases]]
do = "to-displacement"
displacement_mm = 9.0
speed_mm_s = 1.0
until.load_drop = 0.5
[[phases]]
do = "rotate"
angle_deg = 5.0
[[phases]]
do = "to-load"
load_n = 12000.0
rate_n_s = 200.0
until.plastic = {stiffness_fraction = 0.8, judged_above_n = 4000.0}
"""
    found = mistakes(tmp_path, phases, PULLING.replace("[start]\ntare_max_n = 100.0\n", ""))
    for sentence in (
        "phase 1 (to-load): limits.load_max_n must be at least 14020",
        "phase 1 (to-load): images.every_n must be more than twice its settle tolerance, 20, got 30",
        "phase 2 (to-load): a target above 14000 N, where the phase starts, is expected, got 9000",
        "phase 3 (preload): only the first phase can be a preload",
        "phase 4 (to-displacement): limits.displacement_max_mm must be at least 9.002",
        "phase 6 (to-load): until.plastic needs images at increments or times",
        "phase 4 (to-displacement): until.load_drop must be below limits.break_load_drop, 0.3",
        "settle.angle_tolerance_deg is missing",
        "start.tare_max_n is missing",
    ):
        assert sentence in found


LONG = HOLD.replace("100.0", "2592000.0").replace("40.0", "86400.0")
LONG += LONG[LONG.index('[[phases]]\ndo = "hold"') :]


@pytest.mark.parametrize(
    ("phases", "said"),
    [
        (CYCLES.replace("count = 5\nimages.every_cycles = 2", "count = 20000") * 3, "at most 50000 steps"),
        (LONG, "at most 720 hours are expected, got 1440"),
    ],
)
def test_a_test_without_end_is_a_mistake(tmp_path, phases, said):
    assert said in mistakes(tmp_path, phases)


def test_the_documentation_lists_every_kind_of_phase_with_its_keys():
    rows = re.findall(
        r'^\| `"([a-z-]+)"` \| (.+?) \|', (ROOT / "docs/protocols.md").read_text(), re.MULTILINE
    )
    listed = {do: set(re.findall("`([a-z_]+)`", keys)) for do, keys in rows}
    known = {get_args(kind.model_fields["do"].annotation)[0]: kind.model_fields.keys() for kind in PHASES}
    assert {do: listed.get(do, set()) for do in known} == {do: keys - {"do"} for do, keys in known.items()}
