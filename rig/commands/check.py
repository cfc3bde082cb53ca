"""Check a rig before a run: identity, state and limits of each device, and image quality. No device moves.

The package `dic.quality` judges one image of each camera, in the same way as the command `dic quality`.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from dic.errors import MeasurementError
from dic.files.writing import replacing
from dic.quality.findings import picture_findings, quality_findings
from dic.quality.picture import assess_picture
from dic.quality.quality import assess_quality
from drivers.errors import DeviceError
from drivers.interfaces import Camera, LoadFrame, RotationStage
from rig.devices import Rig
from rig.errors import RigError

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
    """The result of a rig check: lines to print, a table of the devices for JSON, and the problems.

    `failed` gives for each device that could not be checked the reason.
    """

    lines: list[str]
    devices: dict[str, Any]
    problems: list[str]
    failed: dict[str, str]


def grey_levels(image: Image, bits: int) -> GreyLevels:
    """Measure the grey levels of an image whose pixels have `bits` significant bits."""
    return GreyLevels(
        minimum=int(image.min()),
        mean=float(image.mean()),
        maximum=int(image.max()),
        standard_deviation=float(image.std()),
        saturated=float(np.mean(image >= _full_level(bits))),
    )


def judge(image: Image, bits: int) -> tuple[dict[str, Any], list[str]]:
    """Return the quality figures of an image, and one sentence for each figure that is not good.

    If the image shows no speckle pattern, the function judges only light and focus.
    """
    grey, full_level = image.astype(np.float32), _full_level(bits)
    try:
        quality = assess_quality(grey, full_level=full_level)
    except MeasurementError:
        picture = assess_picture(grey, full_level=full_level)
        return picture.as_dict(), [*picture_findings(picture), NO_PATTERN]
    return quality.as_dict(), quality_findings(quality)


def check_rig(rig: Rig, keep: Callable[[str, Image], None] = lambda name, image: None) -> RigCheck:
    """Read every device once and take one image with each camera; go on after a device that fails.

    Parameters
    ----------
    rig : Rig
    keep : callable, optional
        Function that is called with the name of each camera and its image.
    """
    found = RigCheck([], {}, [], {})
    checks: dict[str, Callable[[], None]] = {}
    if rig.stage is not None:
        checks["stage"] = partial(_check_stage, found, rig.stage)
    if rig.load_frame is not None:
        checks["load_frame"] = partial(_check_load_frame, found, rig.load_frame)
    for name, camera in rig.cameras.items():
        checks[f"cameras.{name}"] = partial(_check_camera, found, name, camera, keep)
    for name, check in checks.items():
        try:
            check()
        except DeviceError as error:
            found.failed[name] = str(error)
    return found


def keep_in(folder: Path) -> Callable[[str, Image], None]:
    """Return a function that writes the image of a camera as NAME.png into a folder, unchanged."""

    def keep(name: str, image: Image) -> None:
        path = folder / f"{name}.png"
        try:
            with replacing(path) as partial_path:
                partial_path.write_bytes(cv2.imencode(".png", image)[1].tobytes())
        except OSError as error:
            raise RigError(
                str(path),
                "a picture that can be written",
                error.strerror or str(error),
                "name another folder with -o",
            ) from error

    return keep


def _check_stage(found: RigCheck, stage: RotationStage) -> None:
    state = stage.read()
    _add(found, "stage", stage.info, state)
    # A stage without a reference position gives a warning. It is no problem, because a run homes the stage
    # first.
    found.problems.extend(f"stage: warning {warning}" for warning in state.warnings if state.homed)


def _check_load_frame(found: RigCheck, load_frame: LoadFrame) -> None:
    state = load_frame.read()
    _add(found, "load_frame", load_frame.info, state)
    limits = asdict(load_frame.limits)
    found.devices["load_frame"]["limits"] = limits
    found.lines.append("  limits: " + ", ".join(f"{name} {value:g}" for name, value in limits.items()))
    found.problems.extend(f"load_frame: fault {fault}" for fault in state.faults)


def _check_camera(
    found: RigCheck, camera_name: str, camera: Camera, keep: Callable[[str, Image], None]
) -> None:
    name, bits = f"cameras.{camera_name}", camera.info.bits
    image = camera.grab(_TIMEOUT_S).image
    keep(camera_name, image)
    _add(found, name, camera.info, grey_levels(image, bits))
    figures, sentences = judge(image, bits)
    found.devices[name] |= {"quality": figures, "findings": sentences}
    printed = [f"{key} {_shown(figures[key])}" for key in _PRINTED if figures.get(key) is not None]
    found.lines.append("  quality: " + ", ".join(printed))
    found.problems.extend(f"{name}: {sentence}" for sentence in sentences)


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
