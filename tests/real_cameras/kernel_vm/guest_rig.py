"""Complete runs in real time with two cameras of the kernel, in the virtual machine.

The stage is simulated by `rig simulate`, on a pseudo-terminal.
"""

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from rig.commands.verify import verify_run
from rig.devices import Rig, open_rig
from rig.recorder import StepRecord
from rig.run import run_protocol
from simulators.rig.simulation import Simulation
from tests.real_cameras.kernel_vm.guest import left_open, turn
from tests.real_cameras.streamed import (
    MACHINE,
    Streamed,
    acquire,
    assert_counter_keeps_time,
    assert_travels,
    pull,
)

TABLES = {
    "rig": {"name": "rotation rig with the kernel's cameras"},
    "simulation": {"driver": "virtual-rig"},
    "stage": {"driver": "zaber-ascii", "port": "@stage", "angle_min_deg": -5.0, "angle_max_deg": 365.0},
}
CAMERA = """
[cameras.{name}]
driver = "v4l2"
device = "/dev/video{number}"
width_px = 320
height_px = 180
rate_hz = {rate_hz}
controls = {{ timestamp_source = 1 }}
"""
PROTOCOL = """
kind = "rotation"
title = "Three images of a turn by two degrees"

[sample]
name = "test pattern"
thickness_mm = 1.0
width_mm = 25.0
gauge_length_mm = 25.0

[rotation]
increment_deg = 1.0
total_deg = 2.0

[settle]
angle_tolerance_deg = 0.01
dwell_s = 0.1
timeout_s = 60.0
poll_s = 0.05

[grid]
lines_x = 21
lines_y = 21
pitch_mm = 0.5

[images]
per_step = 2
timeout_s = 10.0
camera_return_s = 3.0
"""
CAMERAS = ("left", "right")
PER_STEP = 2


@pytest.fixture
def simulation() -> Iterator[Simulation]:
    simulation = Simulation(TABLES, "rig.toml", None)
    yield simulation
    simulation.close()
    assert left_open() == []


@pytest.fixture
def files(simulation: Simulation, tmp_path: Path) -> tuple[Path, Path, Path]:
    """The paths of the protocol, the rig file and the future run file."""
    protocol, rig_file = tmp_path / "protocol.toml", tmp_path / "rig.toml"
    protocol.write_text(PROTOCOL)
    rig_file.write_text(simulation.rig_file() + cameras())
    return protocol, rig_file, tmp_path / "run.h5"


STEPS = ("grid", "reference", "static", "static", "rotation", "rotation")
"""The steps of the run: the grid image, the reference at 0°, two still images, and two rotations by 1°."""


def test_a_run_logs_fresh_images_of_both_cameras(files: tuple[Path, Path, Path]) -> None:
    outcome = run_protocol(*files)
    assert (outcome.status, outcome.reason) == ("completed", "")
    verification = verify_run(files[2])
    assert verification.problems == []
    with h5py.File(files[2]) as run:
        steps = run["entry/steps"]
        assert [kind.decode() for kind in steps["kind"][:]] == list(STEPS)
        np.testing.assert_allclose(steps["angle_deg"][-2:], [1.0, 2.0], atol=0.01)
        for name in CAMERAS:
            camera = run["entry/instrument"][name]
            assert camera.attrs["vendor"] == "vivid"
            assert verification.cameras[name].in_steps == len(STEPS) * PER_STEP == len(camera["data"])
            assert (np.diff(camera["sequence"][:]) > 0).all()
            # settled first, exposed then: on the kernel's own stamps
            assert (camera["exposed_s"][:] >= steps["time_s"][:][camera["step"][:]]).all()
            assert np.ptp(camera["data"][0]) > 100
    print(f"run with the kernel's cameras: {len(STEPS)} steps, {len(CAMERAS)} cameras")


def test_a_camera_that_is_pulled_out_and_comes_back_is_used_again(
    files: tuple[Path, Path, Path], simulation: Simulation, monkeypatch: pytest.MonkeyPatch
) -> None:
    rigs: list[Rig] = []

    @contextlib.contextmanager
    def opening(*arguments: Any, **options: Any) -> Iterator[Rig]:
        with open_rig(*arguments, **options) as rig:
            rigs.append(rig)
            yield rig

    def pull_out(record: StepRecord) -> None:
        if record.step.kind == "reference":
            turn("Disconnect", camera=rigs[0].cameras["right"])  # type: ignore[arg-type]

    monkeypatch.setattr("rig.guardian.announced.open_rig", opening)
    outcome = run_protocol(*files, on_step=[pull_out])
    # the kernel's camera is there again as soon as it is opened anew
    assert (outcome.status, outcome.unsafe) == ("completed", ()), outcome.reason
    with h5py.File(files[2]) as run:
        messages = [text.decode() for text in run["entry/events/message"][:]]
    assert any("cameras.right (/dev/video1)" in text and "ENODEV" in text for text in messages), messages
    assert any("cameras.right" in text and "the camera is back after" in text for text in messages), messages
    assert not simulation.rig.stage.moving
    verification = verify_run(files[2])
    assert (verification.status, verification.problems) == ("completed", [])
    for check in verification.cameras.values():
        assert (check.in_steps, check.damaged) == (len(STEPS) * PER_STEP, [])


def cameras(rate_hz: float = 30.0) -> str:
    return "".join(
        CAMERA.format(name=name, number=number, rate_hz=rate_hz) for number, name in enumerate(CAMERAS)
    )


def assert_fresh(streamed: Streamed, rate_hz: float = 30.0) -> None:
    """Check the images of both cameras. The processor of the machine may be emulated, so some are missing."""
    assert streamed.timing.taken > 10
    assert streamed.timing.taken + streamed.timing.missing == streamed.timing.asked
    for name in CAMERAS:
        found = streamed.cameras[name]
        assert len(found["sequence"]) == streamed.timing.taken
        assert_counter_keeps_time(found["sequence"], found["middle_s"], rate_hz)
        assert np.ptp(found["data"][0]) > 100


def test_both_cameras_stream_into_an_acquisition(simulation: Simulation, tmp_path: Path) -> None:
    streamed = acquire(tmp_path, simulation.rig_file() + cameras(), 0.1, 6.0, 0.05)
    print(streamed.report("acquisition from the kernel's cameras"))
    assert streamed.timing.asked == 61
    assert_fresh(streamed)


@pytest.mark.parametrize(("images", "rate_hz"), [("every_s = 0.2", 30.0), ("every_frame = true", 5.0)])
def test_both_cameras_stream_into_a_pull(images: str, rate_hz: float, tmp_path: Path) -> None:
    simulation = Simulation(MACHINE, "rig.toml", None)
    try:
        streamed = pull(tmp_path, simulation.rig_file() + cameras(rate_hz), f"{{ {images} }}")
    finally:
        simulation.close()
    print(streamed.report(f"pull before the kernel's cameras at {rate_hz:g} Hz, {images}"))
    assert_fresh(streamed, rate_hz)
    assert_travels(streamed)
    if rate_hz < 30.0:
        # the cameras are not triggered together: each frame of the first one that is not recorded is told
        numbers = streamed.cameras[CAMERAS[0]]["sequence"]
        assert numbers[-1] - numbers[0] + 1 - len(numbers) <= streamed.timing.missing
