"""The result file of a run: it holds all results of `process_run`, and a report needs no other file."""

from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from dic.calibration.file import read_calibration, write_calibration
from dic.correlation.settings import CorrelationSettings
from dic.errors import MeasurementError, RunFileError, require_kind
from dic.hdf5.open import NotReadable, open_hdf5
from dic.out_of_plane.alignment import Alignment
from dic.out_of_plane.correct import Corrections
from dic.pipeline.camera_result import CameraResult
from dic.pipeline.run import RunResult
from dic.pipeline.run_corrections import CorrectionSettings, JointCorrections, RunCorrections, correct_run
from dic.results.reader import NOT_SMOOTHED, read_corrections, read_measurements, read_two_cameras
from dic.results.schema import FORMAT, VERSION
from dic.results.writer import ResultWriter
from dic.runfile.reader import RunInfo, RunStep
from dic.typing import PathLike

_JOINT = "both"
_STEP_UNITS = {
    "index": "1", "target": "by kind: N, mm or deg", "load_n": "N", "displacement_mm": "mm",
    "angle_deg": "deg", "time_s": "s",
}  # fmt: skip
_ALIGNMENT_UNITS = {"slopes": "1", "covariance": "1", "pivot_mm": "mm"}


def save_run_result(result: RunResult, path: PathLike) -> None:
    """Write the result file of a run. `docs/results.md` describes the layout of the file.

    Raises
    ------
    RunFileError
        If the file cannot be created.
    """
    require_kind("result", result, RunResult, "process a run first: dic.process_run(path)")
    corrections = result.corrections
    with ResultWriter(Path(path)) as writer:
        run = writer.group("run")
        run.attrs.update(asdict(result.info) | {"source": result.source, "motion": corrections.motion})
        for camera in result.cameras:
            _write_camera(writer, camera, corrections)
        if corrections.joint is not None:
            joint = corrections.joint
            writer.add_two_cameras(_JOINT, joint.cameras, joint.steps)
            _write_texts(writer.group(_JOINT), "findings", joint.findings)
        writer.group("settings").attrs["correcting"] = result.correcting.as_text()
        writer.group("settings").attrs.update(vars(result.settings))


def load_run_result(path: PathLike) -> RunResult:
    """Read the result file of a run. Stored values are not computed again.

    Files of earlier versions lack some values, which are computed when the file is read. Result files do not
    store the gradients and the errors of calibrated displacements. Call `dic.measure` to compute these
    gradients and errors.

    Raises
    ------
    RunFileError
        If the file is missing or cut off, or is not the result file of a run.
    """
    path = Path(path)
    try:
        with open_hdf5(path) as file:
            if file.attrs.get("file_format") != FORMAT or "run" not in file:
                raise _refusal(path, "an HDF5 file of another kind")
            if file.attrs["file_format_version"] != VERSION:
                raise _refusal(path, f"version {file.attrs['file_format_version']}, newer than this program")
            return _read_run(file)
    except NotReadable as error:
        raise _refusal(path, str(error)) from error
    except MeasurementError:
        raise
    except Exception as error:
        # A damaged file can cause any exception here. Everything in this block only reads the file.
        raise _refusal(path, f"a result file that lacks some of its data ({type(error).__name__})") from error


def _write_camera(writer: ResultWriter, camera: CameraResult, corrections: RunCorrections) -> None:
    name, found = f"cameras/{camera.camera}", corrections.cameras[camera.camera]
    for measurement in camera.measurements:
        writer.add(f"{name}/series", measurement)
    group = writer.group(name)
    group.attrs["failures"] = "\n".join(camera.failures)
    group.create_dataset("reference", data=camera.reference).attrs["units"] = "grey level"
    write_calibration(group.create_group("calibration"), camera.calibration)
    steps = group.create_group("steps")
    steps.attrs["kind"] = [step.kind for step in camera.steps]
    for column, units in _STEP_UNITS.items():
        steps.create_dataset(column, data=[getattr(s, column) for s in camera.steps]).attrs["units"] = units
    if camera.measurements:
        places = enumerate(zip(camera.steps, found.images, strict=True))
        joint = {k for k, (s, image) in places if corrections.best(camera.camera, s.index, k) is not image}
        writer.add_corrections(f"{name}/series", found.images, joint)
    if found.alignment is not None:
        for key, units in _ALIGNMENT_UNITS.items():
            dataset = group.create_dataset(f"alignment/{key}", data=getattr(found.alignment, key))
            dataset.attrs["units"] = units
    _write_texts(group, "findings", corrections.findings[camera.camera])


def _write_texts(group: Any, name: str, texts: list[str]) -> None:
    group.create_dataset(name, data=texts, dtype=h5py.string_dtype())


def _read_run(file: h5py.File) -> RunResult:
    run = dict(file["run"].attrs)
    info = RunInfo(**{f.name: _plain(run[f.name]) for f in fields(RunInfo)})
    attributes = {k: _plain(v) for k, v in file["settings"].attrs.items()}
    correcting = CorrectionSettings.from_text(attributes.pop("correcting"))
    settings = CorrelationSettings(**NOT_SMOOTHED | attributes)
    cameras = [_read_camera(name, group) for name, group in file["cameras"].items()]
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
    return RunResult(str(run["source"]), info, settings, correcting, cameras, corrections)


def _read_camera(name: str, group: h5py.Group) -> CameraResult:
    calibration = read_calibration(group["calibration"])
    columns = {column: group["steps"][column][:] for column in _STEP_UNITS}
    steps = []
    for k, kind in enumerate(group["steps"].attrs["kind"]):
        values = {column: float(values[k]) for column, values in columns.items() if column != "index"}
        steps.append(RunStep(index=int(columns["index"][k]), kind=str(kind), **values))
    measurements = read_measurements(group["series"], calibration) if steps else []
    failures = [line for line in str(group.attrs["failures"]).split("\n") if line]
    return CameraResult(name, calibration, group["reference"][:], steps, measurements, failures)


def _read_corrections(group: h5py.Group, camera: CameraResult, anew: RunCorrections | None) -> Corrections:
    solved = None if anew is None else anew.cameras[camera.camera]
    images = []
    if camera.measurements:
        images = read_corrections(
            group["series"], camera.measurements, None if solved is None else solved.images
        )
    if solved is not None:
        return Corrections(images, solved.alignment)
    if "alignment" not in group:
        return Corrections(images)
    return Corrections(images, Alignment(**{key: group["alignment"][key][:] for key in _ALIGNMENT_UNITS}))


def _read_joint(group: h5py.Group, cameras: list[CameraResult]) -> JointCorrections:
    measured = {c.camera: {s.index: m for s, m in zip(c.steps, c.measurements, strict=True)} for c in cameras}
    pair, steps = read_two_cameras(group, measured)
    return JointCorrections(pair, steps, _read_texts(group, "findings"))


def _read_texts(group: h5py.Group, name: str) -> list[str]:
    return [str(text) for text in group[name].asstr()[:]]


def _plain(value: Any) -> Any:
    """Return a NumPy scalar from an HDF5 file as a Python number; return other values unchanged."""
    return value.item() if isinstance(value, np.generic) else value


def _refusal(path: Path, got: str) -> RunFileError:
    return RunFileError(
        str(path),
        "read results",
        f"a result file of version {VERSION} from `dic process`",
        got,
        "make it with `dic process RUN.h5`",
    )
