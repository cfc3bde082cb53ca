"""Check a rig before a run: identity, state and limits of each device, image quality; nothing moves.

`dic.quality` judges each camera's image, as `dic quality` judges an image file.
"""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dic.errors import MeasurementError
from dic.quality.findings import picture_findings, quality_findings
from dic.quality.picture import assess_picture
from dic.quality.quality import assess_quality
from rig.devices import Rig

NO_PATTERN = (
    "shows no speckle pattern that can be measured; put the specimen into view, and check light and focus"
)
_TIMEOUT_S = 5.0
_PRINTED = ("speckle_x_px", "speckle_y_px", "noise", "floor_px", "contrast", "blur_px")

Image = NDArray[np.uint8] | NDArray[np.uint16]


@dataclass(frozen=True)
class GreyLevels:
    """Grey levels of one image; `saturated` is the fraction of pixels at the highest level."""

    minimum: int
    mean: float
    maximum: int
    standard_deviation: float
    saturated: float


@dataclass(frozen=True)
class RigCheck:
    """The findings, as lines to print and as a table for JSON, and the problems."""

    lines: list[str]
    devices: dict[str, Any]
    problems: list[str]


def grey_levels(image: Image, bits: int) -> GreyLevels:
    """Measure the grey levels of an image of `bits` significant bits."""
    return GreyLevels(
        minimum=int(image.min()),
        mean=float(image.mean()),
        maximum=int(image.max()),
        standard_deviation=float(image.std()),
        saturated=float(np.mean(image >= _full_level(bits))),
    )


def judge(image: Image, bits: int) -> tuple[dict[str, Any], list[str]]:
    """Return the figures of an image's quality, and a sentence for each that is not good.

    Without a speckle pattern only light and focus are judged.
    """
    grey, full_level = image.astype(np.float32), _full_level(bits)
    try:
        quality = assess_quality(grey, full_level=full_level)
    except MeasurementError:
        picture = assess_picture(grey, full_level=full_level)
        return picture.as_dict(), [*picture_findings(picture), NO_PATTERN]
    return quality.as_dict(), quality_findings(quality)


def check_rig(rig: Rig) -> RigCheck:
    """Read every device once and take one image with each camera.

    Raises
    ------
    DeviceError
        If a device does not answer.
    """
    found = RigCheck([], {}, [])
    if rig.stage is not None:
        state = rig.stage.read()
        _add(found, "stage", rig.stage.info, state)
        # A stage without a reference position warns of that. It is no problem: the run homes the stage first.
        found.problems.extend(f"stage: warning {warning}" for warning in state.warnings if state.homed)
    if rig.load_frame is not None:
        frame = rig.load_frame.read()
        _add(found, "load_frame", rig.load_frame.info, frame)
        limits = asdict(rig.load_frame.limits)
        found.devices["load_frame"]["limits"] = limits
        found.lines.append("  limits: " + ", ".join(f"{name} {value:g}" for name, value in limits.items()))
        found.problems.extend(f"load_frame: fault {fault}" for fault in frame.faults)
    for camera_name, camera in rig.cameras.items():
        name, bits = f"cameras.{camera_name}", camera.info.bits
        image = camera.grab(_TIMEOUT_S).image
        _add(found, name, camera.info, grey_levels(image, bits))
        figures, sentences = judge(image, bits)
        found.devices[name] |= {"quality": figures, "findings": sentences}
        printed = [f"{key} {_shown(figures[key])}" for key in _PRINTED if figures.get(key) is not None]
        found.lines.append("  quality: " + ", ".join(printed))
        found.problems.extend(f"{name}: {sentence}" for sentence in sentences)
    return found


def _full_level(bits: int) -> int:
    return (1 << bits) - 1


def _add(found: RigCheck, name: str, info: Any, state: Any) -> None:
    identity, values = asdict(info), asdict(state)
    found.devices[name] = {"identity": identity, "state": values}
    found.lines.append(
        f"{name}: " + ", ".join(f"{key} {value}" for key, value in identity.items() if value != "")
    )
    found.lines.append("  " + ", ".join(f"{key} {_shown(value)}" for key, value in values.items()))


def _shown(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    return (", ".join(value) or "none") if isinstance(value, tuple) else str(value)
