"""A replayed run gives the same images, readings, steps and strains as the run itself, bit by bit."""

import tomllib
from pathlib import Path

import h5py
import numpy as np
import pytest

from dic.runfile.reader import RunFile
from rig.commands.verify import verify_run
from rig.devices import OpenedInterlock
from rig.limit_settings import RigLimits
from rig.protocol.protocol import parse_protocol
from rig.replay.replay import replay_run
from rig.replay.script import ReplayError
from rig.run import run_protocol
from tests.places import example
from tests.rig.conftest import FakeInterlock, FakeRig
from tests.rig.engine.test_phases import SLOW
from tests.rig.protocol.test_phases import CYCLES, HOLD, MOVING, text


def identical(path: Path, new: Path) -> None:
    """Compare two run files without code of the replay, except for the order of rows and device warnings."""
    with h5py.File(path) as ours, h5py.File(new) as theirs:
        tables = ["entry/steps", *(f"entry/instrument/{name}" for name in ours["entry/instrument"])]
        tables += [f"entry/interlocks/{name}" for name in ours.get("entry/interlocks", ())]
        for table in tables:
            assert set(ours[table]) == set(theirs[table])
            for name, column in ours[table].items():
                if name not in ("order", "settings"):
                    np.testing.assert_array_equal(column[()], theirs[table][name][()], f"{table}/{name}")


PROTOCOLS = {
    "tension": example("tension"),
    "rotation": example("rotation"),
    "creep": text(HOLD, SLOW),
    "cycles": text(CYCLES, SLOW),
    "moving": text(MOVING, SLOW),
}


def fake(tmp_path: Path, name: str) -> FakeRig:
    definition = PROTOCOLS[name]
    protocol = parse_protocol(tomllib.loads(definition))
    return FakeRig(protocol, tmp_path / "run.h5", definition=definition)


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.extended if name in ("tension", "creep") else ())
        for name in PROTOCOLS
    ],
)
def test_a_replay_is_identical(tmp_path, name):
    rig = fake(tmp_path, name)
    assert rig.engine().run().status == "completed"
    replayed = replay_run(rig.path, tmp_path / "new.h5")
    assert (replayed.outcome.status, replayed.differences) == ("completed", [])
    identical(rig.path, tmp_path / "new.h5")
    assert replayed.steps > 3
    assert replayed.images == 2 * replayed.steps


def test_a_replay_of_a_completed_run_with_interlocks_is_identical(tmp_path):
    rig = fake(tmp_path, "rotation")
    for interlock, value in {"oven": lambda count: 20.0 + count % 7, "door": lambda count: 1.0}.items():
        rig.interlocks[interlock] = OpenedInterlock(FakeInterlock(rig.clock, value), 0.5, 27.0)
    assert rig.engine().run().status == "completed"
    replayed = replay_run(rig.path, tmp_path / "new.h5")
    assert (replayed.outcome.status, replayed.differences) == ("completed", [])
    identical(rig.path, tmp_path / "new.h5")
    assert verify_run(tmp_path / "new.h5").interlocks["oven"].readings == (
        rig.interlocks["oven"].device.reads
    )


def test_readings_during_a_slow_camera_and_a_slow_operator_are_replayed_in_their_places(tmp_path):
    rig = fake(tmp_path, "creep")
    rig.cameras["off_axis"].on_grab = lambda count, frame: rig.clock.sleep(3.7) or frame
    rig.operator.on_perform = lambda action: rig.clock.sleep(20.0)
    assert rig.engine().run().status == "completed"
    replayed = replay_run(rig.path, tmp_path / "new.h5")
    assert replayed.differences == []
    identical(rig.path, tmp_path / "new.h5")


def test_an_aborted_run_is_replayed_to_where_it_ended(tmp_path, at_step):
    rig = fake(tmp_path, "rotation")
    engine = rig.engine()
    at_step(5, lambda: engine.abort("the abort button"))
    assert engine.run().status == "aborted"
    replayed = replay_run(rig.path, tmp_path / "new.h5")
    assert replayed.outcome.status == "aborted"
    assert "the abort button" in replayed.outcome.reason
    assert replayed.steps == len(RunFile(rig.path).steps) == 6
    identical(rig.path, tmp_path / "new.h5")


def test_a_limit_that_ended_a_run_ends_its_replay_with_the_same_words(tmp_path):
    rig = fake(tmp_path, "tension")
    rig.load_frame.on_read = lambda count, state: (
        type(state)(**{**state.__dict__, "load_n": 20_000.0}) if count == 300 else state
    )
    outcome = rig.engine().run()
    assert outcome.status == "failed"
    replayed = replay_run(rig.path, tmp_path / "new.h5")
    assert replayed.outcome.reason == outcome.reason
    assert replayed.differences == []


def test_the_rig_s_own_limits_end_a_replay_as_they_ended_the_run(tmp_path):
    definition = PROTOCOLS["tension"]
    rig = FakeRig(
        parse_protocol(tomllib.loads(definition)),
        tmp_path / "run.h5",
        definition=definition,
        limits=RigLimits(displacement_max_mm=5.15),
        configuration="[limits]\ndisplacement_max_mm = 5.15\n",
    )
    rig.load_frame.on_read = lambda count, state: (
        type(state)(**{**state.__dict__, "displacement_mm": 5.17}) if count == 300 else state
    )
    outcome = rig.engine().run()
    assert "the rig's limits.displacement_max_mm" in outcome.reason
    replayed = replay_run(rig.path, tmp_path / "new.h5")
    assert replayed.outcome.reason == outcome.reason
    assert replayed.differences == []


def test_the_machine_s_least_load_ends_a_replay_as_it_ended_the_run(tmp_path):
    small = ('driver = "simulated-camera"', 'driver = "simulated-camera"\nwidth_px = 64\nheight_px = 64')
    at = 'address = "@load_frame"\n'
    rig_text = example("rig-virtual-tension").replace(*small)
    assert at in rig_text
    (tmp_path / "p.toml").write_text(example("tension"))
    # the load cell's noise is larger than this
    (tmp_path / "r.toml").write_text(rig_text.replace(at, f"{at}load_min_n = -0.01\n"))
    outcome = run_protocol(tmp_path / "p.toml", tmp_path / "r.toml", tmp_path / "run.h5")
    assert "the rig's load_frame.load_min_n" in outcome.reason
    replayed = replay_run(tmp_path / "run.h5", tmp_path / "new.h5")
    assert replayed.outcome.reason == outcome.reason
    assert replayed.differences == []


def test_a_difference_is_named(tmp_path, monkeypatch):
    rig = fake(tmp_path, "rotation")
    rig.engine().run()
    frame = RunFile.frame
    monkeypatch.setattr(RunFile, "frame", lambda self, camera, row: frame(self, camera, row) + (row == 3))
    replayed = replay_run(rig.path, tmp_path / "new.h5")
    assert any("off_axis" in sentence for sentence in replayed.differences)


def test_a_run_without_the_order_of_its_readings_is_refused(tmp_path):
    rig = fake(tmp_path, "rotation")
    rig.engine().run()
    rig.path.chmod(0o644)
    with h5py.File(rig.path, "r+") as file:
        del file["entry/instrument/stage/order"]
    with pytest.raises(ReplayError, match="recorded by an earlier version"):
        replay_run(rig.path)
