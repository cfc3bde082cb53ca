"""The result file of a run: everything `process_run` found, so that a report needs nothing else."""

from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np

from dic.calibration.file import read_calibration, write_calibration
from dic.correlation.field import Field
from dic.correlation.settings import CorrelationSettings
from dic.errors import RunFileError
from dic.pipeline.camera_result import CameraResult
from dic.pipeline.run import RunResult
from dic.pipeline.run_corrections import CorrectionSettings
from dic.results.writer import FORMAT, VERSION, ResultWriter
from dic.runfile.reader import RunInfo, RunStep
from dic.strain.measurement import measure
from dic.strain.strain import StrainSettings

_STEP_UNITS = {
    "index": "1", "target": "by kind: N, mm or deg", "load_n": "N", "displacement_mm": "mm",
    "angle_deg": "deg", "time_s": "s",
}  # fmt: skip


def save_run_result(result: RunResult, path: Path) -> None:
    """Write the result file of a run; layout in `docs/results.md`.

    Raises
    ------
    RunFileError
        If the file cannot be written.
    """
    with ResultWriter(path) as writer:
        run = writer.group("run")
        run.attrs.update(asdict(result.info) | {"source": result.source})
        for camera in result.cameras:
            name = f"cameras/{camera.camera}"
            for measurement in camera.measurements:
                writer.add(f"{name}/series", measurement)
            group = writer.group(name)
            group.attrs["failures"] = "\n".join(camera.failures)
            group.create_dataset("reference", data=camera.reference).attrs["units"] = "grey level"
            write_calibration(group.create_group("calibration"), camera.calibration)
            _write_steps(group.create_group("steps"), camera.steps)
            if camera.measurements:
                corrections = result.corrections.cameras[camera.camera].images
                writer.add_corrections(f"{name}/series", corrections)
        writer.group("settings").attrs["correcting"] = result.correcting.as_text()
        writer.group("settings").attrs.update(vars(result.settings))


def load_run_result(path: Path) -> RunResult:
    """Read the result file of a run.

    Raises
    ------
    RunFileError
        If the file is missing, cut off, or no result file of a run.
    """
    import h5py

    if not path.is_file():
        raise _refusal(path, "no such file")
    try:
        with h5py.File(path, "r") as file:
            if file.attrs.get("file_format") != FORMAT or "run" not in file:
                raise _refusal(path, "an HDF5 file of another kind")
            if file.attrs["file_format_version"] != VERSION:
                raise _refusal(path, f"version {file.attrs['file_format_version']}, newer than this program")
            run = dict(file["run"].attrs)
            info = RunInfo(**{f.name: _plain(run[f.name]) for f in fields(RunInfo)})
            attributes = {k: _plain(v) for k, v in file["settings"].attrs.items()}
            correcting = CorrectionSettings.from_text(attributes.pop("correcting"))
            settings = CorrelationSettings(**attributes)
            cameras = [_read_camera(name, group, settings) for name, group in file["cameras"].items()]
            return RunResult(str(run["source"]), info, settings, cameras, correcting)
    except (KeyError, TypeError) as error:
        raise _refusal(path, "a result file that lacks some of its data") from error
    except OSError as error:
        raise _refusal(path, "a file that was cut off or is no HDF5") from error


def _write_steps(group: Any, steps: list[RunStep]) -> None:
    group.attrs["kind"] = [step.kind for step in steps]
    for name, units in _STEP_UNITS.items():
        group.create_dataset(name, data=[getattr(step, name) for step in steps]).attrs["units"] = units


def _read_camera(name: str, group: Any, settings: CorrelationSettings) -> CameraResult:
    calibration = read_calibration(group["calibration"])
    columns = {column: group["steps"][column][:] for column in _STEP_UNITS}
    steps = []
    for k, kind in enumerate(group["steps"].attrs["kind"]):
        values = {column: float(values[k]) for column, values in columns.items() if column != "index"}
        steps.append(RunStep(index=int(columns["index"][k]), kind=str(kind), **values))
    measurements = []
    if steps:
        series = group["series"]
        strain = StrainSettings(
            **{f.name: _plain(series.attrs[f"strain_{f.name}"]) for f in fields(StrainSettings)}
        )
        for k, label in enumerate(series["label"].asstr()[:]):
            field = _read_field(series, k, settings)
            measurements.append(measure(field, calibration, strain, label=str(label)))
    failures = [line for line in str(group.attrs["failures"]).split("\n") if line]
    return CameraResult(name, calibration, group["reference"][:], steps, measurements, failures)


def _read_field(series: Any, k: int, settings: CorrelationSettings) -> Field:
    def joined(u: str, v: str, gradient: str) -> Any:
        slopes = np.moveaxis(series[gradient][k], -1, 0)
        return np.stack([series[u][k], *slopes[:2], series[v][k], *slopes[2:]], axis=-1)

    return Field(
        x_px=series["x_px"][:],
        y_px=series["y_px"][:],
        warps=joined("u_px", "v_px", "gradient"),
        std=joined("std_u_px", "std_v_px", "std_gradient"),
        zncc=series["zncc"][k],
        iterations=series["iterations"][k].astype(np.int16),
        status=series["status"][k].astype(np.int8),
        active=series["active"][:].astype(np.bool_),
        start=str(series["start"].asstr()[k]),
        settings=settings,
        # Files of the time before runs were measured over new references have none.
        updates=int(series["updates"][k]) if "updates" in series else 0,
    )


def _plain(value: Any) -> Any:
    """Return an HDF5 attribute as the Python value it was."""
    return value.item() if isinstance(value, np.generic) else value


def _refusal(path: Path, got: str) -> RunFileError:
    return RunFileError(
        str(path),
        "read results",
        f"a result file of version {VERSION} from `dic process`",
        got,
        "make it with `dic process RUN.h5`",
    )
