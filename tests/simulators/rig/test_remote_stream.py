"""Another program takes all frames of a camera of `rig simulate`, whose faults are switched on by hand."""

import json
import threading
from contextlib import closing
from itertools import pairwise

import numpy as np
import pytest

from drivers.errors import DeviceError, DeviceFault, DeviceTimeout, LinkLost
from simulators.rig.simulation import Simulation
from tests.simulators.small_rig import SMALL, TABLES

FILMING = {"cameras": {"front": SMALL | {"fps": 20.0, "readout_us": 1000.0}, "asked": SMALL}}


@pytest.fixture
def simulation(log):
    before = set(threading.enumerate())
    with closing(Simulation(TABLES | FILMING, "rig.toml", log)) as started:
        yield started
    assert set(threading.enumerate()) <= before


def frames_until_the_end(stream):
    """Take frames until the stream ends with an error; it ends within some seconds."""
    for _ in range(200):
        stream.next(5.0)


def test_a_stream_brings_all_frames_and_the_log_knows_their_truth(simulation, rig, log):
    assert not hasattr(rig.cameras["asked"], "stream")
    with closing(rig.cameras["front"].stream(64)) as stream:
        frames = [stream.next(5.0) for _ in range(8)]
        (answer,) = simulation.command("fault picture.cover@front after 0.2")
        assert answer.startswith("on: nothing; planned: picture.cover@front after ")
        frames += [stream.next(5.0) for _ in range(8)]
        report = stream.report()
    assert all(later.exposed_s > frame.exposed_s for frame, later in pairwise(frames))
    skipped = frames[-1].sequence - frames[0].sequence + 1 - len(frames)
    assert report.lost == skipped
    simulation.log.sample()
    lines = [json.loads(line) for line in log.read_text().splitlines()]
    told = {line["sequence"]: line for line in lines if line["what"] == "frame"}
    (first,) = [line for line in lines if line["what"] == "picture"]
    assert (first["fault"], first["camera"]) == ("cover", "front")
    for frame in frames:
        assert told[frame.sequence]["middle_s"] == frame.middle_s
        assert told[frame.sequence]["faults"] == (["cover"] if frame.sequence >= first["sequence"] else [])
        if frame.sequence > first["sequence"]:
            assert frame.image.mean() < 8
    assert frames[-1].sequence > first["sequence"] > frames[7].sequence
    # the camera can be asked again
    assert rig.cameras["front"].grab(5.0).sequence > frames[-1].sequence


def test_errors_of_the_camera_end_the_stream(simulation, rig):
    with closing(rig.cameras["front"].stream(64)) as stream:
        stream.next(5.0)
        with pytest.raises(DeviceError, match="no open stream"):
            rig.cameras["front"].grab(1.0)
        simulation.command("fault camera.unplug")
        with pytest.raises(LinkLost, match="a camera on its cable"):
            frames_until_the_end(stream)
    simulation.command("clear")
    with closing(rig.cameras["front"].stream(64)) as stream:
        assert np.ptp(stream.next(5.0).image) > 50
        simulation.close()
        # A last frame may come before its time, as nothing waits any more.
        with pytest.raises((LinkLost, DeviceTimeout, DeviceFault)):
            frames_until_the_end(stream)


def test_unknown_cameras_and_quantities_are_told(simulation):
    for command, told in [
        ("fault picture.glare@side", "expected one of asked, front after @, got 'side'"),
        ("fault picture.glare soon", "expected FAULT after SECONDS, or when QUANTITY above NUMBER"),
        ("fault picture.glare when stress above 3", "quantities: displacement_mm"),
        ("fault nothing.glare after 3", "expected DEVICE.FAULT with one of"),
    ]:
        (answer,) = simulation.command(command)
        assert told in answer
