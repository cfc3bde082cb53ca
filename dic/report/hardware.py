"""The report's table of cameras, lenses and patterns, which the iDICs Good Practices Guide requires."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from dic.derived.deformed_images import beside
from dic.errors import MeasurementError
from dic.pipeline.result import RunResult
from dic.quality.noise import noise_of_one
from dic.quality.speckle import autocovariance, even_light, speckle_size
from dic.report.camera_images import ReportedImages, Results
from dic.report.fact_table import Fact, FactTable, table_of
from dic.report.numbers import fixed, with_std
from dic.report.stated_facts import FACTS, StatedFacts
from dic.runfile.joined import exposures_us, open_run
from dic.typing import Grey, Mask

_MM_TO_UM = 1000.0
_DETERMINED = 0.2
"""Largest relative standard deviation of a focal length or distance that counts as determined."""
_AT = "(x × y, in the middle of the grid)"


def hardware_table(result: Results, images: Sequence[ReportedImages], facts: StatedFacts) -> FactTable:
    """Return the facts about cameras, lenses and patterns; a fact that is not known is "not stated"."""
    path, recorded, doubts = _recorded(result)
    columns = [_facts_of(each, facts, result, path, recorded.get(each.camera, {})) for each in images]
    return replace(table_of([each.camera for each in images], columns), doubts=doubts)


def stated_table(facts: StatedFacts, table: str, known: Mapping[str, Fact]) -> FactTable:
    """Return the facts in a table such as "specimen"; `known` has facts from the results.

    A fact that the user states replaces the same fact from the results.
    """
    found = {kind.name: facts.stated(table, key, known=known.get(key)) for key, kind in FACTS[table].items()}
    return table_of([""], [found])


def results_file(result: Results) -> str:
    """Return the path of the result file; "" for results that were not read from a file."""
    return result.file if isinstance(result, RunResult) else result.source


def _recorded(result: Results) -> tuple[str, dict[str, dict[str, Any]], list[str]]:
    """Return the path of the run file, its data about each camera, and a sentence if it cannot be read.

    The report also works without the run file. If the file is not there, its facts are "not stated".
    """
    if not isinstance(result, RunResult):
        return "", {}, []
    path = beside(result.source, result.file)
    if not path.exists():
        return "", {}, []
    try:
        with open_run(path) as run:
            if run.info.run_id != result.info.run_id:
                said = f"{path} is the file of another run, so it gives no facts about the cameras."
                return "", {}, [said]
            return (
                str(path),
                {
                    camera: run.identity(camera)
                    | {"exposure_us": float(np.median(exposures_us(run, camera)))}
                    for camera in run.cameras
                },
                [],
            )
    except (MeasurementError, OSError, KeyError) as error:
        reason = error if isinstance(error, MeasurementError) else f"{path}: {error}"
        said = f"The run file gives no facts about the cameras, because it cannot be read: {reason}."
        return "", {}, [said]


def _facts_of(
    images: ReportedImages, facts: StatedFacts, result: Results, run_file: str, recorded: Mapping[str, Any]
) -> dict[str, Fact]:
    camera = images.camera

    def stated(key: str, measured: Fact | None = None) -> Fact:
        return facts.stated("cameras", key, camera, measured)

    def of_run(text: str, rule: str) -> Fact:
        return Fact(text, run_file, f"/entry/instrument/{camera}", rule) if recorded and text else Fact()

    height, width = images.series.reference.shape
    bits = f"{recorded['bits']} bit" if "bits" in recorded else ""
    optics = _optics(images, results_file(result))
    size = Fact(f"{width} px × {height} px", results_file(result), "reference", "size of the reference image")
    return {
        "Camera": stated("model", of_run(_identity(recorded), "vendor, model and serial of the camera")),
        "Image resolution": size,
        "Bit depth": of_run(bits, "bits of the camera's pixels"),
        "Lens": stated("lens"),
        "Focal length": stated("focal_length_mm", optics.get("focal")),
        "Aperture": stated("aperture"),
        "Field of view": optics.get("view", Fact()),
        "Image scale": optics.get("scale", Fact()),
        "Angle off-axis": optics.get("angle", Fact()),
        "Stand-off distance": stated("stand_off_mm", optics.get("away")),
        "Image acquisition rate": stated("frame_rate_hz", _interval(images, results_file(result))),
        "Exposure time": stated("exposure_ms", of_run(_exposure(recorded), "median of exposure_us")),
        "Lighting": stated("lighting"),
        "Patterning technique": facts.stated("pattern", "technique"),
        "Pattern feature size as made": facts.stated("pattern", "feature_size_mm"),
        "Pattern feature size": _feature_size(images, results_file(result)),
    }


def _identity(recorded: Mapping[str, Any]) -> str:
    parts = [str(recorded[key]) for key in ("vendor", "model") if recorded.get(key)]
    if recorded.get("serial"):
        parts.append(f"serial number {recorded['serial']}")
    return ", ".join(parts)


def _exposure(recorded: Mapping[str, Any]) -> str:
    exposure_us = float(recorded.get("exposure_us", 0.0))
    return f"{exposure_us / 1000.0:g} ms" if exposure_us > 0.0 else ""


def _optics(images: ReportedImages, file: str) -> dict[str, Fact]:
    """Return the facts that the calibration gives: field of view, scale, and the pinhole camera's place."""
    calibration = images.calibration
    if calibration is None:
        return {}
    height, width = images.series.reference.shape
    x_mm, y_mm = calibration.axes_mm_per_px
    scale = f"{fixed(1.0 / x_mm, 2)} px/mm × {fixed(1.0 / y_mm, 2)} px/mm, "
    scale += f"{fixed(_MM_TO_UM * x_mm, 3)} µm/px × {fixed(_MM_TO_UM * y_mm, 3)} µm/px {_AT}"
    derivative = "derivative of the map from px to mm in the middle of the grid"
    view = f"{fixed(width * x_mm, 2)} mm × {fixed(height * y_mm, 2)} mm {_AT}"
    found = {
        "view": Fact(view, file, "calibration", f"size of the image times the {derivative}"),
        "scale": Fact(scale, file, "calibration", derivative),
    }
    pinhole = calibration.pinhole
    if pinhole is None:
        return found
    fitted = partial(Fact, file=file, step="calibration")
    focal = _determined(pinhole.focal_px, float(pinhole.covariance[0, 0]) ** 0.5, "px")
    away = _determined(float(pinhole.centre_mm[2]), float(pinhole.centre_std_mm[2]), "mm")
    angle = f"{with_std(pinhole.off_axis_deg, pinhole.off_axis_std_deg)}°, from the calibration"
    return found | {
        "focal": fitted(f"{focal}, from the calibration", rule="focal length of the pinhole camera"),
        "away": fitted(
            f"{away} from the camera's centre to the grid's plane, from the calibration",
            rule="distance of the pinhole camera's centre",
        ),
        "angle": fitted(angle, rule="angle between the line of sight and the grid's normal"),
    }


