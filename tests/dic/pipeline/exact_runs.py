"""Runs with two cameras whose measurements follow from exact geometry, without images."""

from dataclasses import replace

import numpy as np

from dic.out_of_plane.correction import stated
from dic.pipeline.correction_settings import CorrectionSettings
from dic.pipeline.result import CameraResult, RunResult, correct_run
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
    corrections = correct_run(cameras, settings)
    cameras = [
        replace(
            camera,
            measurements=[
                stated(measurement, corrections.best(camera.camera, step.index, place))
                for place, (step, measurement) in enumerate(zip(steps, camera.measurements, strict=True))
            ],
        )
        for camera in cameras
    ]
    return RunResult("run.h5", INFO, ASIDE.settings, settings, cameras, corrections)
