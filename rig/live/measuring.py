"""Measures the gauges of all cameras in the frames of one moment, and chooses the camera of each value."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rig.live.pairing import Arrival, middle_of
from rig.live.values import CAUSES, GaugeValue, LiveReading

if TYPE_CHECKING:
    from dic.live import FieldMotion, LiveGauge, LiveImage, LiveSetups, LostPlaces, Reason, Sought

_OF_FIELD = ("no_motion", "old", "declined")
_WARM_UP = 12


@dataclass(frozen=True)
class Shown:
    """A frame and its pixels, which may be in shared memory."""

    arrival: Arrival
    image: NDArray[Any]


class Measuring:
    """The live measurement of all cameras.

    Parameters
    ----------
    setups : LiveSetups
    camera : str or None
        The camera whose values are taken. Default: the one with the smallest standard deviation at the first
        moment with frames of all cameras and a valid value.
    best_only : bool
        True if `images` shall have what the values need only: the raw and the best readings, and after the
        choice those of the chosen camera.
    """

    def __init__(self, setups: "LiveSetups", camera: str | None = None, *, best_only: bool = True) -> None:
        from dic.live import LiveCamera, LivePair

        self._setups, self._chosen, self._best_only = setups, camera, best_only
        self._cameras = {
            name: LiveCamera(setup, best_only=best_only) for name, setup in setups.cameras.items()
        }
        self._pair: LivePair | None = None
        if setups.pair is not None:
            first, second = setups.pair
            self._pair = LivePair(self._cameras[first], self._cameras[second], setups.surface)
        self._gauges = [gauge.name for gauge in next(iter(setups.cameras.values())).gauges]
        self._located: dict[str, tuple[int, Reason]] = {}
        self.images: Mapping[str, LiveImage] = {}
        """All readings in the frames that were measured last, by camera."""
        self.field_problem = ""
        """Why the last field could not be solved or corrected; empty if it was."""

    def locate(self, name: str, shown: Shown) -> "Reason":
        """Find the points in a frame, once; the frame may wait for that of another camera to be measured.

        Return why the frame is not valid.
        """
        number, reason = self._located.get(name, (0, None))
        if reason is None or number != shown.arrival.number:
            reason = self._cameras[name].locate(shown.image, shown.arrival.time_s)
            self._located[name] = shown.arrival.number, reason
        return reason

    def measure(self, frames: Mapping[str, Shown], missing: Mapping[str, str]) -> LiveReading:
        """Return the values in frames of one moment; the time at which they are known is that of the frames.

        `missing`: why cameras have no frame.
        """
        images: dict[str, LiveImage] = {}
        pair = self._setups.pair
        time_s, time_std_s = middle_of([shown.arrival for shown in frames.values()])
        reasons = {name: self.locate(name, shown) for name, shown in frames.items()}
        if self._pair is not None and pair is not None and frames.keys() >= set(pair):
            one, other = pair
            shown = frames[one].image, frames[other].image
            only = pair.index(self._chosen) if self._best_only and self._chosen in pair else None
            both = self._pair.read(shown, time_s, (reasons[one], reasons[other]), only)
            images |= dict(zip(pair, both, strict=True))
        for name in frames.keys() - images.keys():
            images[name] = self._cameras[name].read(frames[name].image, time_s, reasons[name])
        self.images = images
        if self._chosen is None and images.keys() == self._cameras.keys():
            self._chosen = self._most_certain(images)
        return LiveReading(
            time_s,
            time_std_s,
            time_s,
            {name: shown.arrival.sequence for name, shown in frames.items()},
            {name: self._value(name, images, missing) for name in self._gauges},
            dict(missing),
        )

    def take(self, motions: "Mapping[str, FieldMotion]") -> None:
        """Take the motions out of the plane that fields have shown, for the next frames."""
        for name, motion in motions.items():
            self._cameras[name].take(motion)

    def lost(self) -> "dict[str, LostPlaces]":
        """Return the lost points of each camera in whose last frame a whole patch of them was lost."""
        return {name: self._cameras[name].lost for name, image in self.images.items() if image.lost}

    def accept(self, camera: str, sought: "Sought") -> None:
        """Let the next frame of a camera start from points that a search has found."""
        self._cameras[camera].accept(sought)

    def _value(self, name: str, images: "Mapping[str, LiveImage]", missing: Mapping[str, str]) -> GaugeValue:
        camera = self._chosen
        if camera is not None and camera not in images:
            reason = f"no frame of {camera}: {missing.get(camera, 'none has come')}"
            return GaugeValue(math.nan, math.nan, False, reason, "", camera, "no_frame")
        if camera is None:
            camera = min(images, key=lambda each: _rank(images[each].gauges.get(name)))
        return self._of(camera, images[camera], name)

    def _of(self, camera: str, image: "LiveImage", name: str) -> GaugeValue:
        gauge = image.gauges.get(name)
        if gauge is None:
            reason = image.reason
            return GaugeValue(math.nan, math.nan, False, reason.value, "", camera, reason.name.lower())
        value = gauge.value()
        cause = value.reason.name.lower() if value.reason else ""
        text = value.reason.value
        if gauge.figures and gauge.reason:
            text = f"{text} ({gauge.figures})"
        if cause in _OF_FIELD and self.field_problem:
            text = f"{text} ({self.field_problem})"
        return GaugeValue(value.strain, value.std, value.valid, text, value.kind, camera, cause)

    def _most_certain(self, images: "Mapping[str, LiveImage]") -> str | None:
        """Return the camera with the smallest standard deviation of valid values, None without any."""
        stds = {}
        for camera, image in images.items():
            values = [gauge.value() for gauge in image.gauges.values()]
            if values and all(value.valid for value in values):
                stds[camera] = sum(value.std for value in values)
        return min(stds, key=lambda name: stds[name], default=None)


def _rank(gauge: "LiveGauge | None") -> tuple[bool, float]:
    """Return what sorts the values of several cameras: valid ones first, then by standard deviation."""
    if gauge is None:
        return True, math.inf
    value = gauge.value()
    return not value.valid, value.std if math.isfinite(value.std) else math.inf


def warm_up(setups: "LiveSetups") -> None:
    """Measure frames like the references with another measurement, so that all code is compiled."""
    other, rng = Measuring(setups), np.random.default_rng(0)
    for k in range(1, _WARM_UP + 1):
        frames = {}
        for name, setup in setups.cameras.items():
            noisy = setup.reference + rng.integers(0, 2, setup.reference.shape)
            frames[name] = Shown(Arrival(k, float(k)), noisy.astype(setup.reference.dtype))
        other.measure(frames, {})


def cause_number(value: GaugeValue) -> int:
    """Return the number of the reason why a value is not valid, 0 for a valid one."""
    return CAUSES.index(value.cause)
