"""One camera's part of a run, as far as it is measured."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dic.calibration.calibration import Calibration
from dic.runfile.reader import RunStep
from dic.strain.measurement import Measurement


@dataclass(frozen=True)
class CameraResult:
    """One camera's part of a run.

    Attributes
    ----------
    camera : str
    calibration : Calibration
    reference : ndarray of float32, shape (height, width)
        The image all others are compared with.
    steps : list of RunStep
        The steps that could be measured.
    measurements : list of Measurement
        One per step.
    failures : list of str
        One sentence per step that could not be measured.
    """

    camera: str
    calibration: Calibration
    reference: NDArray[np.float32]
    steps: list[RunStep]
    measurements: list[Measurement]
    failures: list[str]
