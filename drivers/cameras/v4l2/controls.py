"""Set the controls of a camera, such as exposure and gain, and read them back. Automatic controls are off."""

import errno
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

from drivers.cameras.v4l2.abi import (
    NEXT_CONTROL,
    ControlFlag,
    ControlId,
    ControlQuery,
    ControlType,
    ControlValue,
    RequestCode,
)
from drivers.cameras.v4l2.node import Node, translate, translating
from drivers.errors import DeviceFault

MANUAL_EXPOSURE = 1

# The order matters: exposure and gain can be set only after the automatic exposure and gain are off.
AUTOMATICS: dict[ControlId, int] = {
    ControlId.EXPOSURE_AUTO: MANUAL_EXPOSURE,
    ControlId.EXPOSURE_AUTO_PRIORITY: 0,  # the kernel calls this control "exposure, dynamic framerate"
    ControlId.AUTOGAIN: 0,
    ControlId.ISO_SENSITIVITY_AUTO: 0,
    ControlId.AUTOBRIGHTNESS: 0,
    ControlId.AUTO_WHITE_BALANCE: 0,
    ControlId.AUTO_N_PRESET_WHITE_BALANCE: 0,
    ControlId.HUE_AUTO: 0,
    ControlId.CHROMA_AGC: 0,
    ControlId.FOCUS_AUTO: 0,
    ControlId.BACKLIGHT_COMPENSATION: 0,
    ControlId.WIDE_DYNAMIC_RANGE: 0,
    ControlId.IMAGE_STABILIZATION: 0,
    ControlId.POWER_LINE_FREQUENCY: 0,
}


@dataclass(frozen=True)
class CameraControl:
    """Description of one camera control. `name` is spelled as in the output of ``v4l2-ctl``."""

    id: int
    name: str
    type: int
    minimum: int
    maximum: int
    step: int
    flags: int


