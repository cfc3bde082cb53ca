"""Check a rig before a run: identity, state and limits of each device, and image quality. No device moves.

The package `dic.quality` judges one image of each camera, in the same way as the command `dic quality`.
"""

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from dic.errors import MeasurementError
from dic.files.writing import replacing
from dic.quality.findings import picture_findings, quality_findings
from dic.quality.picture import assess_picture
from dic.quality.quality import assess_quality
from drivers.clock import SystemClock
from drivers.errors import DeviceError
from drivers.interfaces import Camera, Frame, LoadFrame, RotationStage, Setting
from rig.commands.check_channels import check_channels, check_trigger
from rig.commands.rig_check import RigCheck
from rig.device_settings import read_settings, reports_settings
from rig.devices import OpenedInterlock, Rig
from rig.engine.calls import CAMERA_MARGIN_S, PATIENCE_S
from rig.engine.settings import READING_S
from rig.errors import RigError
from rig.threads import Bounded

NO_PATTERN = (
    "shows no speckle pattern that can be measured; put the specimen into view, and check light and focus"
)
_TIMEOUT_S = 5.0
_PRINTED = ("speckle_x_px", "speckle_y_px", "noise", "floor_px", "contrast", "blur_px")

Image = NDArray[np.uint8] | NDArray[np.uint16]
T = TypeVar("T")


@dataclass(frozen=True)
class GreyLevels:
    """Grey levels of one image. `saturated` is the fraction of pixels at the highest level."""

    minimum: int
    mean: float
    maximum: int
    standard_deviation: float
    saturated: float


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
    """Read every device once, take one image with each camera, and go on after a device that fails or hangs.

    Each call of a driver has the deadline `call_timeout_s` of the rig. The call of a camera has more time. A
    device in whose driver a call hangs is added to `lost` of the rig, and is not closed. `keep` is called
    with the name of each camera and its image.
    """
    found = RigCheck([], {}, [], {})
    call = _Calls(rig)
    checks: dict[str, Callable[[], None]] = {}
    if rig.stage is not None:
        checks["stage"] = partial(_check_stage, found, rig.stage, call)
    if rig.load_frame is not None:
        checks["load_frame"] = partial(_check_load_frame, found, rig.load_frame, call)
    for name, interlock in rig.interlocks.items():
        checks[f"interlocks.{name}"] = partial(_check_interlock, found, name, interlock, call)
    for name, camera in rig.cameras.items():
        checks[f"cameras.{name}"] = partial(_check_camera, found, name, camera, call, keep)
    for name in rig.channels:
        checks[f"channels.{name}"] = partial(check_channels, found, rig, name)
    for name, trigger in rig.triggers.items():
        checks[f"triggers.{name}"] = partial(check_trigger, found, name, trigger)
    devices: dict[str, Any] = {"stage": rig.stage, "load_frame": rig.load_frame}
    devices |= {f"interlocks.{name}": interlock.device for name, interlock in rig.interlocks.items()}
    devices |= {f"cameras.{name}": camera for name, camera in rig.cameras.items()}
    devices |= {f"channels.{name}": device for name, device in rig.channels.items()}
    devices |= {f"triggers.{name}": trigger.device for name, trigger in rig.triggers.items()}
    for name, check in checks.items():
        try:
            check()
            _add_settings(found, name, devices[name], call)
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


