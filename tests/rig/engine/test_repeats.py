"""A run on the virtual rig gives the same bits in every repetition, although several threads are at work."""

import h5py
import numpy as np
import pytest

from rig.run import run_protocol
from tests.places import example

SMALL = ('driver = "simulated-camera"', 'driver = "simulated-camera"\nwidth_px = 32\nheight_px = 24')
ASKING_S = 60.0
"""Default duration in s of an action of the simulated operator."""


def datasets(path) -> dict[str, np.ndarray]:
    found = {}
    with h5py.File(path) as file:
        file.visititems(lambda name, item: found.update({name: item[()]} if hasattr(item, "shape") else {}))
    return found


@pytest.mark.extended
def test_two_runs_give_the_same_readings_at_the_same_times(tmp_path):
    protocol, rig_path = tmp_path / "protocol.toml", tmp_path / "rig.toml"
    protocol.write_text(example("tension", ("total_mm = 5.0", "total_mm = 3.0")))
    rig_path.write_text(example("rig-virtual-tension", SMALL))
    for name in ("one.h5", "other.h5"):
        assert run_protocol(protocol, rig_path, tmp_path / name).status == "completed"
    one, other = datasets(tmp_path / "one.h5"), datasets(tmp_path / "other.h5")
    assert one.keys() == other.keys()
    assert [name for name in one if one[name].tobytes() != other[name].tobytes()] == []
    # The load frame was read again and again while the operator and the cameras took their time.
    read_s = one["entry/instrument/load_frame/time_s"]
    exposed_s = one["entry/instrument/on_axis/exposed_s"]
    before_grid = read_s[read_s < exposed_s[0]]
    assert np.count_nonzero(np.diff(before_grid) > 1.0) == 0
    assert before_grid[-1] - before_grid[0] > ASKING_S
