"""An acquisition from the stream of Aravis' fake camera, in a separate network (`test_gige_camera`)."""

from pathlib import Path

import numpy as np

from simulators.rig.simulation import Simulation
from tests.real_cameras.gige.guest_aravis import EXPOSURE_US, RATE_HZ, opened, plugged
from tests.real_cameras.streamed import acquire

TABLES = {
    "rig": {"name": "rig with a GigE Vision camera"},
    "simulation": {"driver": "virtual-rig"},
    "stage": {"driver": "zaber-ascii", "port": "@stage", "angle_min_deg": -5.0, "angle_max_deg": 365.0},
}
CAMERA = f"""
[cameras.gige]
driver = "aravis"
camera = "127.0.0.1"
width_px = 256
height_px = 128
rate_hz = {RATE_HZ}
exposure_us = {EXPOSURE_US}
gain = 1.0
transfer_us = 0.0
"""


def test_the_camera_streams_into_an_acquisition(tmp_path: Path) -> None:
    simulation = Simulation(TABLES, "rig.toml", None)
    try:
        # of 200 packets one is lost
        with plugged("-r", "5"):
            opened().close()  # it answers by now
            streamed = acquire(tmp_path, simulation.rig_file() + CAMERA, 0.2, 6.0, 0.1)
    finally:
        simulation.close()
    print(streamed.report("Aravis' camera"))
    assert streamed.timing.taken + streamed.timing.missing == streamed.timing.asked == 31
    assert streamed.timing.taken > 10  # of a computer that is slow
    found = streamed.cameras["gige"]
    assert len(found["sequence"]) == streamed.timing.taken
    assert (np.diff(found["sequence"]) >= 1).all()
    assert (np.diff(found["middle_s"]) > 0.0).all()
    assert np.ptp(found["data"][0]) > 50
