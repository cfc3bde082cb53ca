"""Set the exposure time and gain of a camera, and all other controls that affect grey levels."""

import math
from dataclasses import dataclass

from drivers.cameras.v4l2.abi import ControlId
from drivers.cameras.v4l2.controls import AUTOMATICS, CameraControl, Controls
from drivers.cameras.v4l2.settings import V4l2Settings
from drivers.errors import DeviceFault
from drivers.interfaces import Setting

EXPOSURE_UNIT_US = 100.0
"""Unit of the control ``V4L2_CID_EXPOSURE_ABSOLUTE`` in µs, from the kernel's documentation."""
TOLERANCE = 1e-3
SHUTTER_PRIORITY = 2
"""Value of the control ``V4L2_CID_EXPOSURE_AUTO`` for manual exposure time with automatic iris.

The number is from the documentation of the Linux kernel.
"""


@dataclass(frozen=True)
class Exposure:
    """Exposure time in µs and gain, as read back, or NaN if unknown or under automatic control."""

    time_us: float
    gain: float


def set_exposure(controls: Controls, settings: V4l2Settings, device: str) -> Exposure:
    """Switch the automatic controls off, then set exposure, gain and the other controls.

    Raise `DeviceFault` if the camera does not accept a value, or an accepted value has no effect; if
    `exposure_us` is missing although the camera has an exposure control, or given although it has none; or if
    `controls` names exposure or gain, which have settings of their own.
    """
    controls.switch_automatics_off(settings.controls)
    exposure, unit_us = _exposure_control(controls, settings)
    time_us = _set_exposure_time(controls, exposure, unit_us, settings.exposure_us, device)
    gain = _gain_control(controls)
    for name, value in settings.controls.items():
        control = controls.named(name)
        if control in (exposure, gain):
            own = "gain" if control is gain else "exposure_us"
            raise _unusable(device, f"set {name}", f"{name} under `controls`", f"use the setting `{own}`")
        if control.id not in AUTOMATICS:
            controls.set_active(control, value)
    return Exposure(time_us, _set_gain(controls, gain, settings.gain, device))


def read_exposure(controls: Controls, settings: V4l2Settings) -> dict[str, Setting]:
    """Return exposure time and gain, as read from the camera; leave out a value that is unknown.

    The exposure time is missing if the camera counts it in lines of unknown duration.
    """
    found: dict[str, Setting] = {}
    control, unit_us = _exposure_control(controls, settings)
    if control is not None and unit_us is not None:
        found["exposure_us"] = controls.get(control) * unit_us
    gain = _gain_control(controls)
    # while an automatic control changes the gain, its value is not a setting
    if gain is not None and not controls.is_held(gain):
        found["gain"] = controls.get(gain)
    return found


def _gain_control(controls: Controls) -> CameraControl | None:
    return controls.known.get(ControlId.GAIN) or controls.known.get(ControlId.ANALOGUE_GAIN)


def _exposure_control(
    controls: Controls, settings: V4l2Settings
) -> tuple[CameraControl | None, float | None]:
    control = controls.known.get(ControlId.EXPOSURE_ABSOLUTE)
    if control is not None:
        return control, EXPOSURE_UNIT_US
    # Without V4L2_CID_EXPOSURE_ABSOLUTE the exposure is counted in sensor lines. A data sheet gives the
    # duration of a line.
    return controls.known.get(ControlId.EXPOSURE), settings.line_us


def _set_exposure_time(
    controls: Controls,
    control: CameraControl | None,
    unit_us: float | None,
    wanted_us: float | None,
    device: str,
) -> float:
    step = "set exposure"
    if control is None:
        if wanted_us is None:
            return math.nan
        raise _unusable(device, step, "no exposure control", "leave out `exposure_us`")
    if wanted_us is None:
        raise _unusable(device, step, "no `exposure_us`", "add this setting: the camera can set the time")
    if unit_us is None:
        raise _unusable(device, step, "exposure in lines", "add `line_us`, the duration of a line")
    value = round(wanted_us / unit_us)
    if abs(value * unit_us - wanted_us) > TOLERANCE * wanted_us:
        remedy = f"choose a multiple of {unit_us:g} µs, as the camera does"
        raise _unusable(device, step, f"{wanted_us:g} µs", remedy)
    automatic = controls.known.get(ControlId.EXPOSURE_AUTO)
    if automatic is not None and controls.get(automatic) == SHUTTER_PRIORITY:
        # writing works here, although the kernel driver uvcvideo flags this control as inactive
        controls.set(control, value)
    else:
        controls.set_active(control, value)
    return value * unit_us


def _set_gain(controls: Controls, control: CameraControl | None, wanted: int | None, device: str) -> float:
    if control is None:
        if wanted is None:
            return math.nan
        raise _unusable(device, "set gain", "no gain control", "leave out `gain`")
    if wanted is not None:
        controls.set_active(control, wanted)
        return wanted
    # if the settings leave an automatic gain control on, the gain varies and is not known
    return math.nan if controls.is_held(control) else controls.hold(control)


def _unusable(device: str, step: str, got: str, remedy: str) -> DeviceFault:
    return DeviceFault(device, step, "a setting that the camera supports", got, remedy)
