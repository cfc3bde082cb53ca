"""The strains of a run on the virtual rig are those of its replay by the command `rig replay`."""

import json
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import dic
from dic.correlation.settings import CorrelationSettings
from rig.cli import cli
from rig.run import run_protocol
from tests.places import example, small_cameras

COARSE = CorrelationSettings(step_px=40)


@pytest.mark.extended
def test_strains_of_a_replay_are_those_of_the_run(tmp_path: Path) -> None:
    protocol, rig_path = tmp_path / "protocol.toml", tmp_path / "rig.toml"
    # half a turn in one step
    protocol.write_text(example("rotation", ("increment_deg = 22.5", "increment_deg = 180.0")))
    rig_path.write_text(example("rig-virtual-rotation-10", small_cameras(450, 1400.0)))
    path, new, table = tmp_path / "run.h5", tmp_path / "new.h5", tmp_path / "replay.json"
    assert run_protocol(protocol, rig_path, path).status == "completed"

    done = CliRunner().invoke(cli, ["replay", str(path), "-o", str(new), "--json", str(table)])
    assert done.exit_code == 0, done.output
    assert "8 images" in done.output
    assert json.loads(table.read_text())["identical"] is True

    first, second = dic.process_run(path, COARSE), dic.process_run(new, COARSE)
    for ours, theirs in zip(first.cameras, second.cameras, strict=True):
        assert len(ours.measurements) == 2
        for a, b in zip(ours.measurements, theirs.measurements, strict=True):
            for mean, other in ((a.raw_mean, b.raw_mean), (a.mean, b.mean)):
                assert [repr(getattr(mean, f.name)) for f in fields(mean)] == [
                    repr(getattr(other, f.name)) for f in fields(other)
                ]
            np.testing.assert_array_equal(a.strain.eyy, b.strain.eyy)
