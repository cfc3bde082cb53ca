"""The processing of a run file: calibrate every camera and correlate the images of every step."""

from collections import deque
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from math import nan
from pathlib import Path
from typing import Any

from dic.correlation.series import Series
from dic.correlation.settings import CorrelationSettings
from dic.errors import require_kind
from dic.image.stored import is_large
from dic.keywords import takes_settings
from dic.pipeline.correction_settings import CorrectionSettings, kinds_of
from dic.pipeline.correlated import FIRST_GUESSES
from dic.pipeline.measuring import measuring_into
from dic.pipeline.result import RunResult
from dic.pipeline.result_file import load_written
from dic.pipeline.reuse import EarlierMeasurement, look_up
from dic.pipeline.run_cameras import RunCameras
from dic.pipeline.run_source import RunSource, region_digests
from dic.pipeline.set_up import RunSetUp
from dic.results.job import Job
from dic.results.place import ResultPlace, alone, result_place
from dic.results.provenance import Provenance, versions
from dic.runfile.digests import joined_digest
from dic.runfile.joined import open_run
from dic.runfile.reader import RunFile
from dic.specimen.find import Specimen
from dic.strain.settings import StrainSettings
from dic.typing import PathLike
from dic.workers.workers import Workers


@takes_settings(settings=CorrelationSettings, strain=StrainSettings)
def process_run(
    path: PathLike | RunSource,
    settings: CorrelationSettings | None = None,
    strain: StrainSettings | None = None,
    *,
    correcting: CorrectionSettings | None = None,
    incremental: str = "auto",
    plate_mm: float | None = None,
    on_image: Callable[[int], None] = lambda total: None,
    output: PathLike | ResultPlace | None = None,
    workers: Workers | None = None,
) -> RunResult:
    """Calibrate and correlate all cameras of a run in parallel.

    Every image is correlated, written to the disk and removed from memory, so a long run need not fit into
    memory. The corrections of a step are computed while the next step is correlated; those of rotations and
    of large images are computed at the end from the written data. The fields of the result are read from the
    result file when they are used.

    Parameters
    ----------
    path : path or RunSource
        The run file. The run may have been killed before its end. A `RunSource` also has the regions to
        measure.
    settings : CorrelationSettings, optional
        Settings of the correlation.
    strain : StrainSettings, optional
    correcting : CorrectionSettings, optional
    incremental : str
        Rule for taking a new reference image in the series of a camera: "auto" (when the correlation drops),
        "never", or "always" (at every image).
    plate_mm : float, optional
        Distance of the specimen's surface behind the grid's lines. Default: the value in the run file, which
        is 0 if neither the protocol nor the rig file declares a distance.
    on_image : callable, optional
        Function that is called after each image with the number of all images.
    output : path or ResultPlace, optional
        The result file. Finished images are appended to it, and if the program is stopped or killed, a call
        with the same arguments continues after them. If the file already contains the results of the same
        call, they are returned. If only settings of strain or corrections have changed, the fields in the
        file are used, and nothing is correlated. Default: a temporary file.
    workers : Workers, optional
        Processes that correlate several images at the same time, such as `LocalWorkers`. The results have the
        same bits. By default, threads of this process share the work at each image.

    Raises
    ------
    MeasurementError
        If the file cannot be read, a calibration grid is not found, or the reference image or the region of a
        camera cannot be used. A step that cannot be correlated raises no error: `CameraResult.failures` lists
        the step.
    """
    source = path if isinstance(path, RunSource) else RunSource(path)
    Series.require_incremental(incremental)
    require_kind("settings", settings, CorrelationSettings | None, "give dic.CorrelationSettings()")
    require_kind("strain", strain, StrainSettings | None, "give dic.StrainSettings(window_points=3)")
    require_kind("correcting", correcting, CorrectionSettings | None, "give dic.CorrectionSettings()")
    settings, correcting = settings or CorrelationSettings(), correcting or CorrectionSettings()
    chosen = output if isinstance(output, ResultPlace) or output is None else ResultPlace(Path(output))
    with (
        open_run(source.path) as run,
        source.opened_grid(run) as grid,
        result_place(None if chosen is None else chosen.path) as file,
    ):
        place = chosen or ResultPlace(file)
        run.step_of_kind("reference")
        plate_mm = run.mounting.plate_mm if plate_mm is None else plate_mm
        correcting.require_use(str(source.path), list(run.cameras), kinds_of(run.series()[1:]))
        correcting = correcting.completed(run.mounting, run.info.thickness_mm, grid.grid_making)
        regions = source.masks(run)
        cameras = RunCameras(run, regions, settings, incremental, plate_mm, correcting.grid, grid, workers)
        first, *others = cameras.exposed[run.cameras[0]].steps
        reference_s = first.time_s if any(step.kind == "static" for step in others) else nan
        known = run.info, settings, strain or StrainSettings(), correcting, plate_mm, reference_s
        set_up = RunSetUp(str(run.path), *known)
        of_fields = _fields_job(run, grid, settings, incremental) | region_digests(regions)
        job = Job.of(of_fields, set_up.as_dict())
        with alone(place.path):
            earlier = look_up(place, job, cameras.outcomes)
            if isinstance(earlier.same, RunResult):
                return replace(earlier.same, note=earlier.note, known=True)
            files = [run.path, *([] if grid is run else [grid.path])]
            origin = Provenance.of([*files, *place.inputs], job)
            done = partial(on_image, len(run.cameras) * (len(run.series()) - 1))
            specimens = _measure(cameras, set_up, earlier, place, origin, done)
        result = load_written(place.path)
    found = [replace(camera, specimen=specimens[camera.camera]) for camera in result.cameras]
    return replace(result, cameras=found, note=earlier.note if earlier.known else "")


def _measure(
    of_run: RunCameras,
    set_up: RunSetUp,
    earlier: EarlierMeasurement,
    place: ResultPlace,
    origin: Provenance,
    on_image: Callable[[], None],
) -> dict[str, Specimen | None]:
    """Measure the images of a run, write its result file, and return the specimen of each camera.

    The images and the last step are in memory only until this function returns.
    """
    cameras = of_run.calibrated()
    for camera in cameras:
        camera.before, camera.known = earlier.images.get(camera.camera, ()), earlier.known
    # The corrections of all cameras need the memory that the correlation of large images frees at its end.
    large = any(is_large(camera.reference.shape) for camera in cameras)
    how = {"at_once": earlier.known or not large, "on_image": on_image}
    with measuring_into(place, cameras, set_up, origin, earlier.images_before, **how) as measuring:
        deque(measuring.steps(), maxlen=0)
    return {camera.camera: camera.specimen for camera in cameras}


def _fields_job(
    run: RunFile, grid: RunFile, settings: CorrelationSettings, incremental: str
) -> dict[str, Any]:
    """Return everything except the images of the steps that determines the fields of a run."""
    fixed = [(grid, grid.step_of_kind("grid")), (run, run.step_of_kind("reference"))]
    digests = [of.digest(camera, step) for camera in run.cameras for of, step in fixed]
    return {
        "run": run.info.run_id,
        "images of grid and reference": joined_digest(digests),
        **vars(settings),
        "incremental": incremental,
        "versions": versions(),
        **FIRST_GUESSES,
    }
