"""The errors that still images of each camera show, given to the measurements of all later images."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from dic.calibration.calibration import Calibration
from dic.out_of_plane.motion import Motion
from dic.out_of_plane.still_images import still_errors
from dic.pipeline.measured_images import MeasuredImage
from dic.runfile.reader import RunStep
from dic.strain.measurement import Measurement
from dic.strain.still import StillErrors


class StillSteps:
    """The errors that still images show: those of the motion, or those of the steps "static" of a run.

    `reference_s`: time of the reference in a run; NaN if it is not known.
    """

    def __init__(
        self,
        calibrations: Mapping[str, Calibration | None],
        motions: Mapping[str, Motion | None],
        reference_s: float,
    ) -> None:
        self._calibrations, self._reference_s = calibrations, reference_s
        self._steps: dict[str, list[tuple[Measurement, float]]] = {name: [] for name in calibrations}
        self._errors: dict[str, StillErrors | None] = {
            name: None if motion is None else motion.still for name, motion in motions.items()
        }

    def measured(
        self, camera: str, number: int, step: RunStep | None, image: MeasuredImage, measured: Measurement
    ) -> Measurement:
        """Return a measurement with the errors that still images show, or keep that of a still image."""
        if step is not None and step.kind == "static":
            stills = self._steps[camera]
            stills.append((measured, step.time_s - self._reference_s))
            self._errors[camera] = still_errors(stills, self._calibrations[camera], in_seconds=True)
            return measured
        errors = self._errors.get(camera)
        if errors is None:
            return measured
        elapsed = float(errors.images + number + 1)
        if errors.in_seconds:
            elapsed = (image.time.time_s or 0.0) if step is None else step.time_s - self._reference_s
        return replace(measured, still=errors.at(elapsed if np.isfinite(elapsed) else 0.0))

    def findings(self, camera: str) -> list[str]:
        """Return a sentence about the errors, or none."""
        errors, calibration = self._errors.get(camera), self._calibrations[camera]
        return [] if errors is None or calibration is None else [errors.text(calibration.mm_per_px)]
