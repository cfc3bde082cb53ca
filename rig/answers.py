"""Check what drivers return: values of the right kind, with times that these values can have.

A driver may come from another package. A value with a wrong time could be an old one, and a limit that is
checked against an old value protects nothing.
"""

import math
from dataclasses import fields, replace
from datetime import datetime
from functools import cache
from typing import Any, get_type_hints

import numpy as np

from drivers.clock import Clock
from drivers.errors import DeviceFault
from drivers.interfaces import (
    CameraInfo,
    DeviceInfo,
    Frame,
    InterlockState,
    LoadFrameState,
    StageState,
)
from drivers.registry import DeviceKind
from drivers.signals import Samples

_TICK_S = 1e-6
"""A smaller difference between two times, in s, is a rounding error."""
_STATES: dict[DeviceKind, type] = {
    "load_frame": LoadFrameState,
    "stage": StageState,
    "interlock": InterlockState,
}
_DESCRIBED = (*_STATES, "channels", "trigger")
_UNLIKE = "mend the driver, which does not return what its interface declares"
_WORDS: dict[Any, str] = {
    float: "a number",
    int: "a whole number",
    bool: "True or False",
    tuple[str, ...]: "a tuple of texts",
    datetime: "a date and time with its zone, from 1970 on",
}
_FINITE = ("load_n", "displacement_mm", "angle_deg")
_FIRST_YEAR = 1970
_UNKNOWN_TIMES = "mend the driver, whose times are not on the rig's clock"


def checked(kind: DeviceKind, name: str, device: Any, clock: Clock) -> Any:
    """Return an opened device whose readings and images are checked.

    `kind` is the kind of device. A device of another kind than load frame, stage, interlock or camera is
    returned as it is. `name` is the device's name in the rig file, for messages. `clock` is the rig's clock.
    """
    if kind in _STATES:
        return _CheckedReadings(name, device, clock, _STATES[kind])
    if kind == "channels":
        return _CheckedSamples(name, device, clock)
    return _CheckedImages(name, device, clock) if kind == "camera" else device


def require_identity(kind: DeviceKind, name: str, device: Any) -> None:
    """Raise `DeviceFault` if a driver opened no device, or one without its description in `info`."""
    expected = CameraInfo if kind == "camera" else DeviceInfo if kind in _DESCRIBED else None
    info = getattr(device, "info", None)
    if expected is not None and not isinstance(info, expected):
        got = _shown(device) if device is None else f"one whose info is {_shown(info)}"
        raise DeviceFault(name, "open", f"a device with a {expected.__name__} as info", got, _UNLIKE)


class _Checked:
    """A wrapper around a device, which passes on all methods that it does not have itself."""

    def __init__(self, name: str, device: Any, clock: Clock) -> None:
        self._name, self._device, self._clock = name, device, clock

    def __getattr__(self, name: str) -> Any:
        return getattr(self._device, name)

    def _as(self, action: str, value: Any, kind: type) -> Any:
        """Return a state or an image with Python's numbers; raise `DeviceFault` if it is none."""
        if not isinstance(value, kind):
            raise DeviceFault(self._name, action, f"a {kind.__name__}", _shown(value), _UNLIKE)
        for name, expected in _kinds(kind).items():
            given = getattr(value, name)
            if not _fits(given, expected) or (name in _FINITE and not math.isfinite(given)):
                words = (
                    "a finite number" if name in _FINITE else _WORDS.get(expected, "a picture of grey levels")
                )
                raise DeviceFault(self._name, action, f"{words} as {name}", _shown(given), _UNLIKE)
        state: Any = value
        given = {name: getattr(state, name) for name in _kinds(kind)}
        plain = {name: each.item() for name, each in given.items() if isinstance(each, np.generic)}
        return replace(state, **plain) if plain else state


class _CheckedReadings(_Checked):
    def __init__(self, name: str, device: Any, clock: Clock, kind: type) -> None:
        super().__init__(name, device, clock)
        self._kind = kind

    def read(self) -> Any:
        """Return the state. Raise `DeviceFault` if it is none, or was not read during this call."""
        asked_s = self._clock.now_s()
        state = self._as("read", self._device.read(), self._kind)
        if got := _wrong_time(state.time_s, asked_s, self._clock.now_s()):
            raise DeviceFault(
                self._name, "read", "a reading made after it was asked for", f"one made {got}", _UNKNOWN_TIMES
            )
        return state


