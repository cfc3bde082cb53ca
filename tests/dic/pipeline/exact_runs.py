"""Runs with two cameras whose measurements follow from exact geometry, without images."""

from dataclasses import replace

import numpy as np

from dic.pipeline.camera_result import CameraResult
from dic.pipeline.run_corrections import CorrectionSettings, RunCorrector
from dic.pipeline.run_result import RunResult
from dic.runfile.reader import RunStep
from simulators.scene.optics import PinholeCamera
from tests.dic.out_of_plane.exact_views import State, View
from tests.dic.report.runs import INFO

ASIDE = View(PinholeCamera(800, 800, tilt_deg=30), seed=4)
STRAIGHT = View(PinholeCamera(800, 800), seed=5)


def run_of(steps: list[RunStep], aside: list[State], straight: list[State]) -> RunResult:
    """Return the result of a run with two cameras, corrected in the same way as by `process_run`."""
    cameras = []
    for name, view, states in (("aside", ASIDE, aside), ("straight", STRAIGHT, straight)):
        calibration = view.calibration()
        measured = view.measurements(states, calibration)
        reference = np.full((800, 800), 100, np.float32)
        cameras.append(
            CameraResult(name, calibration, reference, steps, measured, [f"{name}: step 9 failed"])
        )
    settings = CorrectionSettings(0.3)
    corrector = RunCorrector(cameras, settings)
    found = list(corrector.steps())
    corrections = corrector.corrections(found)
    cameras = [
        replace(camera, measurements=[step.measurements[camera.camera] for step in found])
        for camera in cameras
    ]
    return RunResult("run.h5", INFO, ASIDE.settings, settings, cameras, corrections)
