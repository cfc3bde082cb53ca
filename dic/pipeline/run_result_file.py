"""The result file of a run: it contains all results of `process_run`, and a report needs no other file."""

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any, Self, cast

import h5py

from dic.calibration.file import read_calibration, write_calibration
from dic.correlation.settings import CorrelationSettings
from dic.errors import RunFileError, require_kind
from dic.files.lazy import ComputedMapping
from dic.image.memory import give_back_memory
from dic.out_of_plane.correct import Corrections
from dic.out_of_plane.correction import Correction
from dic.pipeline.camera_result import CameraResult
from dic.pipeline.run_corrections import (
    CorrectedStep,
    CorrectionSettings,
    JointCorrections,
    RunCorrections,
    correct_run,
    measured_steps,
)
from dic.pipeline.run_result import RunResult
from dic.results.alignment import read_alignment, write_alignment
from dic.results.fields import NOT_SMOOTHED, StoredFields, plain, read_reference
from dic.results.job import read_outcomes, write_outcomes
from dic.results.loading import Result, load_result, require_known, use_result
from dic.results.provenance import Provenance
from dic.results.reader import read_corrections, read_measurements, read_provenance, read_two_cameras
from dic.results.schema import FORMAT, VERSION
from dic.results.shapes import require_shapes
from dic.results.writer import ResultWriter
from dic.runfile.reader import RunInfo, RunStep
from dic.strain.measurement import Measurement
from dic.typing import PathLike

_JOINT = "both"
_STEP_UNITS = {
    "index": "1", "target": "by kind: N, mm or deg", "load_n": "N", "displacement_mm": "mm",
    "angle_deg": "deg", "time_s": "s",
}  # fmt: skip


def save_run_result(result: RunResult, path: PathLike) -> None:
    """Write the result file of a run. `docs/results.md` describes the layout of the file.

    Raises
    ------
    RunFileError
        If the file cannot be created.
    """
    require_kind("result", result, RunResult, "process a run first: dic.process_run(path)")
    joint, origin = result.corrections.joint, result.provenance or Provenance.of([])
    pair = None if joint is None else joint.cameras
    with RunResultWriter(Path(path), result.cameras, origin, pair) as writer:
        for step in _steps_of(result):
            writer.add(step)
        writer.finish(result.source, result.info, result.settings, result.correcting, result.corrections)


class RunResultWriter:
    """Write the result file of a run step by step; use this class in a `with` statement.

    Parameters
    ----------
    path : Path
        The file appears under this name only when it is complete.
    cameras : sequence of CameraResult
    origin : Provenance
    pair : tuple of str, optional
        Names of the two cameras of `CorrectedStep.joint`.
    """

    def __init__(
        self,
        path: Path,
        cameras: Sequence[CameraResult],
        origin: Provenance,
        pair: tuple[str, str] | None = None,
    ) -> None:
        self._writer, self._cameras, self._pair = ResultWriter(path, origin), cameras, pair
        self._steps: dict[str, list[RunStep]] = {camera.camera: [] for camera in cameras}

    def __enter__(self) -> Self:
        self._writer.__enter__()
        return self

    def __exit__(self, *error: Any) -> None:
        self._writer.__exit__(*error)

    def add(self, step: CorrectedStep) -> None:
        """Append the measurements and corrections of a step."""
        joint, index = step.joint, step.step.index
        for name, measurement in step.measurements.items():
            together = joint is not None and joint.declined is None and name in (self._pair or ())
            self._writer.add(
                f"cameras/{name}/series",
                measurement,
                step.corrections[name],
                elsewhere=together,
            )
            self._steps[name].append(step.step)
        if joint is not None and self._pair is not None:
            self._writer.add_two_cameras(_JOINT, self._pair, index, joint)

    def finish(
        self,
        source: str,
        info: RunInfo,
        settings: CorrelationSettings,
        correcting: CorrectionSettings,
        corrections: RunCorrections,
    ) -> None:
        """Write the data of the run as a whole, after the last step."""
        writer = self._writer
        writer.group("run").attrs.update(asdict(info) | {"source": source, "motion": corrections.motion})
        writer.group("settings").attrs.update(vars(settings) | {"correcting": correcting.as_text()})
        for camera in self._cameras:
            self._write_camera(camera, corrections)
        if corrections.joint is not None:
            group = writer.group(_JOINT)
            group.attrs["cameras"] = list(corrections.joint.cameras)
            _write_texts(group, "findings", corrections.joint.findings)

    def _write_camera(self, camera: CameraResult, corrections: RunCorrections) -> None:
        group = self._writer.group(f"cameras/{camera.camera}")
        group.attrs["failures"] = "\n".join(camera.failures)
        group.create_dataset("reference", data=camera.reference).attrs["units"] = "grey level"
        write_calibration(group.create_group("calibration"), camera.calibration)
        steps, measured = group.create_group("steps"), self._steps[camera.camera]
        steps.attrs["kind"] = [step.kind for step in measured]
        for column, units in _STEP_UNITS.items():
            data = [getattr(step, column) for step in measured]
            steps.create_dataset(column, data=data).attrs["units"] = units
        alignment = corrections.cameras[camera.camera].alignment
        if alignment is not None:
            write_alignment(group, alignment)
        write_outcomes(group, camera.outcomes)
        _write_texts(group, "findings", corrections.findings[camera.camera])


