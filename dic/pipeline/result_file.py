"""Reads the result file of a measurement: of `dic process`, or of `dic correlate`.

The file stays open, and a value is read when it is used. `docs/results.md` describes the layout.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from functools import partial
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from dic.calibration.file import read_calibration
from dic.correlation.settings import CorrelationSettings
from dic.errors import RunFileError, require_kind
from dic.files.lazy import Computed, ComputedMapping
from dic.hdf5.open import NotReadable, open_hdf5
from dic.image.memory import give_back_memory
from dic.image.times import ImageTime
from dic.out_of_plane.correct import Corrections
from dic.out_of_plane.correction import Correction
from dic.pipeline.correction_settings import CorrectionSettings
from dic.pipeline.corrections import JointCorrections, RunCorrections
from dic.pipeline.measured_images import MeasuredImage, MeasuredSeries
from dic.pipeline.result import CameraResult, RunResult, SeriesResult, correct_run, sensitivity_of
from dic.pipeline.result_writer import steps_of
from dic.results.alignment import read_alignment
from dic.results.fields import NOT_SMOOTHED, StoredFields, plain, read_reference
from dic.results.job import ImageOutcome, read_outcomes
from dic.results.loading import Result, load_result, require_known, use_result
from dic.results.reader import read_corrections, read_measurements, read_provenance, read_two_cameras
from dic.results.schema import FINISHED, FORMAT, JOINT, VERSION, CameraLayout
from dic.results.shapes import require_shapes
from dic.results.steps import read_steps
from dic.runfile.reader import RunInfo, RunStep
from dic.runfile.schema import FORMAT as RUN_FORMAT
from dic.strain.measurement import Measurement
from dic.typing import PathLike

if TYPE_CHECKING:
    import h5py

_SERIES, _CAMERAS = CameraLayout.of("").place, "cameras"
AnyResult = SeriesResult | RunResult
Loaded = MeasuredSeries | SeriesResult | RunResult
Results = PathLike | Loaded
"""A result file, or the results that were measured or read from a file."""


def load_run_result(path: PathLike) -> RunResult:
    """Read the result file of a run. Stored values are not computed again.

    The file stays open. The fields of a step are read from the file when they are used, so a long run need
    not fit into memory.

    Files of earlier versions lack some values, which are computed when the file is read. Result files do not
    store the gradients and the errors of calibrated displacements. `dic.measure` computes these gradients and
    errors.

    Raises
    ------
    RunFileError
        If the file is missing or cut off, or is not the result file of a run.
    """
    path = Path(path)

    def read(file: Any) -> RunResult:
        result = _read_run(path, file)
        # A variable of a loop would keep a step until the next one is read.
        deque(steps_of(result), maxlen=0)
        return result

    return load_result(path, read, partial(_refusal, "process"))


def load_series_result(path: PathLike) -> SeriesResult:
    """Read the result file of `dic correlate`. Nothing is computed again.

    The file stays open. The fields of an image are read from the file when they are used, so a long series
    need not fit into memory.

    Raises
    ------
    RunFileError
        If the file is missing or cut off, or is not the result file of a series.
    """
    path = Path(path)

    def read(file: Any) -> SeriesResult:
        result = _read_series(path, file)
        deque(result.images, maxlen=0)
        return result

    return load_result(path, read, partial(_refusal, "correlate"))


def load_written(path: Path) -> RunResult:
    """Read a result file that this program has just written, so that its steps need not be checked.

    The memory that the program needed to compute the steps is given back first.
    """
    give_back_memory()
    return load_result(path, partial(_read_run, path), partial(_refusal, "process"))


def with_results(results: Results, use: Callable[[Loaded], Result], *, local_strain: bool = False) -> Result:
    """Call `use` with results; those of a file are read, and the file is closed afterwards.

    Without `local_strain`, the local strains of a file are not read, and must not be used.

    Raises `CorrelationError` if the argument is neither a path nor results. Raises `RunFileError` if the file
    is not a result file of `dic correlate` or `dic process`, or is damaged.
    """
    if not isinstance(results, str | Path):
        require_kind("results", results, Loaded, "give a result file, or dic.load_series_result(path)")
        return use(results)
    path, series = Path(results), is_series_result(results)
    read: Callable[..., AnyResult] = _read_series if series else _read_run
    refusal = partial(_refusal, "correlate" if series else "process")
    return use_result(path, lambda file: use(read(path, file, local_strain=local_strain)), refusal)


def load_results(path: PathLike) -> AnyResult:
    """Read a result file of `dic correlate` or of `dic process`.

    Raises `RunFileError` as for `load_series_result` and `load_run_result`.
    """
    return load_series_result(path) if is_series_result(path) else load_run_result(path)


def load_fields(path: Path) -> AnyResult:
    """Read the displacement fields of a result file, whose strains may be missing.

    Raises `RunFileError` if the file cannot be read.
    """

    def read(file: Any) -> AnyResult:
        series = _SERIES in file
        _require_format(path, file, "correlate" if series else "process")
        cameras = [_read_fields(name, file) for name in ([""] if series else file[_CAMERAS])]
        origin, finished = read_provenance(file), _is_finished(file)
        if series and origin is not None:
            nothing = MeasuredSeries(cameras[0].reference, ())
            return SeriesResult(str(path), nothing, cameras[0], origin, finished)
        info, settings, correcting = _read_about(file)
        of_none = RunCorrections("free", {}, {})
        source = str(file["run"].attrs["source"])
        return RunResult(
            source, info, settings, correcting, cameras, of_none, origin, str(path), finished=finished
        )

    return load_result(path, read, partial(_refusal, "correlate` or `dic process"))


def require_fields(result: AnyResult) -> None:
    """Read all displacement fields once; a damaged file is a `RunFileError` before the fields are used."""
    try:
        for camera in result.cameras:
            deque(camera.finished_images, maxlen=0)
    except Exception as error:
        got = f"a result file that lacks some of its data ({type(error).__name__})"
        raise _refusal("correlate` or `dic process", Path(result.result_file), got) from error


def is_series_result(path: PathLike) -> bool:
    """Return True if a result file is one of `dic correlate`, and False if it is one of `dic process`.

    Raises
    ------
    RunFileError
        If the file is not a result file of these commands, or cannot be read.
    """
    remedy = "name another file"
    try:
        with open_hdf5(Path(path)) as file:
            found = file.attrs.get("file_format")
            if found == FORMAT and (_SERIES in file or _CAMERAS in file):
                return _SERIES in file
    except (NotReadable, OSError) as error:
        got = str(error)
    else:
        got = "an HDF5 file of another kind"
        if found == FORMAT:
            got = "a result file that lacks some of its data"
        elif found == RUN_FORMAT:
            got, remedy = "a run file", f"measure it with `dic process {path}`"
    expected = "a result file of `dic correlate -o` or `dic process`"
    raise RunFileError(str(path), "read results", expected, got, remedy)


def _read_run(path: Path, file: h5py.File, *, local_strain: bool = True) -> RunResult:
    _require_format(path, file, "process")
    if "run" not in file:
        raise _refusal("process", path, "an HDF5 file of another kind")
    info, settings, correcting = _read_about(file)
    finished = _is_finished(file)
    if not finished:
        raise _interrupted(path)
    cameras = [_read_camera(name, file, local_strain=local_strain) for name in file[_CAMERAS]]
    # Files of earlier versions do not store the motion, the alignments, the findings and the results of two
    # cameras together.
    run = dict(file["run"].attrs)
    anew = None if "motion" in run else correct_run(cameras, correcting)
    corrected = {c.camera: _read_corrections(file[CameraLayout.of(c.camera).place], c, anew) for c in cameras}
    if anew is not None:
        corrections = replace(anew, cameras=corrected)
    else:
        findings = {c.camera: _read_texts(file[CameraLayout.of(c.camera).place], "findings") for c in cameras}
        joint = _read_joint(file[JOINT], cameras) if JOINT in file else None
        corrections = RunCorrections(str(run["motion"]), corrected, findings, joint)
    origin = read_provenance(file)
    return RunResult(str(run["source"]), info, settings, correcting, cameras, corrections, origin, str(path))


def _read_series(path: Path, file: h5py.File, *, local_strain: bool = True) -> SeriesResult:
    _require_format(path, file, "correlate")
    if _SERIES not in file:
        raise _refusal("correlate", path, "an HDF5 file of another kind")
    group, origin, finished = file[_SERIES], read_provenance(file), _is_finished(file)
    if origin is None or "reference" not in group:
        raise _refusal("correlate", path, "a file of an earlier version, which holds no reference image")
    if not finished and ("exx" not in group or len(group["exx"]) < len(group["label"])):
        raise _interrupted(path)
    camera = _read_camera("", file, local_strain=local_strain)
    measurements, outcomes = camera.measurements, camera.outcomes
    corrections: Sequence[Correction | None] = [None] * len(measurements)
    if "corrected_mean" in group:
        corrections = read_corrections(group, measurements)
    places = _places(outcomes or _older_outcomes(group, len(measurements)))

    def image(k: int) -> MeasuredImage:
        row = places[k]
        if isinstance(row, ImageOutcome):
            return MeasuredImage(row.label, failure=row.failure, time=row.time)
        time = outcomes[k].time if outcomes else ImageTime()
        return MeasuredImage(measurements[row].label, measurements[row], corrections[row], time=time)

    images, sensitivity = Computed(len(places), image), sensitivity_of(camera.calibration)
    series = MeasuredSeries(camera.reference, images, read_alignment(group), sensitivity)
    return SeriesResult(str(path), series, camera, origin, finished)


def _require_format(path: Path, file: h5py.File, command: str) -> None:
    if file.attrs.get("file_format") != FORMAT:
        raise _refusal(command, path, "an HDF5 file of another kind")
    require_known(path, file)


def _is_finished(file: h5py.File) -> bool:
    return bool(file.attrs.get(FINISHED, 1))


def _interrupted(path: Path) -> RunFileError:
    expected, got = (
        "a measurement that came to its end",
        "one that was interrupted before its strains were computed",
    )
    remedy = "give the command again that measured it; it goes on after the last finished image"
    return RunFileError(str(path), "read results", expected, got, remedy)


def _read_about(file: h5py.File) -> tuple[RunInfo, CorrelationSettings, CorrectionSettings]:
    info = _read_info(dict(file["run"].attrs))
    attributes = {k: plain(v) for k, v in file["settings"].attrs.items()}
    correcting = CorrectionSettings.from_text(attributes.pop("correcting"))
    return info, CorrelationSettings(**NOT_SMOOTHED | attributes), correcting


def _read_info(run: Mapping[str, Any]) -> RunInfo:
    """Return the properties of a run.

    Raises `TypeError` if a value is not of the type of its property, such as two numbers for the thickness.
    """
    # The direction is stored only if it is known.
    known = [each for each in fields(RunInfo) if each.name != "direction_deg" or each.name in run]
    values = {each.name: plain(run[each.name]) for each in known}
    for each in known:
        is_number = each.type is float or each.name == "direction_deg"
        kinds = (int, float) if is_number else cast(type, each.type)
        if not isinstance(values[each.name], kinds):
            raise TypeError(f"{each.name} is no {each.type}")
    return RunInfo(**values)


def _read_fields(name: str, file: h5py.File) -> CameraResult:
    """Return what is known of a camera without its strains."""
    layout = CameraLayout.of(name)
    group, rows = file[layout.place], file.get(layout.rows)
    calibration = read_calibration(file[layout.calibration]) if layout.calibration in file else None
    measured = rows is not None and "x_px" in rows
    if measured:
        require_shapes(rows, group["reference"], file.get(f"{JOINT}/{name}") if name else None)
    return CameraResult(
        name,
        calibration,
        read_reference(group),
        [],
        [],
        [],
        outcomes=read_outcomes(group),
        fields=StoredFields(rows) if measured else None,
    )


def _read_camera(name: str, file: h5py.File, *, local_strain: bool) -> CameraResult:
    camera, layout = _read_fields(name, file), CameraLayout.of(name)
    group, measurements = file[layout.place], list[Measurement]()
    failures: list[str] = []
    steps: list[RunStep] = []
    remarks: list[str] = []
    if name:
        steps, remarks = read_steps(group)
        failures = [line for line in str(group.attrs["failures"]).split("\n") if line]
    if steps or not name:
        found = read_measurements(file[layout.rows], camera.calibration, local_strain=local_strain)
        return replace(camera, steps=steps, measurements=found, failures=failures, remarks=remarks)
    return replace(
        camera, steps=steps, measurements=measurements, failures=failures, fields=None, remarks=remarks
    )


def _read_corrections(group: h5py.Group, camera: CameraResult, anew: RunCorrections | None) -> Corrections:
    solved = None if anew is None else anew.cameras[camera.camera]
    images: Sequence[Correction] = []
    if camera.measurements:
        known = None if solved is None else solved.images
        images = read_corrections(group["series"], camera.measurements, known)
    if solved is not None:
        return Corrections(images, solved.alignment)
    return Corrections(images, read_alignment(group))


def _read_joint(group: h5py.Group, cameras: list[CameraResult]) -> JointCorrections:
    measured = {c.camera: ComputedMapping([s.index for s in c.steps], c.measurements) for c in cameras}
    pair, steps = read_two_cameras(group, measured)
    return JointCorrections(pair, steps, _read_texts(group, "findings"))


def _read_texts(group: h5py.Group, name: str) -> list[str]:
    return [str(text) for text in group[name].asstr()[:]]


def _older_outcomes(group: Any, measured: int) -> list[ImageOutcome]:
    """Return the outcomes of a file of an earlier version, which lists failures without their positions."""
    labels, reasons = (group[name].asstr()[:] for name in ("failed_label", "failure"))
    failures = [ImageOutcome(str(label), "", str(why)) for label, why in zip(labels, reasons, strict=True)]
    return [ImageOutcome("", "")] * measured + failures


def _places(outcomes: Sequence[ImageOutcome]) -> list[int | ImageOutcome]:
    """Return the row number of each image; for an image that failed and has no row, its outcome."""
    rows = count()
    return [next(rows) if each.failure is None else each for each in outcomes]


def _refusal(command: str, path: Path, got: str) -> RunFileError:
    remedy = (
        "make it with `dic correlate … -o FILE`"
        if command == "correlate"
        else "make it with `dic process RUN.h5`"
    )
    expected = f"a result file of version {VERSION} from `dic {command}`"
    return RunFileError(str(path), "read results", expected, got, remedy)
