"""A run and its guardian each notice if the other one ends, and then bring the machines to rest."""

import os
import signal
import time
from contextlib import closing

import pytest

from tests.command_line import run_rig
from tests.rig.guardian.stopping import EVENTS, FRAME, STAGE, guardian_of, hang, kill, signals

pytestmark = pytest.mark.realtime

SHARED, RELAYED = ("stage", "load_frame"), ("stage_tcp", "load_frame_rtu_tcp")
CASES = [
    pytest.param(SHARED, FRAME, id="load frame on tcp"),
    pytest.param(SHARED, STAGE, id="stage on a pty", marks=pytest.mark.extended),
    pytest.param(RELAYED, FRAME, id="load frame on rtu", marks=pytest.mark.long),
    pytest.param(RELAYED, STAGE, id="stage on tcp", marks=pytest.mark.long),
]


@pytest.mark.parametrize(("lines", "machine"), CASES)
@pytest.mark.parametrize(
    "how",
    [
        pytest.param(signal.SIGKILL, id="killed"),
        pytest.param(signal.SIGSTOP, id="frozen", marks=pytest.mark.extended),
    ],
)
def test_a_run_without_its_guardian_ends_with_its_machine_at_rest(how, machine, lines, bench_on):
    measured = bench_on(*lines)
    with closing(measured.started(machine)) as run:
        os.kill(guardian_of(run), how)
        status, said = run.end()
        sentences = said.strip().splitlines()
        # On a line that only the guardian has, the driver may hang, and a second sentence says so.
        assert all("its driver hangs" in sentence for sentence in sentences[1:]), said
        assert status == 1
        expected = "the guardian died" if how is signal.SIGKILL else "the guardian did not answer for 0.51 s"
        assert expected in said
        assert "NOT CONFIRMED" not in said
        assert measured.stands(machine)
        assert not (measured.folder / "run.guardian.log").exists()


@pytest.mark.parametrize(("lines", "machine"), CASES)
def test_a_run_that_was_frozen_finds_its_machine_at_rest_and_ends(machine, lines, bench_on):
    """After the guardian's stop, no later command of the run may be executed."""
    measured = bench_on(*lines)
    with closing(measured.started(machine)) as run:
        assert measured.stood_after_ms(machine, run, hang(measured, machine)) <= EVENTS["engine hangs"][1]
        run.process.send_signal(signal.SIGCONT)
        status, said = run.end()
        assert status == 1
        assert "rig guardian: the run made no progress for 0.85 s" in said
        assert "Traceback" not in said
        assert measured.stands(machine)


def test_a_dead_run_leaves_one_line_on_the_terminal_and_in_a_log_beside_the_run_file(bench_on):
    measured = bench_on()
    with closing(measured.started(STAGE)) as run:
        assert measured.stood_after_ms(STAGE, run, kill(measured, STAGE)) <= EVENTS["kill -9"][1]
        _, said = run.process.communicate(timeout=60)
        (line,) = said.splitlines()
        assert line.startswith("rig guardian: the process of the run is gone: load_frame and stage stopped, ")
        (logged,) = (measured.folder / "run.guardian.log").read_text().splitlines()
        assert logged.endswith(line)


def test_the_machines_of_a_run_belong_to_it_alone_until_a_signal_stops_them(bench_on):
    measured = bench_on()
    with closing(measured.started(STAGE)) as run:
        folder = measured.folder
        for arguments in (
            ("run", folder / "stage.toml", "--rig", folder / "use.toml", "-o", folder / "second.h5"),
            ("check", folder / "use.toml"),
        ):
            refused = run_rig(*arguments)
            assert refused.status == 2
            assert f"pid {run.process.pid} (" in refused.err
            assert len(refused.err.splitlines()) == 1
        assert run.process.poll() is None
        assert measured.stood_after_ms(STAGE, run, signals(measured, STAGE)) <= EVENTS["signal"][1]
        assert run.end()[0] == 1


def test_a_machine_that_the_guardian_cannot_reach_is_told_before_anything_moves(bench_on):
    measured = bench_on()
    arguments = measured.command(STAGE)
    measured.simulation.type("fault load_frame.unplug")
    measured.simulation.wait_for("on: ")
    refused = run_rig(*arguments)
    assert refused.status == 2
    assert "reach the machine for the guardian" in refused.err
    assert len(refused.err.splitlines()) == 1
    assert not (measured.folder / "run.h5").exists()


@pytest.mark.extended
def test_a_stage_whose_line_was_cut_for_longer_than_a_stop_waits_is_stopped_when_it_is_back(bench_on):
    measured = bench_on()
    with closing(measured.started(STAGE)) as run:
        measured.simulation.type("fault stage.unplug")
        measured.simulation.wait_for("on: ")
        log = measured.folder / "run.guardian.log"
        while not (log.exists() and "STOP NOT CONFIRMED" in log.read_text()):
            time.sleep(0.05)
        back_s = time.monotonic()
        measured.simulation.type("clear")
        measured.simulation.wait_for("on: ")
        assert measured.stands(STAGE)
        assert time.monotonic() - back_s < 5.0, "the motion had ended by itself"
        status, said = run.end()
        assert status == 1
        assert "did not answer" not in said
        assert "stage (" in said.splitlines()[-1]
        _, again = log.read_text().splitlines()
        assert "load_frame and stage stopped, confirmed after" in again


def test_hold_asks_the_run_that_has_the_machine_to_end_and_then_holds_itself(bench_on):
    measured = bench_on()
    with closing(measured.started(FRAME)) as run:
        held = run_rig("hold", measured.folder / "use.toml")
        assert held.status == 0
        assert held.out.startswith("completed: The load frame holds at ")
        assert f"pid {run.process.pid} (" in held.err
        assert "asked to end, which holds the load frame and stops the stage" in held.err
        status, said = run.end()
        assert status == 1
        assert "SIGTERM" in said
        assert measured.stands(FRAME)
