"""Whole experiments on the virtual rig with drivers that no example uses. Only the rig file changes."""

import pytest

from tests.command_line import run_rig
from tests.places import example

CAMERA = 'driver = "simulated-camera"'
SHORT = {
    "rotation": [("increment_deg = 22.5", "increment_deg = 45.0")],
    "tension": [("total_mm = 5.0", "total_mm = 3.0")],
}


@pytest.mark.parametrize(
    ("protocol", "rig_file", "edits"),
    [
        (
            "rotation",
            "rig-virtual-rotation-10",
            {'driver = "zaber-ascii"': 'driver = "newport-esp301"', '"@stage"': '"@newport"'},
        ),
        pytest.param(
            "tension",
            "rig-virtual-tension",
            {
                '"@load_frame"': '"@load_frame_rtu_tcp"',
                'map = "generic"': 'map = "scaled-integers"',
                'driver = "virtual-rig"': 'driver = "virtual-rig"\nload_frame_map = "scaled-integers"',
            },
            marks=pytest.mark.extended,
        ),
    ],
)
def test_an_experiment_runs_to_its_end(protocol, rig_file, edits, tmp_path):
    rig_path = tmp_path / "rig.toml"
    small = (CAMERA, f"{CAMERA}\nwidth_px = 32\nheight_px = 24")
    rig_path.write_text(example(rig_file, small, *edits.items()))
    paths = ["--rig", rig_path, "-o", tmp_path / "run.h5", "--json", tmp_path / "run.json"]
    (tmp_path / "protocol.toml").write_text(example(protocol, *SHORT[protocol]))
    ended = run_rig("run", tmp_path / "protocol.toml", *paths)
    assert ended.status == 0, ended
    done = ended.report
    assert done["status"] == "completed"
    reached = [step for step in done["steps"] if step["target"] is not None]
    assert len(reached) > 5
    for step in reached:
        if step["kind"] == "rotation":
            assert step["angle_deg"] == pytest.approx(step["target"], abs=0.01)
        if step["kind"] == "displacement":
            # the frame's own noise is 0.2 µm, its tolerance 0.1 µm
            assert step["displacement_mm"] == pytest.approx(step["target"], abs=2e-3)
