"""The CSV tables of a run: the mean strains of all cameras and steps, and the points of each image."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from dic.files.lazy import by_index
from dic.pipeline.result import RunResult
from dic.results.csv import write_csv
from dic.results.strain_table import STRAIN_FILE, write_strain_table


def write_run_tables(result: RunResult, folder: Path, *, decimal_comma: bool = False) -> None:
    """Write strain.csv, and a table of points for each camera and step, such as ``off_axis_load_3.csv``.

    Parameters
    ----------
    result : RunResult
    folder : Path
        A folder that exists.
    decimal_comma : bool
        True for numbers with a decimal comma and semicolons between cells.
    """
    write_strain_table(list(_rows(result)), folder / STRAIN_FILE, decimal_comma=decimal_comma)
    for camera in result.cameras:
        corrections = result.corrections.cameras[camera.camera].images
        for step, measurement, correction in by_index(camera.steps, camera.measurements, corrections):
            path = folder / f"{camera.camera}_{step.kind}_{step.index}.csv"
            write_csv(measurement, path, correction=correction, decimal_comma=decimal_comma)
            del measurement, correction


def _rows(result: RunResult) -> Iterator[dict[str, Any]]:
    """Yield the rows of all cameras and steps for `write_strain_table`; joint results come last."""
    steps = {}
    for camera in result.cameras:
        corrections = result.corrections.cameras[camera.camera].images
        for step, measurement, correction in by_index(camera.steps, camera.measurements, corrections):
            steps[step.index] = step.known() | {"step": f"{step.kind} {step.index}"}
            row = measurement.summary() | {"corrected": correction.as_dict()}
            yield row | steps[step.index] | {"camera": camera.camera, "error": measurement.objection}
            del measurement, correction
        for failure in camera.failures:
            yield {"file": "", "camera": camera.camera, "error": failure}
    joint = result.corrections.joint
    for index, found in sorted(() if joint is None else joint.steps.items()):
        if joint is not None and found.mean is not None and found.declined is None:
            mean = found.mean.as_dict() | {"applied": True, "method": "two cameras"}
            together = {"file": "", "camera": " + ".join(joint.cameras), "corrected": mean}
            yield steps[index] | together
