"""Measure the delay of a channel against the cameras of a rig, with one light that both of them see."""

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import cv2
import numpy as np

from drivers.errors import DeviceError
from drivers.interfaces import Camera, Frame
from drivers.settings import toml_table
from rig.channels.delay import Delay, find_delay
from rig.channels.edges import LEAST_CONTRAST, edges_of_light, edges_of_signal, levels_of
from rig.channels.run_channels import RunChannels
from rig.devices import Rig
from rig.engine.calls import Call, Calls, Deadline
from rig.errors import RigError
from rig.rigfile import RigFile
from rig.samples import Floats, TimedSamples

SECONDS = 30.0
_FRAME_S = 5.0
_SPARE_S = 30.0
_BEFORE_S, _AFTER_S = 2.0, 0.5
"""Time in s before the film, in which the channel's times settle, and after it, for late samples."""
_POLL_S = 0.05
_BLOCKS = 16
_CHOSEN_SHARE = 0.5
_EVERY_PX = 4
_STREAM_FRAMES = 64
_ALIKE_TIMES = 3.0


@dataclass
class DelayCheck:
    """The result of the measurement: lines to print, a table for JSON, problems, and cameras that failed."""

    lines: list[str] = field(default_factory=list)
    delays: dict[str, Any] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    failed: dict[str, str] = field(default_factory=dict)


@dataclass
class Film:
    """The brightness of all images of a camera, in blocks, and their times."""

    camera: Camera
    bits: int
    middles_s: list[float] = field(default_factory=list)
    lengths_s: list[float] = field(default_factory=list)
    blocks: list[Any] = field(default_factory=list)
    full: list[int] = field(default_factory=list)

    def take(self, now_s: Callable[[], float], until_s: float) -> None:
        """Film until a time: all frames of the camera's stream, or images one after the other."""
        camera: Any = self.camera
        stream = camera.stream(_STREAM_FRAMES) if callable(getattr(camera, "stream", None)) else None
        try:
            while now_s() < until_s:
                self._add(camera.grab(_FRAME_S) if stream is None else stream.next(_FRAME_S))
        finally:
            if stream is not None:
                stream.close()

    def _add(self, frame: Frame) -> None:
        self.middles_s.append(frame.middle[0])
        length_us = frame.exposure_us
        self.lengths_s.append(0.0 if np.isnan(length_us) else 1e-6 * length_us)
        means = cv2.resize(frame.image, (_BLOCKS, _BLOCKS), interpolation=cv2.INTER_AREA)
        self.blocks.append(means.astype(np.float32).ravel())
        some = frame.image[::_EVERY_PX, ::_EVERY_PX]
        self.full.append(int(np.count_nonzero(some >= (1 << self.bits) - 1)))

    def brightness(self) -> Floats:
        """Return the mean brightness of the region whose brightness changes most, for each image."""
        blocks = np.array(self.blocks)
        low, high = np.percentile(blocks, (2.0, 98.0), axis=0)
        change = high - low
        chosen = blocks[:, change >= _CHOSEN_SHARE * change.max()]
        return np.asarray(chosen.mean(axis=1), np.float64)


def only_delay(rig_file: RigFile, wanted: str) -> tuple[RigFile, str]:
    """Return the rig with the cameras and the device of one channel only, and the name of its signal."""
    signal = wanted.removeprefix("channels.")
    owners = {
        known.name: name
        for name, entry in rig_file.channels.items()
        for known in entry.setting("declared") or ()
    }
    if signal not in owners:
        known = ", ".join(f"channels.{name}" for name in owners) or "none"
        raise RigError(
            str(rig_file.path),
            f"--delay with a signal of the rig ({known})",
            repr(wanted),
            "correct the name",
        )
    channels = {owners[signal]: rig_file.channels[owners[signal]]}
    nothing: dict[str, Any] = {"interlocks": {}, "triggers": {}, "measured_load": None}
    return replace(rig_file, stage=None, load_frame=None, channels=channels, **nothing), signal


def measure_delay(
    rig: Rig, signal: str, seconds: float, say: Callable[[str], None] = lambda _: None
) -> DelayCheck:
    """Film with all cameras while somebody switches a light, whose voltage is the signal.

    Raise `DeviceError` if the channel device fails, and `RigError` if the channel does not switch.
    """
    found = DelayCheck()
    films = {name: Film(camera, camera.info.bits) for name, camera in rig.cameras.items()}
    samples = _record(rig, films, seconds, found, say)
    ((name, device),) = rig.channels.items()
    column = [each.name for each in device.signals].index(signal)
    times_s = np.concatenate([each.time_s for each in samples])
    values = np.concatenate([each.values[:, column] for each in samples])
    levels = levels_of(values)
    if levels.contrast < LEAST_CONTRAST:
        raise RigError(
            f"channels.{signal}",
            "a signal that switches between two levels",
            f"one from {values.min():.6g} to {values.max():.6g} {device.signals[column].unit} without edges",
            "wire the voltage of the light to this input, and switch the light on and off",
        )
    edges = edges_of_signal(times_s, values, levels)
    span_s = float(times_s[0]), float(times_s[-1])
    for camera, film in films.items():
        if f"cameras.{camera}" not in found.failed:
            _tell(found, camera, signal, _delay_of(film, edges, span_s))
    _tell_rig_file(found, name, signal)
    return found