def _steps_of(result: RunResult) -> Iterator[CorrectedStep]:
    """Yield the steps of a run whose strains are corrected already."""
    for step, places in measured_steps(result.cameras):
        yield _step_of(result, step, places)


def _step_of(result: RunResult, step: RunStep, places: Mapping[str, int]) -> CorrectedStep:
    corrections, cameras = result.corrections, {camera.camera: camera for camera in result.cameras}
    measurements = {name: cameras[name].measurements[place] for name, place in places.items()}
    single = {name: corrections.cameras[name].images[place] for name, place in places.items()}
    joint = None if corrections.joint is None else corrections.joint.steps.get(step.index)
    return CorrectedStep(step, measurements, single, {}, joint)


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
        result = replace(_read_run(path, file), file=str(path))
        # A variable of a loop would keep a step until the next one is read.
        deque(_steps_of(result), maxlen=0)
        return result

    return load_result(path, read, _refusal)


def load_written(path: Path) -> RunResult:
    """Read a result file that this program has just written, so that its steps need not be checked.

    The memory that the program needed to compute the steps is given back first.
    """
    give_back_memory()
    return load_result(path, lambda file: replace(_read_run(path, file), file=str(path)), _refusal)


def use_run_result(
    path: PathLike, use: Callable[[RunResult], Result], *, local_strain: bool = False
) -> Result:
    """Call `use` with the results of a run, close the file, and return what `use` returned.

    Without `local_strain`, the local strains are not read, and must not be used.

    Raises
    ------
    RunFileError
        As for `load_run_result`.
    """
    path = Path(path)
    return use_result(path, lambda file: use(_read_run(path, file, local_strain=local_strain)), _refusal)


def _write_texts(group: Any, name: str, texts: list[str]) -> None:
    group.create_dataset(name, data=texts, dtype=h5py.string_dtype())


def _read_run(path: Path, file: h5py.File, *, local_strain: bool = True) -> RunResult:
    if file.attrs.get("file_format") == FORMAT:
        require_known(path, file)
    if file.attrs.get("file_format") != FORMAT or "run" not in file:
        raise _refusal(path, "an HDF5 file of another kind")
    run = dict(file["run"].attrs)
    info = _read_info(run)
    attributes = {k: plain(v) for k, v in file["settings"].attrs.items()}
    correcting = CorrectionSettings.from_text(attributes.pop("correcting"))
    settings = CorrelationSettings(**NOT_SMOOTHED | attributes)
    cameras = [_read_camera(name, group, local_strain) for name, group in file["cameras"].items()]
    # Files of earlier versions do not store the motion, the alignments, the findings and the results of two
    # cameras together.
    anew = None if "motion" in run else correct_run(cameras, correcting)
    corrected = {c.camera: _read_corrections(file["cameras"][c.camera], c, anew) for c in cameras}
    if anew is not None:
        corrections = replace(anew, cameras=corrected)
    else:
        findings = {c.camera: _read_texts(file["cameras"][c.camera], "findings") for c in cameras}
        joint = _read_joint(file[_JOINT], cameras) if _JOINT in file else None
        corrections = RunCorrections(str(run["motion"]), corrected, findings, joint)
    origin = read_provenance(file)
    return RunResult(str(run["source"]), info, settings, correcting, cameras, corrections, origin)


def _read_info(run: Mapping[str, Any]) -> RunInfo:
    """Return the properties of a run.

    Raises
    ------
    TypeError
        If a value is not of the type of its property, such as two numbers for the thickness.
    """
    values = {each.name: plain(run[each.name]) for each in fields(RunInfo)}
    for each in fields(RunInfo):
        kinds = (int, float) if each.type is float else cast(type, each.type)
        if not isinstance(values[each.name], kinds):
            raise TypeError(f"{each.name} is no {each.type}")
    return RunInfo(**values)


def _read_camera(name: str, group: h5py.Group, local_strain: bool) -> CameraResult:
    calibration = read_calibration(group["calibration"])
    columns = {column: group["steps"][column][:] for column in _STEP_UNITS}
    steps = []
    for k, kind in enumerate(group["steps"].attrs["kind"]):
        values = {column: float(values[k]) for column, values in columns.items() if column != "index"}
        steps.append(RunStep(index=int(columns["index"][k]), kind=str(kind), **values))
    measurements: Sequence[Measurement] = []
    if steps:
        require_shapes(group["series"], group["reference"], group.file.get(f"{_JOINT}/{name}"))
        measurements = read_measurements(group["series"], calibration, local_strain=local_strain)
    failures = [line for line in str(group.attrs["failures"]).split("\n") if line]
    return CameraResult(
        name,
        calibration,
        read_reference(group),
        steps,
        measurements,
        failures,
        outcomes=read_outcomes(group),
        fields=StoredFields(group["series"]) if steps else None,
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


def _refusal(path: Path, got: str) -> RunFileError:
    return RunFileError(
        str(path),
        "read results",
        f"a result file of version {VERSION} from `dic process`",
        got,
        "make it with `dic process RUN.h5`",
    )
