"""The live process dies or stands still while a strain rate is kept: the machine is held, in real time."""

import os
import random
import signal

import pytest

from tests.continuous.pulls import SEES, drive, protocol_text, rig_text
from tests.continuous.test_faults import MARGIN_S, PERIOD_S, PHASES, STEADY

STEADY_S = (3.0, 6.0)


def hold_time(folder, number, seed):
    """Send a signal to the live process; return the time from the first exposure without a value to hold."""
    rng = random.Random(seed)
    processes, sent_s, due_s = [], [], []

    def look(rig):
        now_s = rig.clock.now_s()
        if not due_s:
            if any(name.startswith("displacement ") for _, name in rig.load_frame.executed):
                due_s.append(now_s + rng.uniform(*STEADY_S))
        elif not sent_s and now_s >= due_s[0]:
            sent_s.append(now_s)
            os.kill(processes[0].pid, number)

    phases = PHASES.replace("return_s = 10.0\n", "").replace("DURATION", "30.0")
    simulation = {"real_time": True, "prepared": {"margin_px": 64}}
    text = rig_text({"front": SEES}, {"machine_stiffness_n_mm": 60_000.0}, seed=seed, **simulation)
    text = text.replace('"simulated-operator"', '"simulated-operator"\nduration_s = 0.5')
    pulled = drive(folder, protocol_text(phases, STEADY), text, look=look, on_live=processes.append)
    assert pulled.outcome.status == "failed"
    assert "axial" in pulled.outcome.reason, pulled.outcome.reason
    last = max(reading.frames["front"] for reading in pulled.live)
    begins = {each["sequence"]: each["begins_s"] for each in pulled.exposures}
    first_s = next(begins_s for number, begins_s in sorted(begins.items()) if number > last)
    held_s = next(time_s for time_s, name in pulled.commands if name == "hold" and time_s > sent_s[0])
    print(
        f"{signal.Signals(number).name}: held {1e3 * (held_s - first_s):.0f} ms after the first exposure "
        f"without a value, {1e3 * (held_s - sent_s[0]):.0f} ms after the signal"
    )
    return held_s - first_s


@pytest.mark.long
@pytest.mark.realtime
@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_live_process_that_is_gone_holds_the_machine(number, seed, tmp_path):
    assert hold_time(tmp_path, number, seed) <= 2.0 * PERIOD_S + MARGIN_S
