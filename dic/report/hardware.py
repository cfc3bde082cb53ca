"""The report's table of cameras, lenses and patterns, which the iDICs Good Practices Guide requires."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dic.errors import MeasurementError
from dic.pipeline.deformed_images import beside
from dic.pipeline.run_result import RunResult
from dic.quality.noise import noise_of_one
from dic.quality.speckle import autocovariance, even_light, speckle_size
from dic.report.camera_images import CameraImages, Results
from dic.report.numbers import fixed, with_std
from dic.report.stated_facts import FACTS, NOT_STATED, StatedFacts
from dic.runfile.joined import exposures_us, open_run
from dic.typing import Grey, Mask

_MM_TO_UM = 1000.0
_AT = "(x × y, in the middle of the grid)"


@dataclass(frozen=True)
class FactTable:
    """A table with a row for each fact and a column for each camera.

    Attributes
    ----------
    heads : list of str
        Names of the cameras; [""] for a series of images.
    rows : list of (str, list of str)
        Name of each fact, and its text for each camera.
    """

    heads: list[str]
    rows: list[tuple[str, list[str]]]


def hardware_table(result: Results, images: Sequence[CameraImages], facts: StatedFacts) -> FactTable:
    """Return the facts about cameras, lenses and patterns; a fact that is not known is "not stated"."""
    columns = [_facts_of(each, facts, _recorded(result, each.camera)) for each in images]
    rows = [(name, [column[name] for column in columns]) for name in columns[0]]
    return FactTable([each.camera for each in images], rows)


def stated_table(facts: StatedFacts, table: str, known: Mapping[str, str]) -> list[tuple[str, str]]:
    """Return name and text of each fact in a table such as "specimen"; `known` has facts from the results.

    A fact that the user states replaces the same fact from the results.
    """
    return [
        (fact.name, facts.given(table, key) or known.get(key) or NOT_STATED)
        for key, fact in FACTS[table].items()
    ]


def _recorded(result: Results, camera: str) -> dict[str, Any]:
    """Return the run file's data about a camera; an empty dict if there is no run file."""
    if not isinstance(result, RunResult):
        return {}
    try:
        with open_run(beside(result.source, result.file)) as run:
            if run.info.run_id != result.info.run_id or camera not in run.cameras:
                return {}
            return run.identity(camera) | {"exposure_us": float(np.median(exposures_us(run, camera)))}
    except MeasurementError:
        # The report also works without the run file; its facts are then "not stated".
        return {}


def _facts_of(images: CameraImages, facts: StatedFacts, recorded: Mapping[str, Any]) -> dict[str, str]:
    calibration = images.calibration
    pinhole = None if calibration is None else calibration.pinhole
    height, width = images.series.reference.shape
    bits = f", {recorded['bits']} bit" if "bits" in recorded else ""
    identity = [str(recorded[key]) for key in ("vendor", "model") if recorded.get(key)]
    if recorded.get("serial"):
        identity.append(f"serial number {recorded['serial']}")

    def known(key: str, measured: str = NOT_STATED) -> str:
        return facts.given("cameras", key, images.camera) or measured

    focal, stand_off, angle, view, scale = (NOT_STATED,) * 5
    if pinhole is not None:
        std = pinhole.covariance[0, 0] ** 0.5
        focal = f"{with_std(pinhole.focal_px, std)} px, from the calibration"
        away = with_std(float(pinhole.centre_mm[2]), float(pinhole.centre_std_mm[2]))
        stand_off = f"{away} mm from the camera's centre to the grid's plane, from the calibration"
        angle = f"{with_std(pinhole.off_axis_deg, pinhole.off_axis_std_deg)}°, from the calibration"
    if calibration is not None:
        x_mm, y_mm = calibration.axes_mm_per_px
        view = f"{fixed(width * x_mm, 2)} mm × {fixed(height * y_mm, 2)} mm {_AT}"
        scale = f"{fixed(1.0 / x_mm, 2)} px/mm × {fixed(1.0 / y_mm, 2)} px/mm, "
        scale += f"{fixed(_MM_TO_UM * x_mm, 3)} µm/px × {fixed(_MM_TO_UM * y_mm, 3)} µm/px {_AT}"
    exposure_us = float(recorded.get("exposure_us", 0.0))
    exposure = f"{exposure_us / 1000.0:g} ms" if exposure_us > 0.0 else NOT_STATED
    return {
        "Camera": known("model", ", ".join(identity) or NOT_STATED),
        "Image resolution": f"{width} px × {height} px{bits}",
        "Lens": known("lens"),
        "Focal length": known("focal_length_mm", focal),
        "Aperture": known("aperture"),
        "Field of view": view,
        "Image scale": scale,
        "Angle off-axis": angle,
        "Stand-off distance": known("stand_off_mm", stand_off),
        "Image acquisition rate": known("frame_rate_hz", _interval(images)),
        "Exposure time": known("exposure_ms", exposure),
        "Lighting": known("lighting"),
        "Patterning technique": facts.stated("pattern", "technique"),
        "Pattern feature size": _feature_size(images, facts),
    }


def _interval(images: CameraImages) -> str:
    """Return the usual time between two images."""
    steps = np.diff(images.times_s[np.isfinite(images.times_s)])
    if not steps.size:
        return NOT_STATED
    return f"one image in {np.median(steps):.3g} s (median)"


def _feature_size(images: CameraImages, facts: StatedFacts) -> str:
    """Return the size of the speckles, measured in the reference image within the region of interest."""
    made = facts.given("pattern", "feature_size_mm")
    found = next((one.measurement for one in images.series.images if one.measurement is not None), None)
    texts = [] if made is None else [f"{made} as made"]
    if found is not None:
        field, grey = found.field, images.series.reference
        region = np.ones(grey.shape, np.bool_) if field.region is None else field.region
        texts.append(_measured_size(grey, region, images))
    return "; ".join(texts) or NOT_STATED


def _measured_size(grey: Grey, region: Mask, images: CameraImages) -> str:
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
