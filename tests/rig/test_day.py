"""In a run of one simulated day, no data are lost, memory does not grow, and the machine is watched."""

import resource
import tomllib
from pathlib import Path

import h5py
import numpy as np
import pytest

from rig import run_protocol, verify_run

HOUR_S = 3600.0
RIG = """
[rig]
name = "a day"
[simulation]
driver = "virtual-rig"
[stage]
driver = "zaber-ascii"
port = "@stage_tcp"
angle_min_deg = -5.0
angle_max_deg = 90.0
[load_frame]
driver = "modbus-frame"
address = "@load_frame"
load_max_n = 5000.0
displacement_max_mm = 2.0
[cameras.front]
driver = "simulated-camera"
width_px = 32
height_px = 32
[operator]
driver = "simulated-operator"
"""
PROTOCOL = """
kind = "rotation"
title = "a day"
[sample]
name = "plate"
thickness_mm = 1.0
width_mm = 25.0
gauge_length_mm = 25.0
[rotation]
increment_deg = 1.0
total_deg = {total_deg}
[settle]
angle_tolerance_deg = 0.05
dwell_s = 3600.0
timeout_s = 3700.0
poll_s = 1.0
"""


def _run(folder: Path, hours: int) -> tuple[Path, int]:
    """Run a rotation with a dwell of one hour at each step; return the run file and the largest memory."""
    (folder / "rig.toml").write_text(RIG)
    protocol = folder / f"{hours}.toml"
    # the grid and the reference are steps, too
    protocol.write_text(PROTOCOL.format(total_deg=float(hours - 2)))
    assert tomllib.loads(protocol.read_text())["rotation"]["total_deg"] == hours - 2
    outcome = run_protocol(protocol, folder / "rig.toml", folder / f"{hours}.h5")
    assert (outcome.reason, outcome.steps_done) == ("", hours)
    return folder / f"{hours}.h5", resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


@pytest.mark.long
@pytest.mark.timeout(1800)
def test_a_day_takes_no_more_memory_than_three_hours_and_is_watched_every_second(tmp_path):
    _, short_bytes = _run(tmp_path, 3)
    path, long_bytes = _run(tmp_path, 24)

    # HDF5 lets its cache of metadata grow to 32 MiB, and no further
    assert long_bytes - short_bytes < 40 * 2**20
    assert verify_run(path).problems == []
    with h5py.File(path) as file:
        for device in ("load_frame", "stage"):
            times_s = file[f"entry/instrument/{device}/time_s"][()]
            assert times_s[-1] - times_s[0] > 24 * HOUR_S
            assert np.diff(times_s).max() < 1.5
