"""A `rig run` of many steps on a virtual rig, which `test_killed_rig_runs` starts and kills.

The protocol and the rig file are in the folder of the run file.
"""

import sys
from pathlib import Path

import rig
import rig.cli
from tests.rig.recorder.forked_runs import serve

RIG = """
[rig]
name = "to be killed"
[simulation]
driver = "virtual-rig"
[stage]
driver = "zaber-ascii"
port = "@stage_tcp"
angle_min_deg = -5.0
angle_max_deg = 365.0
speed_deg_s = 100.0
acceleration_deg_s2 = 1000.0
reply_timeout_s = 20.0
[cameras.left]
driver = "simulated-camera"
width_px = 32
height_px = 24
[cameras.right]
driver = "simulated-camera"
width_px = 32
height_px = 24
[operator]
driver = "simulated-operator"
duration_s = 0.0
"""
PROTOCOL = """
kind = "rotation"
title = "more turns than anybody waits for"
[sample]
name = "plate"
thickness_mm = 1.0
width_mm = 25.0
gauge_length_mm = 25.0
[images]
per_step = 2
[rotation]
increment_deg = 0.25
total_deg = 360.0
[settle]
angle_tolerance_deg = 0.01
dwell_s = 0.05
timeout_s = 60.0
poll_s = 0.05
"""


def write_files(folder: Path) -> None:
    """Write the protocol and the rig file of all runs in a folder."""
    (folder / "rig.toml").write_text(RIG)
    (folder / "protocol.toml").write_text(PROTOCOL)


def run(path: Path) -> None:
    """Execute `rig run` for the run file `path`, in the same way as the command line."""
    files = (path.parent / "protocol.toml", "--rig", path.parent / "rig.toml", "-o", path)
    sys.argv = ["rig", "run", *map(str, files)]
    rig.cli.main()


def main() -> None:
    """Import all modules of `rig run`, and then serve."""
    for name in rig.__all__:
        getattr(rig, name)
    serve(run)


if __name__ == "__main__":
    main()
