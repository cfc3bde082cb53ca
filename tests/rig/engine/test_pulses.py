"""Output lines give pulses at the events of a run."""

import h5py

from drivers.errors import DeviceTimeout
from rig.devices import OpenedTrigger
from tests.rig.channels.fake_box import FakeLine


def test_output_lines_give_a_pulse_at_each_of_their_events(rotation):
    lines = {event: FakeLine(rotation.clock) for event in ("exposure", "start", "step", "end")}
    rotation.triggers = {event: OpenedTrigger(line, event) for event, line in lines.items()}
    assert rotation.engine().run().status == "completed"
    with h5py.File(rotation.path) as file:
        steps = len(file["entry/steps/kind"])
    assert [len(line.pulses_s) for line in lines.values()] == [steps, 1, steps, 1]


def test_an_output_line_that_fails_ends_the_run_safely(rotation):
    def fail():
        raise DeviceTimeout("triggers.logger", "pulse", "an answer", "none", "check the cable")

    line = FakeLine(rotation.clock)
    line.pulse = fail
    rotation.triggers = {"logger": OpenedTrigger(line, "exposure")}
    outcome = rotation.engine().run()
    assert outcome.status == "failed"
    assert "triggers.logger" in outcome.reason
    assert not outcome.unsafe
