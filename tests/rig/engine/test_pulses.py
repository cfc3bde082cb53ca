"""Output lines give their pulses at the events of every protocol, and their faults end the run."""

import pytest

from drivers.errors import DeviceFault
from rig.devices import OpenedTrigger
from tests.rig.channels.fake_box import FakeLine
from tests.rig.conftest import FakeRig
from tests.rig.engine.test_acquisition import beside, with_tables


def lines(rig: FakeRig) -> dict[str, FakeLine]:
    made = {at: FakeLine(rig.clock) for at in ("exposure", "start", "step", "end")}
    rig.triggers = {at: OpenedTrigger(line, at) for at, line in made.items()}
    return made


def counts(rig: FakeRig) -> dict[str, int]:
    made = lines(rig)
    outcome = rig.engine().run()
    assert outcome.is_good, outcome.reason
    return {at: len(line.pulses_s) for at, line in made.items()}


def test_pulses_of_an_acquisition(tmp_path):
    rig = beside(tmp_path, with_tables("every_s = 0.5", "images = 10"))
    assert counts(rig) == {"exposure": 10, "start": 1, "step": 10, "end": 1}


def test_pulses_of_a_rotation(rotation):
    steps = len(rotation.protocol.steps())
    per_step = rotation.protocol.images.per_step
    assert counts(rotation) == {"exposure": steps * per_step, "start": 1, "step": steps, "end": 1}


@pytest.mark.parametrize("at", ["exposure", "start", "step", "end"])
def test_a_pulse_that_may_not_have_been_given_ends_the_run(tmp_path, at):
    rig = beside(tmp_path, with_tables("every_s = 0.5", "images = 10"))

    def fail():
        raise DeviceFault("triggers.logger", "pulse", "an answer", "none", "check the cable of the line")

    lines(rig)[at].pulse = fail
    outcome = rig.engine().run()
    assert outcome.status == "failed"
    assert "check the cable of the line" in outcome.reason