def _determined(value: float, std: float, unit: str) -> str:
    """Return a value with its standard deviation, and say so if the calibration does not determine it.

    The image of a grid hardly depends on the distance of a camera that looks straight on, if the focal length
    changes together with the distance.
    """
    text = f"{with_std(value, std)} {unit}"
    return text if std <= _DETERMINED * abs(value) else f"not determined ({text})"


def _interval(images: ReportedImages, file: str) -> Fact:
    """Return the usual time between two images."""
    steps = np.diff(images.times_s[np.isfinite(images.times_s)])
    if not steps.size:
        return Fact()
    text = f"one image in {np.median(steps):.3g} s (median)"
    return Fact(text, file, "times of the images", "median of the differences")


def _feature_size(images: ReportedImages, file: str) -> Fact:
    """Return the size of the speckles, measured in the reference image within the region of interest."""
    first = images.first_measured
    if first is None or first.measurement is None:
        return Fact()
    field, grey = first.measurement.field, images.series.reference
    region = np.ones(grey.shape, np.bool_) if field.region is None else field.region
    text = _measured_size(grey, region, images)
    return Fact(text, file, "reference", "full width at half maximum of the autocovariance")


def _measured_size(grey: Grey, region: Mask, images: ReportedImages) -> str:
    try:
        pattern, noise = even_light(grey, region), noise_of_one(grey, region)
        sizes = [speckle_size(autocovariance(pattern, region, noise, axis)) for axis in (1, 0)]
    except MeasurementError as error:
        return f"not measurable ({error.got})"
    text = f"{fixed(sizes[0], 1)} px × {fixed(sizes[1], 1)} px"
    if images.calibration is not None:
        x_mm, y_mm = images.calibration.axes_mm_per_px
        text += f", {fixed(x_mm * sizes[0], 3)} mm × {fixed(y_mm * sizes[1], 3)} mm"
    return f"{text}, measured (width of the autocovariance)"
