"""A look at the rig before a run: who the devices are, what they allow, what cameras see; nothing moves."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.devices import Rig

SATURATED_MAX = 0.001
"""Fraction of saturated pixels that an image may have: they carry no texture."""

_CONTRAST_MIN = 0.05
_TIMEOUT_S = 5.0


@dataclass(frozen=True)
class ImageQuality:
    """Grey levels of one image; `saturated` is the fraction of pixels at the highest level."""

    minimum: int
    mean: float
    maximum: int
    standard_deviation: float
    saturated: float


@dataclass(frozen=True)
class RigCheck:
    """What was found, as lines to print and as a table for JSON, and what is not good."""

    lines: list[str]
    devices: dict[str, Any]
    problems: list[str]


def image_quality(image: NDArray[np.uint8] | NDArray[np.uint16], bits: int) -> ImageQuality:
    """Measure the grey levels of an image of `bits` significant bits."""
    return ImageQuality(
        minimum=int(image.min()),
        mean=float(image.mean()),
        maximum=int(image.max()),
        standard_deviation=float(image.std()),
        saturated=float(np.mean(image >= 2**bits - 1)),
    )


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
        # Without its reference a stage warns of just that, and the run finds it first.
        found.problems.extend(f"stage: warning {warning}" for warning in state.warnings if state.homed)
    if rig.load_frame is not None:
        frame = rig.load_frame.read()
        _add(found, "load_frame", rig.load_frame.info, frame)
        limits = asdict(rig.load_frame.limits)
        found.devices["load_frame"]["limits"] = limits
        found.lines.append("  limits: " + ", ".join(f"{name} {value:g}" for name, value in limits.items()))
        found.problems.extend(f"load_frame: fault {fault}" for fault in frame.faults)
    for name, camera in rig.cameras.items():
        quality = image_quality(camera.grab(_TIMEOUT_S).image, camera.info.bits)
        _add(found, f"cameras.{name}", camera.info, quality)
        found.problems.extend(f"cameras.{name}: {problem}" for problem in _judge(quality, camera.info.bits))
    return found


def _judge(quality: ImageQuality, bits: int) -> list[str]:
    problems = []
    if quality.saturated > SATURATED_MAX:
        problems.append(f"{quality.saturated:.1%} of the pixels are saturated; shorten the exposure")
    if quality.standard_deviation < _CONTRAST_MIN * 2**bits:
        problems.append(
            f"grey levels spread by {quality.standard_deviation:.1f} only; look at focus, light and exposure"
        )
    return problems


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
