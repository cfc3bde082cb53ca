"""The results of a run: the measurements and corrections of all cameras and steps."""

from dataclasses import dataclass

from dic.correlation.settings import CorrelationSettings
from dic.errors import RunFileError
from dic.files.lazy import Computed
from dic.out_of_plane.diagnosis import Sensitivity
from dic.pipeline.camera_result import CameraResult
from dic.pipeline.run_corrections import CorrectionSettings, RunCorrections
from dic.pipeline.series_result import MeasuredImage, MeasuredSeries
from dic.results.provenance import Provenance
from dic.runfile.reader import RunInfo


@dataclass(frozen=True)
class RunResult:
    """All measurements and corrections of a run. There is no measurement of the reference step itself.

    Attributes
    ----------
    source : str
        Path of the run file.
    info : RunInfo
    settings : CorrelationSettings
    correcting : CorrectionSettings
    cameras : list of CameraResult
    corrections : RunCorrections
        Corrections of the strains for motion out of the calibration grid's plane.
    provenance : Provenance or None
        Where the results come from; None for files of earlier versions.
    file : str
        Path of the result file; "" if the results were not read from a file.
    note : str
        A sentence that says which result file `process_run` used; "" if it correlated the images.
    known : bool
        True if `process_run` found these results in the result file, and computed nothing.
    """

    source: str
    info: RunInfo
    settings: CorrelationSettings
    correcting: CorrectionSettings
    cameras: list[CameraResult]
    corrections: RunCorrections
    provenance: Provenance | None = None
    file: str = ""
    note: str = ""
    known: bool = False

    def __repr__(self) -> str:
        lines = [f"  {camera}" for camera in self.cameras]
        return "\n".join([f"RunResult of {self.source}, {self.info.title!r}, {self.info.status}", *lines])

    def series(self, camera: str) -> MeasuredSeries:
        """Return a camera's results in the form that `measure_images` returns.

        Each step has its best correction. The best correction is the correction by two cameras together, if
        the step has such a correction; otherwise it is the correction by this camera alone.

        Parameters
        ----------
        camera : str
            Name of the camera in the run.

        Raises
        ------
        RunFileError
            If the run has no such camera.
        """
        cameras = {found.camera: found for found in self.cameras}
        if camera not in cameras:
            expected, remedy = " or ".join(cameras), f"give {next(iter(cameras), 'a camera of the run')}"
            raise RunFileError(self.source, "choose a camera", expected, str(camera), remedy)
        found, steps = cameras[camera], len(cameras[camera].steps)

        def image(k: int) -> MeasuredImage:
            if k >= steps:
                return MeasuredImage(camera, failure=found.failures[k - steps])
            measurement = found.measurements[k]
            best = self.corrections.best(camera, found.steps[k].index, k)
            return MeasuredImage(measurement.label, measurement, best)

        images = Computed(steps + len(found.failures), image)
        alignment = self.corrections.cameras[camera].alignment
        return MeasuredSeries(found.reference, images, alignment, Sensitivity.of(found.calibration))
