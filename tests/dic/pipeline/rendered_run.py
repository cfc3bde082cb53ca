"""Write run files with any number of rendered images."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from drivers.interfaces import CameraInfo, DeviceInfo, Frame
from rig.mounting import Mounting
from rig.protocol.grid import Grid
from rig.protocol.step import ProtocolStep, RigReading
from rig.recorder import Recorder, StepRecord
from simulators.scene.optics import PinholeCamera
from simulators.scene.pose import Pose
from simulators.scene.render import render
from simulators.scene.scene import Surface
from simulators.scene.sensor import Sensor
from simulators.scene.texture import LineGrid, Speckle
from tests.run_files import HEADER, START

SIDE_PX, PITCH_MM = 420, 0.35
CAMERA = PinholeCamera(SIDE_PX, SIDE_PX, 2000.0, tilt_deg=30.0)
SMALL = PinholeCamera(280, 280, 1400.0, tilt_deg=30.0)
"""A camera with a smaller part of the same view, for tests in which only files and decisions count."""
SENSOR = Sensor(8, 32_500.0, 20.0, 12_000.0)
LINES = LineGrid(pitch_mm=PITCH_MM, overhang_mm=0.05, plate_half_mm=4.2)


def slid(slide_mm: float) -> Pose:
    """Return the pose of a specimen that has moved by `slide_mm` in its plane."""
    return Pose(np.eye(3), np.array([0.0, slide_mm, 0.0]))


def write_rendered_run(
    path: Path,
    loads: Sequence[Pose],
    *,
    repeats: int = 1,
    grid_pose: Pose | None = None,
    camera: PinholeCamera = CAMERA,
    has_grid: bool = True,
    **mounting: object,
) -> Path:
    """Write a run of a camera at 30° off-axis: grid, reference, and `repeats` times the poses in `loads`.

    The noise differs from image to image.
    """
    rng, texture = np.random.default_rng(3), Speckle.sprayed(11)
    reference, *loaded = (render(camera, Surface(texture, pose)) for pose in (Pose(), *loads))
    pictures = [("grid", render(camera, Surface(LINES, grid_pose or Pose()))), ("reference", reference)]
    pictures += [("load", picture) for picture in loaded] * repeats
    pictures = pictures if has_grid else pictures[1:]
    header = replace(HEADER, grid=Grid(pitch_mm=PITCH_MM), mounting=Mounting(**mounting))
    info = CameraInfo("v", "m", "s", width_px=camera.width_px, height_px=camera.height_px, bits=8)
    recorder = Recorder(path, header, {"aside": info}, load_frame=DeviceInfo("v", "m", "s"))
    for index, (kind, picture) in enumerate(pictures):
        image = SENSOR.expose(picture, 10_000.0, 1.0, rng)
        frame = Frame(image, float(index), index + 0.1, START, index, 0, 900.0, 1.0)
        step = ProtocolStep(index, kind, 1000.0 if kind == "load" else np.nan)
        frames = {"aside": (recorder.frame("aside", frame), 1)}
        recorder.step(StepRecord(step, RigReading(float(index), 1000.0), frames)).result(20)
    recorder.close("completed", "", START)
    return path