class Controls:
    """The controls of an opened camera, and the values that the driver has set."""

    def __init__(self, node: Node, device: str) -> None:
        self._node = node
        self._device = device
        self._fault = partial(DeviceFault, self._device)
        self._set: dict[int, int] = {}
        self.known = self._enumerate()

    def switch_automatics_off(self, wanted: Mapping[str, int]) -> None:
        """Switch off every automatic control. A control that `wanted` names gets its value from `wanted`.

        Raise `DeviceFault` if an automatic control does not take its new value.
        """
        for id, off in AUTOMATICS.items():
            control = self.known.get(id)
            if control is None:
                continue
            value = wanted.get(control.name, off)
            if control.flags & ControlFlag.READ_ONLY:
                self._require(control, value)
            else:
                self.set(control, value)

    def named(self, name: str) -> CameraControl:
        """Return the control called `name`.

        Raise `DeviceFault` if the camera has no control of this name. The message lists all controls of the
        camera.
        """
        for control in self.known.values():
            if control.name == name:
                return control
        raise self._fault(
            f"set {name}",
            "a control of the camera",
            f"{name!r}, where it has " + (", ".join(sorted(c.name for c in self.known.values())) or "none"),
            "correct `controls`",
        )

    def set(self, control: CameraControl, value: int) -> None:
        """Write a control and read it back.

        Raise `DeviceFault` if the value is out of range, or another value is read back.
        """
        step = f"set {control.name}"
        # check the range here, because the kernel would clip the value without an error
        if not control.minimum <= value <= control.maximum or (value - control.minimum) % control.step:
            raise self._fault(
                step,
                f"{control.minimum} to {control.maximum} in steps of {control.step}",
                str(value),
                "choose a value in this range",
            )
        request = ControlValue(id=control.id, value=value)
        try:
            self._node.ioctl(RequestCode.S_CTRL, request)
        except OSError as error:
            refusal = _REFUSALS.get(error.errno or 0)
            if refusal is None:
                raise translate(error, self._device, step, str(value)) from error
            raise self._fault(step, str(value), *refusal) from error
        if (got := self.get(control)) != value:
            raise self._fault(
                step, str(value), f"{got} on reading back", "choose a value that the camera takes"
            )
        self._set[control.id] = value

    def get(self, control: CameraControl) -> int:
        """Return the present value of a control, as read from the camera."""
        request = ControlValue(id=control.id)
        with translating(self._device, f"read {control.name}", "a value"):
            self._node.ioctl(RequestCode.G_CTRL, request)
        return int(request.value)

    def hold(self, control: CameraControl) -> int:
        """Return the present value of a control. From now on `verify` expects this value."""
        self._set[control.id] = self.get(control)
        return self._set[control.id]

    def is_held(self, control: CameraControl) -> bool:
        """Return whether an automatic control overrides `control`, so that writing a value has no effect."""
        query = ControlQuery(id=control.id)
        with translating(self._device, f"query {control.name}", "its state"):
            self._node.ioctl(RequestCode.QUERYCTRL, query)
        return bool(query.flags & ControlFlag.INACTIVE)

    def set_active(self, control: CameraControl, value: int) -> None:
        """Write a control and check that no automatic control overrides the value.

        Raise `DeviceFault` if `set` fails, or if an automatic control overrides the value. Some kernel
        drivers report no error although the written value has no effect.
        """
        self.set(control, value)
        if self.is_held(control):
            raise self._fault(
                f"set {control.name}",
                f"{value} in effect",
                "a control that an automatic holds",
                "switch that automatic off under `controls`",
            )

    def verify(self) -> None:
        """Read back all controls that the driver has set, and compare their values.

        Raise `DeviceFault` if a value has changed, for example because of another program or another control.
        """
        for id, value in self._set.items():
            if (got := self.get(self.known[id])) != value:
                raise self._fault(
                    f"verify {self.known[id].name}",
                    f"{value}, as it was set",
                    str(got),
                    "end the program that changes the camera, then start again",
                )

    def read(self) -> dict[str, int]:
        """Return the present values of all controls that `verify` checks, by name."""
        return {self.known[id].name: self.get(self.known[id]) for id in self._set}

    def _require(self, control: CameraControl, value: int) -> None:
        if (got := self.get(control)) != value:
            raise self._fault(
                f"set {control.name}",
                str(value),
                f"{got}, which cannot be changed",
                f"use another camera, or accept it: controls = {{ {control.name} = {got} }}",
            )

    def _enumerate(self) -> dict[int, CameraControl]:
        found: dict[int, CameraControl] = {}
        last = 0
        while True:
            query = ControlQuery(id=last | NEXT_CONTROL)
            try:
                self._node.ioctl(RequestCode.QUERYCTRL, query)
            except OSError as error:
                if error.errno in _END_OF_LIST:
                    return found
                raise translate(error, self._device, "list controls", "its controls") from error
            if query.id <= last:  # the kernel driver has begun its list of controls from the start again
                return found
            last = query.id
            if query.type in _NUMBERS and not query.flags & ControlFlag.DISABLED:
                name = re.sub(r"[^a-z0-9]+", "_", query.name.decode("utf-8", "replace").lower()).strip("_")
                found[last] = CameraControl(
                    last, name, query.type, query.minimum, query.maximum, max(1, query.step), query.flags
                )


_END_OF_LIST = (errno.EINVAL, errno.ENOTTY)  # ENOTTY means that the camera has no controls
_REFUSALS = {
    errno.EACCES: ("a refusal (EACCES)", "switch off the automatic that holds it"),
    errno.EINVAL: ("a refusal (EINVAL)", "choose a value that the camera takes"),
}
_NUMBERS = (
    ControlType.INTEGER,
    ControlType.BOOLEAN,
    ControlType.MENU,
    ControlType.BITMASK,
    ControlType.INTEGER_MENU,
)
