"""Tests of a run's kind of motion, of the cameras that correct it together, and of unused settings."""

import numpy as np
import pytest

from dic.errors import CorrelationError
from dic.out_of_plane.alignment import Alignment
from dic.pipeline.correction_settings import CorrectionSettings
from dic.pipeline.result import CameraResult, correct_run
from dic.runfile.reader import RunStep
from simulators.scene.optics import PinholeCamera
from tests.dic.out_of_plane.exact_views import State, View

SOUND = Alignment(np.full(4, 0.003), 1e-10 * np.eye(4), np.zeros(2))


def test_alignments_that_a_run_has_no_use_for_are_refused():
    settings = CorrectionSettings(alignments={"aside": SOUND})
    with pytest.raises(CorrelationError, match="expected one of left, right, got aside"):
        settings.require_use("run.h5", ["left", "right"], {"rotation"})
    with pytest.raises(CorrelationError, match="an alignment serves rotations only"):
        settings.require_use("run.h5", ["aside"], {"load"})
    assert settings.require_use("run.h5", ["aside"], {"rotation"}) is None


def test_a_hinge_is_refused_for_a_rotation():
    settings = CorrectionSettings(tilt_axis_mm=(0.0, -30.0))
    with pytest.raises(CorrelationError, match=r"expected a run with loaded steps.*leave out --tilt-axis-mm"):
        settings.require_use("run.h5", ["aside"], {"rotation"})
    assert settings.require_use("run.h5", ["aside"], {"load"}) is None


@pytest.mark.parametrize("ratio", [-0.1, 0.6, float("nan")])
def test_poissons_ratio_of_a_run_is_judged(ratio):
    with pytest.raises(CorrelationError, match=r"expected 0 to 0\.5"):
        CorrectionSettings(ratio)


def test_the_pair_is_that_of_the_largest_parallax():
    """Cameras at 28° to the left and 30° to the right see more of it than either with one straight on."""
    step = RunStep(1, "load", 1000.0, 1000.0, 0.05, np.nan, 60.0)
    cameras = []
    for name, pan_deg in (("straight", 0.0), ("left", -28.0), ("right", 30.0)):
        view = View(PinholeCamera(800, 800, pan_deg=pan_deg))
        calibration = view.calibration()
        measured = view.measurements([State()], calibration)
        cameras.append(CameraResult(name, calibration, np.zeros((800, 800)), [step], measured, []))
    corrected = correct_run(cameras, CorrectionSettings())
    assert corrected.motion == "tension"
    assert corrected.joint is not None
    assert corrected.joint.cameras == ("right", "left")
    assert set(corrected.joint.steps) == {1}
