"""Measure by the simulator's log how long a machine still moves after a signal, a hang or a kill.

The measured times are real times of the programs, the lines and the system's scheduling. The quick test
checks the median of three times, which other programs hardly affect. The long test checks the largest of
thirty times. `test_guarded_run.py` measures one time each after a signal, a kill and a hang.
"""

from statistics import median

import pytest

from tests.rig.guardian.stopping import EVENTS, FRAME, FROZEN_MS, STAGE, bench, measure

pytestmark = pytest.mark.realtime

MACHINES = pytest.mark.parametrize("machine", [FRAME, STAGE], ids=lambda machine: machine.name)
LINES = [("stage", "load_frame"), ("stage_tcp", "load_frame_rtu")]


QUICK = [
    pytest.param(event, machine, id=f"{event}-{machine.name}")
    for event in EVENTS
    for machine in (FRAME, STAGE)
    # the stage's hangs take 20 s each, and stand in the long campaign
    if not ("hangs" in event and machine is STAGE)
]


@pytest.mark.extended
@pytest.mark.parametrize(("event", "machine"), QUICK)
def test_a_machine_stands_in_time(event, machine, bench_on):
    # a hang takes most of its second in any case, so one is enough to see its bound
    bound_ms = EVENTS[event][1]
    times = measure(bench_on(), machine, event, 1 if "hangs" in event else 3, bound_ms)
    assert median(times.ms) <= bound_ms, times


@pytest.mark.extended
def test_a_load_frame_stands_by_its_own_watchdog_when_everything_of_ours_is_frozen(bench_on):
    times = measure(bench_on(), FRAME, "all frozen", 1)
    assert max(times.ms) <= FROZEN_MS, times


@pytest.mark.extended
@MACHINES
def test_a_machine_on_a_line_that_only_the_guardian_has_stands_in_time(machine, bench_on):
    bound_ms = EVENTS["kill -9"][1]
    times = measure(bench_on("stage_tcp", "load_frame_rtu"), machine, "kill -9", 3, bound_ms)
    assert median(times.ms) <= bound_ms, times


@pytest.mark.long
@pytest.mark.parametrize(("stage", "load_frame"), LINES)
def test_the_worst_of_thirty_stands_in_time(stage, load_frame, tmp_path):
    late = []
    with bench(tmp_path, stage, load_frame) as measured:
        for event, (_, bound_ms) in {**EVENTS, "all frozen": (None, FROZEN_MS)}.items():
            for machine in (FRAME, STAGE):
                if (event, machine) == ("all frozen", STAGE):
                    # a stage has no watchdog
                    continue
                times = measure(measured, machine, event, 30)
                print(times)
                if max(times.ms) > bound_ms:
                    late.append(f"{times}, expected {bound_ms:g} ms at most")
    assert late == []
