"""A camera's controls: all automatics off, the rest as wanted, every one read back."""

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
    Request,
)
from drivers.cameras.v4l2.node import Node, translate
from drivers.errors import DeviceFault

MANUAL_EXPOSURE = 1

# In this order: exposure and gain can only be set once their automatics are off.
AUTOMATICS: dict[ControlId, int] = {
    ControlId.EXPOSURE_AUTO: MANUAL_EXPOSURE,
    ControlId.EXPOSURE_AUTO_PRIORITY: 0,  # "exposure, dynamic framerate"
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
class Control:
    """One control as the camera describes it; `name` is written as ``v4l2-ctl`` does."""

    id: int
    name: str
    type: int
    minimum: int
    maximum: int
    step: int
    flags: int


class Controls:
    """The controls of an opened camera, and what each was set to.

    Parameters
    ----------
    node : Node
    device : str
        For messages.
    """

    def __init__(self, node: Node, device: str) -> None:
        self._node = node
        self._device = device
        self._fault = partial(DeviceFault, self._device)
        self._set: dict[int, int] = {}
        self.known = self._enumerate()

    def switch_automatics_off(self, wanted: Mapping[str, int]) -> None:
        """Switch every automatic off that the camera has, or set it as `wanted` by its name.

        Raises
        ------
        DeviceFault
            If one stays otherwise.
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

    def named(self, name: str) -> Control:
        """Return the control of that name.

        Raises
        ------
        DeviceFault
            If the camera has none; the message lists those it has.
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

    def set(self, control: Control, value: int) -> None:
        """Write a control and read it back.

        Raises
        ------
        DeviceFault
            If the value is out of range, or another one is read back.
        """
        step = f"set {control.name}"
        # the kernel would move it into the range silently
        if not control.minimum <= value <= control.maximum or (value - control.minimum) % control.step:
            raise self._fault(
                step,
                f"{control.minimum} to {control.maximum} in steps of {control.step}",
                str(value),
                "choose such a value",
            )
        request = ControlValue(id=control.id, value=value)
        try:
            self._node.ioctl(Request.S_CTRL, request)
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

    def get(self, control: Control) -> int:
        """Read a control."""
        request = ControlValue(id=control.id)
        try:
            self._node.ioctl(Request.G_CTRL, request)
        except OSError as error:
            raise translate(error, self._device, f"read {control.name}", "a value") from error
        return int(request.value)

    def hold(self, control: Control) -> int:
        """Leave a control as it is, and return its value, which `verify` expects from now on."""
        self._set[control.id] = self.get(control)
        return self._set[control.id]

    def is_held(self, control: Control) -> bool:
        """Return whether an automatic holds a control, so that what is written has no effect."""
        query = ControlQuery(id=control.id)
        try:
            self._node.ioctl(Request.QUERYCTRL, query)
        except OSError as error:
            raise translate(error, self._device, f"query {control.name}", "its state") from error
        return bool(query.flags & ControlFlag.INACTIVE)

    def set_active(self, control: Control, value: int) -> None:
        """Write a control that must have an effect.

        Raises
        ------
        DeviceFault
            As `set` does, and if an automatic holds it: some drivers take the value all the same.
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
        """Read back everything that was set.

        Raises
        ------
        DeviceFault
            If one has changed: another program may, and so may setting another control.
        """
        for id, value in self._set.items():
            if (got := self.get(self.known[id])) != value:
                raise self._fault(
                    f"verify {self.known[id].name}",
                    f"{value}, as it was set",
                    str(got),
                    "end the program that changes the camera, then start again",
                )

    def _require(self, control: Control, value: int) -> None:
        if (got := self.get(control)) != value:
            raise self._fault(
                f"set {control.name}",
                str(value),
                f"{got}, which cannot be changed",
                f"use another camera, or accept it: controls = {{ {control.name} = {got} }}",
            )

    def _enumerate(self) -> dict[int, Control]:
        found: dict[int, Control] = {}
        last = 0
        while True:
            query = ControlQuery(id=last | NEXT_CONTROL)
            try:
                self._node.ioctl(Request.QUERYCTRL, query)
            except OSError as error:
                if error.errno in _END_OF_LIST:
                    return found
                raise translate(error, self._device, "list controls", "its controls") from error
            if query.id <= last:  # a driver that goes round would be asked for ever
                return found
            last = query.id
            if query.type in _NUMBERS and not query.flags & ControlFlag.DISABLED:
                name = re.sub(r"[^a-z0-9]+", "_", query.name.decode("utf-8", "replace").lower()).strip("_")
                found[last] = Control(
                    last, name, query.type, query.minimum, query.maximum, max(1, query.step), query.flags
                )


_END_OF_LIST = (errno.EINVAL, errno.ENOTTY)  # the latter of a camera without any control
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
