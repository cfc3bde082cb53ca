"""Runs with the stream of Aravis' fake camera, in a separate network (`test_gige_camera`).

While the machine pulls, the camera films a specimen that is stretched as far as that of the machine.
"""

import math
import subprocess
import sys
import threading
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from simulators.rig.simulation import Simulation
from tests.real_cameras.gige.guest_aravis import CLOCK, EXPOSURE_US, RATE_HZ, opened, plugged
from tests.real_cameras.pictures import LINES, PITCH_MM, SIDE_PX, STRAINS, picture_of, prepare, shown_in
from tests.real_cameras.streamed import MACHINE, Streamed, acquire, assert_travels, pull

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
    print(streamed.report("acquisition from Aravis' camera"))
    assert streamed.timing.taken + streamed.timing.missing == streamed.timing.asked == 31
    assert streamed.timing.taken > 10  # of a computer that is slow
    found = streamed.cameras["gige"]
    assert len(found["sequence"]) == streamed.timing.taken
    assert (np.diff(found["sequence"]) >= 1).all()
    assert (np.diff(found["middle_s"]) > 0.0).all()
    assert np.ptp(found["data"][0]) > 50


SPECKLES = CAMERA.replace("width_px = 256", f"width_px = {SIDE_PX}").replace(
    "height_px = 128", f"height_px = {SIDE_PX}"
)
LIVE = f"""
[grid]
lines_x = {LINES}
lines_y = {LINES}
pitch_mm = {PITCH_MM}
grid_made = "exact"

[live]
gauges = ["axial=extensometer unit=mm start=0,-1.2 end=0,1.2 patch=0.6"]
subset_px = 31
motion = "free"
"""


TRIGGERED = 'trigger = "Software"\n'


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("pictures") / "pictures.npy"
    prepare(path)
    return path


class SpeckleCamera:
    """Aravis' camera with prepared pictures of the simulated specimen as it is at each moment.

    With `trigger_hz` it is given pulses. They end when the crosshead has gone `pulses_to_mm`.
    """

    def __init__(self, simulation: Simulation, path: Path, trigger_hz: float, pulses_to_mm: float) -> None:
        command = [sys.executable, "-m", "tests.real_cameras.gige.speckle_camera", str(path)]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, text=True)
        self._simulation, self._trigger_hz, self._pulses_to_mm = simulation, trigger_hz, pulses_to_mm
        self._ends = threading.Event()
        self._follower = threading.Thread(target=self._follow)
        self._follower.start()

    def close(self) -> None:
        self._ends.set()
        self._follower.join()
        self._process.communicate(timeout=10.0)

    def _follow(self) -> None:
        due_s = CLOCK.now_s()
        while not self._ends.wait(0.01):
            truth = self._simulation.rig.truth()
            attached, strain = bool(truth["grid_attached"]), float(truth["axial_strain"])
            self._say(str(picture_of(grid_attached=attached, axial_strain=strain)))
            if self._trigger_hz and CLOCK.now_s() >= due_s:
                due_s += 1 / self._trigger_hz
                if truth["displacement_mm"] <= self._pulses_to_mm:
                    self._say("trigger")

    def _say(self, line: str) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(f"{line}\n")
        self._process.stdin.flush()


def pulled(
    folder: Path,
    pictures: Path,
    images: str,
    keys: str = "",
    trigger_hz: float = 0.0,
    pulses_to_mm: float = math.inf,
) -> Streamed:
    """Pull the specimen of the simulation in front of Aravis' camera."""
    with (
        closing(Simulation(MACHINE, "rig.toml", None)) as simulation,
        closing(SpeckleCamera(simulation, pictures, trigger_hz, pulses_to_mm)),
    ):
        opened(width_px=SIDE_PX, height_px=SIDE_PX).close()  # it answers by now
        return pull(folder, simulation.rig_file() + SPECKLES + keys, images, LIVE)


def assert_true(streamed: Streamed) -> None:
    """Check the frames and the live strains of a pull by what the pictures say of themselves."""
    found, live = streamed.cameras["gige"], streamed.live
    assert len(found["sequence"]) == streamed.timing.taken > 10
    assert (np.diff(found["sequence"]) >= 1).all()
    assert (np.diff(found["middle_s"]) > 0.0).all()
    assert_travels(streamed)
    shown = np.array([shown_in(image) for image in found["data"]])
    # the picture was chosen a moment before the exposure, and strains are rounded to those of pictures
    np.testing.assert_array_equal(np.diff(shown[:, 1]), np.diff(found["sequence"]))
    assert (np.diff(shown[:, 0]) >= 0).all()
    strain = STRAINS[shown[:, 0] - 1]
    assert strain[-1] - strain[0] > 0.003
    # a frame that was measured is the recorded one; others were left out on a slow computer
    nearest = np.abs(live["time_s"][:, None] - found["middle_s"]).argmin(axis=0)
    measured = np.abs(live["time_s"][nearest] - found["middle_s"]) < 1e-6
    valid = measured & (live["gauge.axial.cause"][nearest] == 0)
    error, std = live["gauge.axial"][nearest] - strain, live["gauge.axial.std"][nearest]
    print(
        f"live gauge in the frames of Aravis' camera: {valid.sum()} valid of {measured.sum()} measured of "
        f"{len(measured)} recorded, error {1e6 * np.sqrt(np.mean(error[valid] ** 2)):.0f} µε rms, "
        f"{1e3 * np.median(live['gauge_latency']):.0f} ms from the exposure to the value"
    )
    assert valid.sum() > measured.sum() / 2 > len(measured) / 8
    assert (np.abs(error[valid]) < 1.5e-4).all()
    assert (np.abs(error[valid]) < 4.0 * std[valid]).all()


def test_the_camera_streams_into_a_pull_with_a_live_gauge(tmp_path: Path, pictures: Path) -> None:
    streamed = pulled(tmp_path, pictures, "{ every_s = 0.2 }")
    print(streamed.report("pull before Aravis' camera, free-running"))
    assert_true(streamed)
    timing = streamed.timing
    assert timing.taken + timing.missing == timing.asked > 30


def test_each_trigger_is_an_image_of_a_pull(tmp_path: Path, pictures: Path) -> None:
    streamed = pulled(tmp_path, pictures, "{ every_frame = true }", TRIGGERED, trigger_hz=10.0)
    print(streamed.report("pull before Aravis' camera, with triggers"))
    assert_true(streamed)
    numbers = streamed.cameras["gige"]["sequence"]
    # every frame is in the file, or is told
    assert numbers[-1] - numbers[0] + 1 - len(numbers) <= streamed.timing.missing
    assert streamed.timing.taken + streamed.timing.missing == streamed.timing.asked


def test_triggers_that_end_while_the_machine_moves_are_told(tmp_path: Path, pictures: Path) -> None:
    streamed = pulled(
        tmp_path, pictures, "{ every_frame = true }", TRIGGERED, trigger_hz=10.0, pulses_to_mm=0.2
    )
    print(streamed.report("pull before Aravis' camera, with a trigger line that breaks"))
    # 4 s of 8 s, the pauses of a slow computer apart
    assert streamed.timing.taken > 10
    assert streamed.timing.missing > 10
    told = [text for text in streamed.outcome.shortfalls if "no trigger gave a frame" in text]
    assert told
    assert "cameras.gige.trigger" in told[0]