class _Calls:
    """Calls drivers on separate threads with deadlines, so that a call that hangs ends only one check."""

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        # A simulated device computes while its clock stands still, so its calls may take more real time.
        self._spare_s = 0.0 if isinstance(rig.clock, SystemClock) else PATIENCE_S

    def read(self, device: str, function: Callable[[], T]) -> T:
        """Read a device. Raise `DeviceTimeout` after `call_timeout_s`."""
        timeout_s = self._rig.call_timeout_s
        remedy = "check the device and its cable; if its calls may take longer, raise call_timeout_s in [rig]"
        return self._call(device, "read", function, timeout_s, remedy)

    def grab(self, device: str, camera: Camera) -> Frame:
        """Take an image. Raise `DeviceTimeout` if the driver exceeds its own deadline."""
        deadline_s = _TIMEOUT_S + CAMERA_MARGIN_S
        return self._call(
            device, "grab", lambda: camera.grab(_TIMEOUT_S), deadline_s, "check the camera and its cable"
        )

    def settings(self, name: str, device: Any) -> dict[str, Setting]:
        """Read the settings that a device reports."""
        remedy = "check the device and its cable"
        return self._call(name, "read settings", lambda: read_settings(name, device), READING_S, remedy)

    def _call(self, device: str, action: str, function: Callable[[], T], deadline_s: float, remedy: str) -> T:
        call = Bounded(device, action, function)
        try:
            return call.result(deadline_s + self._spare_s, remedy)
        finally:
            if call.hangs:
                self._rig.lost[device] = f"{action}, which has not returned for {deadline_s:g} s"


def _check_stage(found: RigCheck, stage: RotationStage, call: _Calls) -> None:
    state = call.read("stage", stage.read)
    _add(found, "stage", stage.info, state)
    # A stage without a reference position is only a warning, because a run homes the stage first.
    found.problems.extend(f"stage: warning {warning}" for warning in state.warnings if state.homed)


def _check_load_frame(found: RigCheck, load_frame: LoadFrame, call: _Calls) -> None:
    state = call.read("load_frame", load_frame.read)
    _add(found, "load_frame", load_frame.info, state)
    limits = asdict(load_frame.limits)
    found.devices["load_frame"]["limits"] = limits
    found.lines.append("  limits: " + ", ".join(f"{name} {value:g}" for name, value in limits.items()))
    found.problems.extend(f"load_frame: fault {fault}" for fault in state.faults)


def _check_interlock(found: RigCheck, lock_name: str, interlock: OpenedInterlock, call: _Calls) -> None:
    name = f"interlocks.{lock_name}"
    state = call.read(name, interlock.device.read)
    _add(found, name, interlock.device.info, state)
    allowed = {
        "unit": interlock.device.unit,
        "allowed_min": interlock.allowed_min,
        "allowed_max": interlock.allowed_max,
    }
    found.devices[name] |= {**allowed, "allows": interlock.allows(state)}
    # JSON cannot express NaN or infinite values, so write None.
    found.devices[name]["state"]["value"] = state.value if math.isfinite(state.value) else None
    found.lines.append(f"  allowed: {interlock.allowed}")
    if not interlock.allows(state):
        found.problems.append(
            f"{name}: the value is {state.value:g}{interlock.unit}, but a run needs {interlock.allowed}; "
            "find out why the interlock does not allow a run"
        )


def _check_camera(
    found: RigCheck, camera_name: str, camera: Camera, call: _Calls, keep: Callable[[str, Image], None]
) -> None:
    name, bits = f"cameras.{camera_name}", camera.info.bits
    image = call.grab(name, camera).image
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
    values = asdict(state)
    _add_identity(found, name, info, values)
    found.lines.append("  " + ", ".join(f"{key} {_shown(value)}" for key, value in values.items()))


def _add_identity(found: RigCheck, name: str, info: Any, values: Any) -> None:
    identity = asdict(info)
    found.devices[name] = {"identity": identity, "state": values}
    found.lines.append(
        f"{name}: " + ", ".join(f"{key} {value}" for key, value in identity.items() if value != "")
    )


def _add_settings(found: RigCheck, name: str, device: Any, call: _Calls) -> None:
    if not reports_settings(device):
        return
    settings = call.settings(name, device)
    found.devices[name]["settings"] = settings
    found.lines.append("  settings: " + ", ".join(f"{key} {_shown(settings[key])}" for key in settings))


def _shown(value: Any) -> str:
    if isinstance(value, float):
        # Show four digits, but show a setting of 10000 as 10000 and not as 1e+04.
        return f"{value:.0f}" if 1000.0 <= abs(value) < 1e7 else f"{value:.4g}"
    return (", ".join(value) or "none") if isinstance(value, tuple) else str(value)
