"""Whole experiments on the virtual rig with drivers that no example names: only the rig file changes."""

import json
import sys

import pytest

from rig.cli import main
from tests.places import EXAMPLES

CAMERA = 'driver = "simulated-camera"'


@pytest.mark.parametrize(
    ("protocol", "rig_file", "edits"),
    [
        (
            "rotation",
            "rig-virtual-rotation-10.toml",
            {'driver = "zaber-ascii"': 'driver = "newport-esp301"', '"@stage"': '"@newport"'},
        ),
        (
            "tension",
            "rig-virtual-tension.toml",
            {
                '"@load_frame"': '"@load_frame_rtu_tcp"',
                'map = "generic"': 'map = "scaled-integers"',
                'driver = "virtual-rig"': 'driver = "virtual-rig"\nload_frame_map = "scaled-integers"',
            },
        ),
    ],
)
def test_an_experiment_runs_to_its_end(protocol, rig_file, edits, monkeypatch, tmp_path):
    text = (EXAMPLES / rig_file).read_text()
    for old, new in {CAMERA: f"{CAMERA}\nwidth_px = 32\nheight_px = 24", **edits}.items():
        assert old in text
        text = text.replace(old, new)
    rig_path, report = tmp_path / "rig.toml", tmp_path / "run.json"
    rig_path.write_text(text)
    arguments = [
        "run",
        EXAMPLES / f"{protocol}.toml",
        "--rig",
        rig_path,
        "-o",
        tmp_path / "run.h5",
        "--json",
        report,
    ]
    monkeypatch.setattr(sys, "argv", ["rig", *map(str, arguments)])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 0
    done = json.loads(report.read_text())
    assert done["status"] == "completed"
    reached = [step for step in done["steps"] if step["target"] is not None]
    assert len(reached) > 5
    for step in reached:
        if step["kind"] == "rotation":
            assert step["angle_deg"] == pytest.approx(step["target"], abs=0.01)
        if step["kind"] == "displacement":
            # the frame's own noise is 0.2 µm, its tolerance 0.1 µm
            assert step["displacement_mm"] == pytest.approx(step["target"], abs=2e-3)
