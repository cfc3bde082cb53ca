"""A test without a stop whose images are frames of two virtual GenTL cameras of the package genicam.

The cameras have no triggers and no time stamps: a pair is what came nearly together.
"""

from pathlib import Path

import numpy as np
import pytest

from simulators.rig.simulation import Simulation
from tests.real_cameras.gentl.test_virtual_cameras import PRODUCER
from tests.real_cameras.streamed import MACHINE, assert_travels, pull

pytestmark = [pytest.mark.realtime, pytest.mark.extended]
RATE_HZ = 10.0
CAMERA = """
[cameras.{name}]
driver = "gentl"
cti = "{producer}"
camera = "{serial}"
width_px = 160
height_px = 120
rate_hz = {rate_hz}
transfer_us = 0.0
"""
CAMERAS = ("left", "right")


@pytest.mark.parametrize("images", ["every_s = 0.2", "every_frame = true"])
def test_both_cameras_stream_into_a_pull(images: str, tmp_path: Path) -> None:
    cameras = "".join(
        CAMERA.format(name=name, producer=PRODUCER, serial=number, rate_hz=RATE_HZ)
        for number, name in enumerate(CAMERAS)
    )
    simulation = Simulation(MACHINE, "rig.toml", None)
    try:
        streamed = pull(tmp_path, simulation.rig_file() + cameras, f"{{ {images} }}")
    finally:
        simulation.close()
    print(streamed.report(f"pull before the virtual GenTL cameras, {images}"))
    timing = streamed.timing
    assert timing.taken + timing.missing == timing.asked
    assert timing.taken > 10
    assert_travels(streamed)
    for found in streamed.cameras.values():
        assert len(found["sequence"]) == timing.taken
        assert (np.diff(found["sequence"]) >= 1).all()
        assert (np.diff(found["middle_s"]) > 0.0).all()
    first, second = (found["middle_s"] for found in streamed.cameras.values())
    # of two cameras that run freely, each image is the nearest one to its time
    assert np.median(np.abs(first - second)) < 1.0 / RATE_HZ
    if images.startswith("every_frame"):
        assert np.abs(first - second).max() < 1.0 / RATE_HZ
        numbers = streamed.cameras[CAMERAS[0]]["sequence"]
        assert numbers[-1] - numbers[0] + 1 - len(numbers) <= timing.missing
