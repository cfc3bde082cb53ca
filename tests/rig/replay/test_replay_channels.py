"""A commanded run is replayed although channels were recorded beside it; other runs with channels are not."""

import pytest

from rig.protocol.rotation import RotationProtocol
from rig.replay.replay import replay_run
from rig.replay.script import ReplayError
from tests.places import example
from tests.rig.channels.fake_box import FakeBox
from tests.rig.conftest import FakeRig
from tests.rig.engine.test_acquisition import beside


@pytest.fixture
def rotation_beside_a_box(rotation_table, tmp_path):
    protocol = RotationProtocol.model_validate(rotation_table)
    rig = FakeRig(protocol, tmp_path / "run.h5", definition=example("rotation"))
    rig.channels = {"box": FakeBox(rig.clock, lambda t: 100.0 * (t % 5.0))}
    return rig


def test_channels_beside_a_commanded_run_do_not_hinder_its_replay(rotation_beside_a_box, tmp_path):
    assert rotation_beside_a_box.engine().run().is_good
    replayed = replay_run(rotation_beside_a_box.path)
    assert replayed.differences == []
    assert replayed.steps == len(rotation_beside_a_box.protocol.steps())


def test_a_load_that_was_measured_or_an_acquisition_is_refused(rotation_beside_a_box, tmp_path):
    rotation_beside_a_box.measured = {"load": "force"}
    assert rotation_beside_a_box.engine().run().is_good
    with pytest.raises(ReplayError, match="expected a run whose steps were commanded"):
        replay_run(rotation_beside_a_box.path)
    rig = beside(tmp_path / "x")
    rig.path.parent.mkdir()
    assert rig.engine().run().is_good
    with pytest.raises(ReplayError, match="check it with rig verify"):
        replay_run(rig.path)