def _record(
    rig: Rig, films: dict[str, Film], seconds: float, found: DelayCheck, say: Callable[[str], None]
) -> list[TimedSamples]:
    """Film with all cameras at the same time, and return the samples of the channel device."""
    samples: list[TimedSamples] = []
    channels = RunChannels(rig.channels, rig.clock, lambda _, timed: samples.append(timed))
    calls = Calls(rig.clock, lambda: None, rig.lost, meanwhile=channels.read, every_s=_POLL_S)
    with rig.clock.activity():
        try:
            channels.begin()
            while not channels.are_ready:
                calls.pause(_POLL_S)
            calls.pause(_BEFORE_S)
            say(f"switch the light on and off at irregular times, for {seconds:g} s from now")
            until_s = rig.clock.now_s() + seconds
            running = {name: _begin(calls, rig, name, film, until_s) for name, film in films.items()}
            for name, call in running.items():
                try:
                    calls.finish(call, watched=True)
                except DeviceError as error:
                    channels.read()  # an error of the channel ends the measurement
                    found.failed[f"cameras.{name}"] = str(error)
            calls.pause(_AFTER_S)
            channels.read()
        finally:
            rig.lost.update(channels.end())
            calls.close()
    return list(samples)


def _begin(calls: Calls, rig: Rig, name: str, film: Film, until_s: float) -> Call[None]:
    deadline = Deadline(until_s - rig.clock.now_s() + _SPARE_S, "check the camera and its cable")
    return calls.begin(f"cameras.{name}", "film", lambda: film.take(rig.clock.now_s, until_s), deadline)


def _delay_of(film: Film, signal: Any, span_s: tuple[float, float]) -> Delay | str:
    if not film.middles_s:
        return "no image was taken"
    values = film.brightness()
    levels = levels_of(values)
    if levels.contrast < LEAST_CONTRAST:
        return (
            f"0 edges in {len(values)} images: their brightness does not switch between two levels; bring "
            "the light into view and switch it"
        )
    bright = levels.share(values) > 0.5
    full = np.array(film.full)
    saturated = bool(full[bright].mean() >= full[~bright].mean() + 1.0)
    middles_s, lengths_s = np.array(film.middles_s), np.array(film.lengths_s)
    light = edges_of_light(middles_s, lengths_s, values, levels, saturated=saturated)
    return find_delay(light, signal, span_s)


def _tell(found: DelayCheck, camera: str, signal: str, delay: Delay | str) -> None:
    where = f"cameras.{camera}"
    if isinstance(delay, str):
        found.failed[where] = f"{where}: {delay}"
        return
    found.delays[camera] = asdict(delay)
    found.lines += [
        f"{where}: channels.{signal} is {delay.delay_s:.4f} s later than the middle of the exposure",
        f"  from {delay.edges} edges, {delay.missing} others were not found; the mean is known to "
        f"{1e3 * delay.mean_std_s:.2g} ms, the delay varies by {1e3 * delay.jitter_s:.2g} ms",
    ]
    if delay.others_s:
        others = ", ".join(f"{other_s:.2f}" for other_s in delay.others_s[:3])
        found.problems.append(
            f"{where}: the light switched so regularly that delays of {others} s fit as well; switch it at "
            "irregular times"
        )
    if delay.delay_s < -_ALIKE_TIMES * delay.delay_std_s:
        found.problems.append(
            f"{where}: the images are later than the channel, so the times of the camera's driver are late; "
            "no delay_s can state this"
        )


def _tell_rig_file(found: DelayCheck, device: str, signal: str) -> None:
    """Tell what to write into the rig file, from the camera that knows the delay best."""
    if not found.delays:
        return
    best = min(found.delays.values(), key=lambda delay: delay["mean_std_s"])
    for camera, delay in found.delays.items():
        apart_s = abs(delay["delay_s"] - best["delay_s"])
        known_s = float(np.hypot(delay["mean_std_s"], best["mean_std_s"]))
        if apart_s > _ALIKE_TIMES * known_s:
            found.problems.append(
                f"cameras.{camera}: its delay differs by {1e3 * apart_s:.2g} ms from that of another camera: "
                "the times of one of them are not those of its exposures"
            )
    settings = {
        "delay_s": round(max(0.0, best["delay_s"]), 4),
        "delay_std_s": round(best["delay_std_s"], 5),
    }
    table = toml_table(["channels", device, "signals", signal], settings)
    found.lines += ["write into the rig file, for this and all signals on the same way:", *table.splitlines()]