class _CheckedImages(_Checked):
    def __getattr__(self, name: str) -> Any:
        # Only a camera that has a stream has this attribute.
        return (
            self._checked_stream
            if name == "stream" and hasattr(self._device, name)
            else super().__getattr__(name)
        )

    def grab(self, timeout_s: float) -> Any:
        """Return an image. Raise `DeviceFault` if it is none, or its times are impossible.

        The engine itself refuses and repeats an image that was exposed before it was asked for.
        """
        return self._image("grab", self._device.grab(timeout_s))

    def _checked_stream(self, capacity: int) -> "_CheckedStream":
        return _CheckedStream(self._name, self._device.stream(capacity), self._clock)

    def _image(self, action: str, value: Any) -> Any:
        frame = self._as(action, value, Frame)
        now_s = self._clock.now_s()
        if got := _wrong_time(frame.exposed_s, -math.inf, frame.received_s):
            expected = "an image exposed before it was received"
            raise DeviceFault(self._name, action, expected, f"one exposed {got}", _UNKNOWN_TIMES)
        if got := _wrong_time(frame.received_s, frame.exposed_s, now_s):
            expected = "an image received until now"
            raise DeviceFault(self._name, action, expected, f"one received {got}", _UNKNOWN_TIMES)
        middle_s, middle_std_s = frame.middle
        if got := _wrong_time(middle_s, frame.exposed_s, frame.received_s):
            expected = "an image with the middle of its exposure between its times"
            raise DeviceFault(self._name, action, expected, f"one {got}", _UNKNOWN_TIMES)
        if not 0.0 <= middle_std_s < math.inf:
            expected = "a standard deviation of the middle of the exposure"
            raise DeviceFault(self._name, action, expected, f"{middle_std_s}", _UNKNOWN_TIMES)
        return frame


class _CheckedStream(_CheckedImages):
    def next(self, timeout_s: float) -> Any:
        """Return the next image. Raise the same errors as `grab` of its camera."""
        return self._image("stream", self._device.next(timeout_s))


class _CheckedSamples(_Checked):
    def read(self, timeout_s: float) -> Samples:
        """Return the samples. Raise `DeviceFault` if they are none, or their times are impossible."""
        samples = self._device.read(timeout_s)
        now_s = self._clock.now_s()
        if not isinstance(samples, Samples):
            raise DeviceFault(self._name, "read", "Samples", _shown(samples), _UNLIKE)
        count, signals = len(samples.values), len(self._device.signals)
        if count == 0 or samples.values.shape != (count, signals):
            got = f"values of the shape {samples.values.shape}"
            raise DeviceFault(self._name, "read", f"values of {signals} signals", got, _UNLIKE)
        if got := _wrong_time(samples.received_s, max(samples.asked_s, -math.inf), now_s):
            raise DeviceFault(self._name, "read", "samples received until now", f"some {got}", _UNKNOWN_TIMES)
        device_s = samples.device_s
        alone = device_s is None and count == 1 and math.isfinite(samples.asked_s)
        if not alone and (
            device_s is None or device_s.shape != (count,) or not (np.diff(device_s) > 0.0).all()
        ):
            expected = "a time for each sample, later than the one before"
            raise DeviceFault(self._name, "read", expected, "others", _UNKNOWN_TIMES)
        return samples


@cache
def _kinds(kind: type) -> dict[str, Any]:
    """Return the declared type of each attribute of a state or an image."""
    hints = get_type_hints(kind)
    return {each.name: hints[each.name] for each in fields(kind)}


def _fits(value: Any, declared: Any) -> bool:
    """Return whether a value is of a declared type; numbers of numpy count as those of Python."""
    if declared is bool:
        return isinstance(value, bool | np.bool_)
    if declared in (int, float):
        kinds = (int, np.integer) if declared is int else (int, float, np.integer, np.floating)
        return isinstance(value, kinds) and not isinstance(value, bool)
    if declared == tuple[str, ...]:
        return isinstance(value, tuple) and all(isinstance(each, str) for each in value)
    if declared is datetime:
        return isinstance(value, datetime) and value.tzinfo is not None and value.year >= _FIRST_YEAR
    return isinstance(value, np.ndarray) and value.ndim == 2


def _shown(value: object) -> str:
    if isinstance(value, int | float | np.number | datetime):
        return str(value)
    return "None" if value is None else f"a {type(value).__name__}"


def _wrong_time(time_s: float, first_s: float, last_s: float) -> str:
    """Return how a time lies outside `first_s` to `last_s`, or an empty text if it lies between them."""
    if not math.isfinite(time_s):
        return f"at the time {time_s}"
    if time_s < first_s - _TICK_S:
        return f"{first_s - time_s:.3f} s before"
    return f"{time_s - last_s:.3f} s later" if time_s > last_s + _TICK_S else ""
