"""The class `CameraResult`: calibration, measurements and failures of one camera of a run."""

from collections.abc import Sequence
from dataclasses import dataclass

from dic.calibration.calibration import Calibration
from dic.results.fields import StoredFields
from dic.results.job import Outcome
from dic.runfile.reader import RunStep
from dic.specimen.find import Specimen
from dic.strain.measurement import Measurement
from dic.typing import Grey


@dataclass(frozen=True)
class CameraResult:
    """The results of one camera of a run.

    Attributes
    ----------
    camera : str
    calibration : Calibration
    reference : ndarray of float32, shape (height, width)
        The reference image, with which the images of all other steps are compared.
    steps : list of RunStep
        The steps of the run that could be measured with this camera.
    measurements : sequence of Measurement
        One measurement for each element of `steps`. If the results come from `process_run` or from a file,
        each measurement is read from the file when it is used.
    failures : list of str
        One sentence per step that could not be measured; the sentence gives the reason.
    specimen : Specimen or None
        The specimen in the calibrated part of the reference image; None for results from a file.
    outcomes : sequence of Outcome
        The outcome of the image of each step except the reference; empty for files of earlier versions.
    fields : StoredFields or None
        The fields of the measurements in a result file; None without a file or without a measurement.
    """

    camera: str
    calibration: Calibration
    reference: Grey
    steps: list[RunStep]
    measurements: Sequence[Measurement]
    failures: list[str]
    specimen: Specimen | None = None
    outcomes: Sequence[Outcome] = ()
    fields: StoredFields | None = None

    def __repr__(self) -> str:
        return f"CameraResult({self.camera!r}, {len(self.steps)} steps, {len(self.failures)} failed)"
